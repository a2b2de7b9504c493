"""`equigap`: the command line in, one call of a study's `main(args)` out.

A subcommand's module is imported when it is chosen, so `equigap --help` answers at once. What a user can mend
ends in one line 'equigap: error: what is wrong; what to do' and exit code 2; an interruption in exit code 130.
"""

from __future__ import annotations

import argparse
import errno
import importlib
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from typing import Any

from studies.commands.arguments import Parser, check_options, config_files, read_config
from studies.commands.options import nearest
from studies.errors import OptionError, StudyError


@dataclass(frozen=True)
class Command:
    """A subcommand: module with `add_arguments(parser)` and `main(args) -> int`, one line, examples."""

    module: str
    summary: str
    examples: str


COMMANDS = {
    "specimens": Command(
        "studies.commands.draw_specimens",
        "mesh and draw every specimen",
        "equigap specimens\n  equigap specimens --only cross --set half_width=35",
    ),
    "simulate": Command(
        "studies.commands.simulate",
        "solve a test by finite elements and record it with a noisy camera",
        "equigap simulate --quick\n  equigap simulate --material neo_hooke --displacement 40 --seed 3",
    ),
    "import": Command(
        "studies.commands.import_data",
        "read measured full-field data into an Experiment",
        "equigap import Soft_Homo\n  equigap import columns.toml --output results/my-sheet",
    ),
    "homogeneous": Command(
        "studies.commands.homogeneous",
        "read a stress-stretch curve into an Experiment",
        "equigap homogeneous treloar-a-uniaxial\n  equigap homogeneous pull.csv --mode pure_shear -o results/pull",
    ),
    "calibrate": Command(
        "studies.commands.calibrate",
        "identify a network from an Experiment",
        "equigap calibrate results/simulate/experiment.npz\n  equigap calibrate sheet.npz --inputs I1I2 --layers 4,4",
    ),
    "predict": Command(
        "studies.commands.predict",
        "uniaxial, equi-biaxial and pure-shear curves of a model",
        "equigap predict results/calibrate/model.json\n  equigap predict model.json --stretch 2.5 --against arruda_boyce",
    ),
    "discover": Command(
        "studies.commands.discover",
        "find what a hyperelastic model leaves unexplained in a test",
        "equigap discover results/simulate/experiment.npz\n  equigap discover pull_x.npz --hold-out pull_y.npz\n"
        "  equigap discover sheet.npz --hold-out every:2 --without 'force offset' -o results/sheet",
    ),
    "resolution": Command(
        "studies.commands.resolution",
        "study: how camera resolution and noise limit what is identified",
        "equigap resolution --quick\n  equigap resolution --jobs 8 --output results/resolution",
    ),
    "thickness": Command(
        "studies.commands.thickness",
        "study: how thick a specimen may be before a plane-stress calibration misleads",
        "equigap thickness --quick\n  equigap thickness --thicknesses 5,30 --seeds 20\n  equigap thickness --fine --profile my-cluster",
    ),
    "sweep": Command(
        "studies.commands.sweep",
        "study: a thousand calibrations over specimen, thickness, resolution, noise and seed",
        "equigap sweep --quick\n  equigap sweep --dry-run\n  equigap sweep --thicknesses 2D,5,30 --noises 0.1 --seeds 20 --jobs 8\n"
        "  equigap sweep --profile my-cluster --container equigap.sif",
    ),
    "blind": Command(
        "studies.commands.blind",
        "study: does the diagnosis find hidden effects, and nothing where nothing is?",
        "equigap blind --quick\n  equigap blind --trials 5 --nulls 20 --jobs 8",
    ),
    "measured": Command(
        "studies.commands.measured",
        "study: what measured sheets and homogeneous tests do beyond hyperelasticity",
        "equigap measured --quick\n  equigap measured --until 15 --frames 24 -o results/measured",
    ),
    "figures": Command(
        "studies.commands.figures",
        "every figure and table of all studies, in one folder",
        "equigap figures --scale quick\n  equigap figures --scale default --only resolution,thickness -o results/all",
    ),
    "verify": Command(
        "studies.commands.verify",
        "compare the numbers of a run of `figures` with reference values",
        "equigap verify results/figures-quick\n  equigap verify results/figures-quick --same-as results/again",
    ),
    "supervised": Command(
        "studies.commands.supervised",
        "fit networks directly to stress-stretch data",
        "equigap supervised --quick",
    ),
}
INTRODUCTION = """\
Calibrate neural-network hyperelastic models from full-field measurements.
Units: N, mm, MPa (N/mm where the thickness is unknown), s."""
CLOSING = """\
examples:
  equigap simulate --quick                                  a synthetic test of the cross
  equigap calibrate results/simulate-quick/experiment.npz   the model behind it
  equigap resolution --quick                                a whole study in about a minute

An output folder is never overwritten silently: the same command resumes there, another is refused unless
--overwrite is given. `equigap COMMAND --help` lists the options of a command."""


