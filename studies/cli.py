"""`equigap`: the command line in, one call of a command's function out, whose typed result is printed.

A command's module is imported when it is chosen, and cyclopts with it, so `equigap --help` answers at once. What a user can
mend ends in one line 'equigap: error: what is wrong; what to do' and exit code 2; an interruption in exit code 130.
"""

from __future__ import annotations

import difflib
import errno
import gc
import importlib
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from typing import TYPE_CHECKING

from studies.commandline import compiled_code, freed_memory, threads
from studies.errors import OptionError, StudyError

if TYPE_CHECKING:
    from studies.commandline.outcome import Outcome

# Objects between two searches for cycles, by generation: arrays are freed without one, and JAX does work of its own in each (`docs/cost.md`).
COLLECTION = (50_000, 20, 50)


@dataclass(frozen=True)
class Command:
    """A command. target: 'module:function', imported when it is chosen; summary: one line; examples: command lines."""

    target: str
    summary: str
    examples: str


COMMANDS = {
    "specimens": Command(
        "studies.commands.draw_specimens:specimens",
        "mesh and draw every specimen",
        "equigap specimens\nequigap specimens --only cross --set half_width=35",
    ),
    "simulate": Command(
        "studies.commands.simulate:simulate",
        "solve a test by finite elements and record it with a noisy camera",
        "equigap simulate --quick\nequigap simulate --material neo_hooke --displacement 40 --seed 3",
    ),
    "import": Command(
        "studies.commands.import_data:import_data",
        "read measured full-field data into an Experiment",
        "equigap import Soft_Homo\nequigap import columns.toml --output results/my-sheet",
    ),
    "unpack": Command(
        "studies.commands.import_data:unpack",
        "write a packed test between two pads as tables of columns",
        "equigap unpack monolithic.npz\nequigap unpack monolithic.npz --name skin -o results/skin-tables",
    ),
    "homogeneous": Command(
        "studies.commands.homogeneous:homogeneous",
        "read a stress-stretch curve into an Experiment",
        "equigap homogeneous treloar-a-uniaxial\nequigap homogeneous pull.csv --mode pure_shear -o results/pull",
    ),
    "calibrate": Command(
        "studies.commands.calibrate:calibrate",
        "identify a network from an Experiment",
        "equigap calibrate results/simulate/experiment.npz\nequigap calibrate sheet.npz --inputs I1I2 --layers 4,4",
    ),
    "predict": Command(
        "studies.commands.predict:predict",
        "uniaxial, equi-biaxial and pure-shear curves of a model",
        "equigap predict results/calibrate/model.json\nequigap predict model.json --stretch 2.5 --against arruda_boyce",
    ),
    "replay": Command(
        "studies.commands.replay:replay",
        "solve a measured test by finite elements with a model, and compare",
        "equigap replay sheet.npz results/calibrate/model.json\nequigap replay sheet.npz neo_hooke --parameter mu=0.3",
    ),
    "export": Command(
        "studies.commands.export:export",
        "write a model as a law for a finite-element program",
        "equigap export results/calibrate/model.json --to uhyper\nequigap export yeoh --parameter c1=0.2 --to umat -o results/umat",
    ),
    "discover": Command(
        "studies.commands.discover:discover",
        "find what a hyperelastic model leaves unexplained in a test",
        "equigap discover results/simulate/experiment.npz\nequigap discover pull_x.npz --hold-out pull_y.npz\n"
        "equigap discover sheet.npz --hold-out every:2 --without 'force offset' -o results/sheet",
    ),
    "transfer": Command(
        "studies.commands.transfer:transfer",
        "predict another specimen with a model, and map where it differs",
        "equigap transfer results/discover/model.json other.npz\n"
        "equigap transfer model.json sheet.npz --hold-out after:15 -o results/other-sheet",
    ),
    "resolution": Command(
        "studies.commands.grid_studies.resolution:resolution",
        "study: how camera resolution and noise limit what is identified",
        "equigap resolution --quick\nequigap resolution --jobs 8 --output results/resolution",
    ),
    "thickness": Command(
        "studies.commands.grid_studies.thickness:thickness",
        "study: how thick a specimen may be before a plane-stress calibration misleads",
        "equigap thickness --quick\nequigap thickness --thicknesses 5,30 --seeds 20\nequigap thickness --fine --profile my-cluster",
    ),
    "sweep": Command(
        "studies.commands.grid_studies.sweep:sweep",
        "study: a thousand calibrations over specimen, thickness, resolution, noise and seed",
        "equigap sweep --quick\nequigap sweep --dry-run\nequigap sweep --thicknesses 2D,5,30 --noises 0.1 --seeds 20 --jobs 8\n"
        "equigap sweep --profile my-cluster --container equigap.sif",
    ),
    "generalise": Command(
        "studies.commands.grid_studies.generalise:generalise",
        "study: which specimens, invariants and sizes of network predict other specimens",
        "equigap generalise --quick\nequigap generalise --seeds 1 --jobs 2\nequigap generalise --dry-run",
    ),
    "blind": Command(
        "studies.commands.blind:blind",
        "study: does the diagnosis find hidden effects, and nothing where nothing is?",
        "equigap blind --quick\nequigap blind --trials 5 --nulls 20 --jobs 8",
    ),
    "measured": Command(
        "studies.commands.measured:measured",
        "study: what measured sheets and homogeneous tests do beyond hyperelasticity",
        "equigap measured --quick\nequigap measured --until 15 --frames 24 -o results/measured",
    ),
    "design": Command(
        "studies.commands.design:design",
        "which specimen to cut next, and what it would tell of the law",
        "equigap design --quick\nequigap design family.toml --validate --output results/next",
    ),
    "decide": Command(
        "studies.commands.decide:decide",
        "which test would tell explanations of a diagnosis apart",
        "equigap decide results/discover\nequigap decide results/discover family.toml --quick -o results/next",
    ),
    "figures": Command(
        "studies.commands.reproduction.figures:figures",
        "every figure and table of all studies, in one folder",
        "equigap figures --scale quick\nequigap figures --scale default --only resolution,thickness -o results/all",
    ),
    "verify": Command(
        "studies.commands.reproduction.verify:verify",
        "compare the numbers of a run of `figures` with reference values",
        "equigap verify results/figures-quick\nequigap verify results/figures-quick --same-as results/again",
    ),
    "supervised": Command(
        "studies.commands.supervised:supervised",
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


def overview() -> str:
    """What `equigap --help` prints: the commands, none of which is imported."""
    width = max(map(len, COMMANDS))
    commands = "\n".join(f"  {name:{width}}  {command.summary}" for name, command in COMMANDS.items())
    return f"Usage: equigap COMMAND [options]\n\n{INTRODUCTION}\n\ncommands:\n{commands}\n\n{CLOSING}"


def run(words: Sequence[str]) -> Outcome | None:
    """Run a command line that starts with a command; None where it asked for help. Raises `OptionError`."""
    name = words[0]
    if name not in COMMANDS:
        close = difflib.get_close_matches(name, COMMANDS, 1, 0.5)
        hint = f"; did you mean {close[0]}?" if close else ""
        raise OptionError(f"unknown command '{name}'{hint}; choose from {', '.join(COMMANDS)}")
    compiled_code.keep()
    threads.limit()
    freed_memory.give_back()
    gc.set_threshold(*COLLECTION)
    application = importlib.import_module("studies.commandline.application")  # cyclopts alone takes 0.3 s
    return application.run(targets(name), words)


def targets(name: str) -> dict[str, tuple[str, str]]:
    """What `studies.commandline.application` takes to run a command."""
    return {name: (COMMANDS[name].target, COMMANDS[name].examples)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `equigap`; returns the exit code.

    Named errors, `OptionError` among them, and those of the operating system become one line and exit code 2; with
    EQUIGAP_DEBUG in the environment they are raised.
    """
    words = sys.argv[1:] if arguments is None else list(arguments)
    try:
        if not words or words[0] in ("-h", "--help"):
            print(overview())
            return 0 if words else 2
        if words[0] == "--version":
            print(f"equigap {_version()}")
            return 0
        if words[0].startswith("-"):
            raise OptionError(f"the first word must be a command: {', '.join(COMMANDS)}")
        return _show(run(words))
    except KeyboardInterrupt:
        return _say(
            "interrupted; the same command goes on: a study or a diagnosis from its last finished step, a single fit from its beginning",
            130,
        )
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Exception as error:
        if os.environ.get("EQUIGAP_DEBUG") or not _can_be_mended(error):
            raise
        return _say(f"error: {_message(error)}", 2)


def _show(outcome: Outcome | None) -> int:
    """Print what a command returned. Raises its failure."""
    if outcome is None:
        return 0
    for line in outcome.lines():
        print(line)
    failure = outcome.failure()
    if failure is not None:
        raise failure
    return 0


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


def _version() -> str:
    try:
        return metadata.version("equigap")
    except metadata.PackageNotFoundError:
        return "(not installed)"


if __name__ == "__main__":
    sys.exit(main())
