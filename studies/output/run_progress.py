"""What a long command says on stderr, and its checkpoint: a run that was killed goes on with the same command.

In: a file in the output folder. Out: `RunProgress`. The checkpoint is one file, written anew at every stage, so that what stages share stays shared. It is used
only by the code that wrote it, with the same packages (`manifest.made_by`), and only where it belongs to the user who runs the command: reading a pickle runs code.
"""

from __future__ import annotations

import copyreg
import os
import pickle
import sys
import time
from dataclasses import is_dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import jax

from calibrate.effects import CATALOGUE, Effect
from calibrate.fitting.resumable import Resumable
from studies.output.manifest import made_by
from studies.output.writing import atomic_path

INTERVAL = 20.0  # s between lines that are not on a terminal
PROTOCOL = 5
SECONDS = "wall seconds"  # beside the stages
_BY_NAME = {effect.name: effect for effect in CATALOGUE}


class RunProgress(Resumable):
    """Says stages on stderr: in one line on a terminal, else at most every `INTERVAL`. checkpoint: file that keeps them; None: nothing is kept.

    Leaving it as a context clears the line; `finished` deletes the checkpoint.
    """

    def __init__(self, checkpoint: Path | None = None) -> None:
        self._start = self._last = time.monotonic()
        self._checkpoint = checkpoint
        self._stages: dict[str, Any] = {}
        if checkpoint is not None:
            self._stages = _read(checkpoint)
            for half in checkpoint.parent.glob(f".{checkpoint.stem}-*{checkpoint.suffix}"):
                half.unlink()  # a run was killed while it wrote it

    def __enter__(self) -> RunProgress:
        return self

    def __exit__(self, *error: object) -> None:
        if sys.stderr.isatty():
            print("\r\033[K", end="", file=sys.stderr, flush=True)

    def __call__(self, text: str) -> None:
        now = time.monotonic()
        line = f"{text}, {now - self._start:.0f} s"
        if sys.stderr.isatty():
            print(f"\r\033[K{line}", end="", file=sys.stderr, flush=True)
        elif now - self._last >= INTERVAL:
            self._last = now
            print(line, file=sys.stderr, flush=True)

    @property
    def earlier_seconds(self) -> float:
        """Wall time of the runs that this one goes on from."""
        return float(self._stages.get(SECONDS, 0.0))

    def load(self, stage: str) -> Any:
        return self._stages.get(stage)

    def save(self, stage: str, value: object) -> None:
        if self._checkpoint is None:
            return
        self._stages[stage] = value
        spent = self.earlier_seconds + time.monotonic() - self._start
        try:
            with atomic_path(self._checkpoint) as temporary, temporary.open("wb") as file:
                pickle.dump(_header(), file, PROTOCOL)
                _Pickler(file, PROTOCOL).dump({**self._stages, SECONDS: spent})
        except (OSError, pickle.PicklingError, AttributeError, TypeError, ValueError, RecursionError) as error:
            left = self._checkpoint.exists()
            known = "goes on from the last one that is there" if left else "starts from the beginning"
            print(f"equigap: no checkpoint of {stage} ({error}); a run that is killed {known}", file=sys.stderr)

    def discard(self, start: str) -> None:
        self._stages = {stage: value for stage, value in self._stages.items() if not stage.startswith(start)}

    def finished(self) -> None:
        """The results are written: nothing is left to go on with."""
        if self._checkpoint is not None:
            self._checkpoint.unlink(missing_ok=True)


class _Pickler(pickle.Pickler):
    """Effects of the catalogue by their names: what is read back has the same objects, for which code is compiled already. What is cached, or `WORKED_OUT` from the rest, is left out."""

    def persistent_id(self, obj: Any) -> str | None:
        return obj.name if isinstance(obj, Effect) and _BY_NAME.get(obj.name) is obj else None

    def reducer_override(self, obj: Any) -> Any:
        kind = type(obj)
        if not is_dataclass(kind) or not hasattr(obj, "__dict__"):
            return NotImplemented
        left: tuple[str, ...] = getattr(kind, "WORKED_OUT", ())
        state = {k: v for k, v in vars(obj).items() if not isinstance(getattr(kind, k, None), cached_property)}
        state |= dict.fromkeys(left)
        return (copyreg.__newobj__, (kind,), state) if left or len(state) < len(vars(obj)) else NotImplemented  # type: ignore[attr-defined]


class _Unpickler(pickle.Unpickler):
    def persistent_load(self, pid: str) -> Effect:
        return _BY_NAME[pid]


def _read(path: Path) -> dict[str, Any]:
    """Stages of an earlier run; none where there is no checkpoint, or one of other code, packages or another user, or a damaged one."""
    try:
        if path.stat().st_uid != os.getuid():
            return {}
        with path.open("rb") as file:
            if pickle.load(file) != _header():
                print(f"equigap: {path} is of another version; starting from the beginning", file=sys.stderr)
                return {}
            return dict(_Unpickler(file).load())
    except FileNotFoundError:
        return {}
    except Exception as error:  # a pickle that is damaged can raise anything
        print(f"equigap: {path} cannot be read ({error}); starting from the beginning", file=sys.stderr)
        return {}


def _header() -> dict[str, str]:
    return {**made_by(), "backend": jax.default_backend()}
