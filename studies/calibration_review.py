"""What a calibration explains and what it leaves: the numbers behind its report.

In: a Calibration and the whole Experiment, of which some increments may have been held out. Out: `Review` with
predicted forces, residuals of every virtual-work equation and, where the noise is known, how large they should
be; tables and plain-language remarks made from them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from calibrate import noise_model, pann, reduction
from calibrate.basis import Basis, basis_for
from calibrate.calibration import Calibration, predict_forces
from calibrate.equilibrium import Equilibrium, best_shear_modulus_and_forces, equilibrium
from calibrate.experiment import Experiment
from calibrate.kinematics import invariants_and_derivatives, stretches_to_gradient
from calibrate.model import Model

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]
MODES = {"uniaxial": "uniaxial", "equibiaxial": "equi-biaxial", "pure_shear": "pure shear"}
COMPONENTS = ("x", "y")
