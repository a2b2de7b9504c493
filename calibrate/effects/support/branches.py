"""Motion between pictures: a history in, its course a little before and after each picture out.

A history is smooth between the instants at which it turns, stops or changes its speed; parabolas are laid through three
pictures of such a branch (straight lines through two), and never across its ends. The test starts at rest at t = 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STRAIGHT = 0.7  # smallest cosine of successive steps on a branch
STEADY = 2.0  # largest ratio of their speeds
REST = 2e-3  # of the largest displacement: what has moved less since it turned has not turned


def motion(time: Array, u: Array) -> Array:
    """(2, 2, t, t), 1/s and 1/s^2: u(t_i + s) is u_i + s (M[b, 0] u)_i + s^2 (M[b, 1] u)_i on the branch after (b = 0)
    and before (b = 1) picture i. time (t,), s, rising; u (t, n, 2): displacements."""
    flat = np.asarray(u, float).reshape(len(time), -1)
    rest = time[0] > 0
    instants = np.concatenate([[0.0], time]) if rest else np.asarray(time, float)
    places = np.concatenate([np.zeros((1, flat.shape[1])), flat]) if rest else flat
    result = np.zeros((2, 2, len(instants), len(instants)))
    if len(instants) > 1:
        first, last = branches(instants, places)
        for i in range(len(instants)):
            for b, step in enumerate((min(i, len(first) - 1), max(i - 1, 0))):
                start = int(np.clip(i - 1, first[step], max(last[step] - 2, first[step])))
                near = np.arange(start, min(start + 2, last[step]) + 1)
                powers = (instants[near] - instants[i])[None, :] ** np.arange(len(near))[:, None]
                result[b, : len(near) - 1, i, near] = np.linalg.inv(powers)[:, 1:]
    return result[:, :, 1:, 1:] if rest else result


def sign_of_motion(u: Array) -> Array:
    """(t,): 1 where displacements u (t, n, 2), by their root mean square, grow on the way to an increment, -1 where they fall; at rest as before.

    They have turned where they are further than `REST` from the extreme since the turn before, however many increments that takes.
    """
    size = np.sqrt((np.asarray(u) ** 2).mean(axis=(1, 2)))
    found, sign, extreme = np.ones(len(size)), 1.0, 0.0
    for i, now in enumerate(size.tolist()):
        if sign * (extreme - now) > REST * size.max():
            sign = -sign
            extreme = now
        extreme = sign * max(sign * extreme, sign * now)
        found[i] = sign
    return found


def branches(instants: Array, places: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last instant (k - 1,) of the branch of each step between instants (k,); places (k, p)."""
    steps = np.diff(places, axis=0)
    size = np.linalg.norm(steps, axis=1)
    speed = size / np.diff(instants)
    product = (steps[1:] * steps[:-1]).sum(axis=1)
    smooth = product > STRAIGHT * size[1:] * size[:-1]
    smooth &= np.maximum(speed[1:], speed[:-1]) < STEADY * np.minimum(speed[1:], speed[:-1])
    starts = np.flatnonzero(np.concatenate([[True], ~smooth]))
    ends = np.concatenate([starts[1:], [len(steps)]])
    which = np.repeat(np.arange(len(starts)), ends - starts)
    return starts[which], ends[which]
