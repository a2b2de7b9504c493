"""Commands as a user runs them: exit code and what is printed; refusals that name what is wrong and leave nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from studies import cli


class Said(NamedTuple):
    """Exit code of a command, and what it printed."""

    code: int
    out: str
    err: str


@pytest.fixture
def equigap(capsys: pytest.CaptureFixture[str]) -> Callable[..., Said]:
    """Run a command."""

    def run(*words: object) -> Said:
        code = cli.main([str(word) for word in words])
        return Said(code, *capsys.readouterr())

    return run


@pytest.fixture
def refused(equigap: Callable[..., Said], tmp_path: Path) -> Callable[..., None]:
    """Run a command with the output folder `out`: it ends with code 2 and a line that has `key` in it, and makes no folder."""

    def run(*words: object, key: str, output: Path = tmp_path / "out") -> None:
        before = output.exists()
        said = equigap(*words, "-o", output)
        assert said.code == 2
        last = said.err.splitlines()[-1]
        assert last.startswith("equigap: error: ") and key in last, said.err
        assert output.exists() == before

    return run