def overview() -> Parser:
    """The parser of `equigap` itself: lists the commands, imports none."""
    parser = Parser(
        prog="equigap", description=INTRODUCTION, formatter_class=argparse.RawDescriptionHelpFormatter,
        usage="equigap COMMAND [options]", epilog=_commands() + "\n\n" + CLOSING, allow_abbrev=False,
    )  # fmt: skip
    parser.add_argument("--version", action="version", version=f"equigap {_version()}")
    return parser


def command_parser(name: str) -> tuple[Parser, Any]:
    """The parser of a command and its module, imported now. Raises `OptionError` where the module is not there."""
    command = COMMANDS[name]
    try:
        module = importlib.import_module(command.module)
    except ModuleNotFoundError as error:
        if error.name == command.module:
            raise OptionError(f"`equigap {name}` is not part of this version; choose another command") from None
        raise
    parser = Parser(
        prog=f"equigap {name}", description=getattr(module, "DESCRIPTION", command.summary.capitalize() + "."),
        formatter_class=argparse.RawDescriptionHelpFormatter, epilog=f"examples:\n  {command.examples}",
        allow_abbrev=False,
    )  # fmt: skip
    module.add_arguments(parser)
    if parser.action("--config") is None:
        parser.reads_config = True
        parser.add_argument(
            "--config", metavar="FILE.toml", help="read options from a TOML file; the command line wins"
        )
    return parser, module


def parse(arguments: Sequence[str]) -> tuple[argparse.Namespace, Any]:
    """Options of a command line that starts with a command, and the module that runs it. Raises `OptionError`."""
    name, *rest = arguments
    if name not in COMMANDS:
        raise OptionError(f"unknown command '{name}'{nearest(name, COMMANDS)}; choose from {', '.join(COMMANDS)}")
    parser, module = command_parser(name)
    check_options(rest, parser)
    if parser.reads_config:
        for path in config_files(rest):
            # an option in between ends lists of values, before the command line's own words
            rest = [*read_config(path, parser), f"--config={path}", *rest]
    args, unknown = parser.parse_known_args(rest)
    if unknown:
        raise OptionError(f"unexpected '{unknown[0]}'; see `{parser.prog} --help`")
    args.command = name
    if parser.reads_config:
        del args.config
    return args, module


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `equigap`; returns the exit code.

    Named errors, `OptionError` among them, and those of the operating system become one line and exit code 2; with
    EQUIGAP_DEBUG in the environment they are raised.
    """
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    try:
        if not arguments or arguments[0].startswith("-"):
            _, unknown = overview().parse_known_args(arguments)
            if unknown:
                raise OptionError(f"the first word must be a command: {', '.join(COMMANDS)}")
            overview().print_help()
            return 0 if arguments else 2
        args, module = parse(arguments)
        return int(module.main(args) or 0)
    except KeyboardInterrupt:
        return _say("interrupted; the same command goes on from the last finished step", 130)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Exception as error:
        if os.environ.get("EQUIGAP_DEBUG") or not _can_be_mended(error):
            raise
        return _say(f"error: {_message(error)}", 2)


def _can_be_mended(error: Exception) -> bool:
    """Whether this is a named error of ours or of the operating system; imports nothing."""
    kinds: list[type[BaseException]] = [StudyError, OSError]
    for module, name in (
        ("calibrate.errors", "EquigapError"),
        ("forward.errors", "ForwardError"),
        ("meshes.errors", "MeshError"),
    ):
        if module in sys.modules:
            kinds.append(getattr(sys.modules[module], name))
    return isinstance(error, tuple(kinds))


def _message(error: Exception) -> str:
    """One line that says what is wrong and what to do."""
    if isinstance(error, OSError) and error.strerror:
        what = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        return what + ("; free some space and run the same command again" if full else "; check the path")
    return " ".join(str(error).split())


def _say(message: str, code: int) -> int:
    print(f"equigap: {message}", file=sys.stderr)
    return code


def _commands() -> str:
    width = max(map(len, COMMANDS))
    return "commands:\n" + "\n".join(f"  {name:{width}}  {c.summary}" for name, c in COMMANDS.items())


def _version() -> str:
    try:
        return metadata.version("equigap")
    except metadata.PackageNotFoundError:
        return "(not installed)"


if __name__ == "__main__":
    sys.exit(main())
