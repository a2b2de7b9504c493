"""Identify hyperelastic models from surface displacements and reaction forces by the equilibrium gap.

The path of the data: ``data`` (what was measured) -> ``equations`` (kinematics, virtual fields, equilibrium, weights by the
noise, a small quadratic form) -> ``effects`` (what a sheet and its measurement may do besides) -> ``models`` (energies and
their files) -> ``fitting`` (network, supervised fit, uncertainty) -> ``diagnosis`` (which effects the data ask for). Each
imports only those before it.

Everything is float64: importing this package switches JAX to 64 bit, as a fit in single precision is wrong.
"""

import warnings

import jax

jax.config.update("jax_enable_x64", True)
# a file that another process is writing, or that a killed one left, is compiled again
warnings.filterwarnings("ignore", "Error reading persistent compilation cache entry", UserWarning)
