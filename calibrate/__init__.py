"""Identify hyperelastic models from surface displacements and reaction forces by the equilibrium gap.

The path of the data: ``experiment`` (what was measured) -> ``kinematics`` (deformation gradient, invariants)
-> ``virtual_fields`` (test functions) -> ``equilibrium`` (linear system in the energy derivatives)
-> ``noise_model`` (noise) -> ``reduction`` (small quadratic form) -> ``fit`` (convex first fit, PANN)
-> ``model`` (file that `forward` and `studies` read).

Everything is float64: importing this package switches JAX to 64 bit, as a fit in single precision is wrong.
"""

import jax

jax.config.update("jax_enable_x64", True)
