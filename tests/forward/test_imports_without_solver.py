"""What the package names can be had without DOLFINx, as its docstring says."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize("name", ["forward", "studies.commands.calibrate"])
def test_the_solver_is_not_imported_by_who_does_not_solve(name):
    """It takes the better part of a second, and need not be there."""
    code = f"import sys, {name}; raise SystemExit('dolfinx' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
