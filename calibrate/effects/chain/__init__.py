"""The chain from measured displacements and forces to the residual of the virtual-work equations, with effects in it.

`link`: one link, applied and differentiated. `linearisation`: links one after another. `links_of_motion`, `links_of_stress`: which there
are; `quantities`: what passes between them. `stages`: in which order. `composition`: the chain of an Experiment. `noise_spread`: what noise of the displacements does to it.
"""

from calibrate.effects.chain.addition import Addition, Additions, ordered
from calibrate.effects.chain.composition import Chain

__all__ = ["Addition", "Additions", "Chain", "ordered"]
