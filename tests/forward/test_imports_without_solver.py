"""What the package names can be had without DOLFINx, as its docstring says."""

from __future__ import annotations

import subprocess
import sys


def test_the_solver_is_not_imported_by_who_does_not_solve():
    """A calibration has the materials of the package. The solver takes the better part of a second, and need not be there."""
    code = "import sys, forward, studies.commands.calibrate; raise SystemExit('dolfinx' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
