"""Sparsity of a matrix with 3 x 3 blocks, of which only the upper triangle is stored: hexes' nodes in, rows out."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from forward.errors import LinearSolverError

CHUNK = 256  # hexes looked up at a time


def block_pattern(dofs: NDArray[np.int32], n: int) -> sp.csr_matrix:
    """Upper triangle (n, n) of which blocks share a hex; columns sorted, the diagonal always there."""
    rows = np.repeat(np.arange(len(dofs)), dofs.shape[1])
    touches = sp.csr_matrix((np.ones(dofs.size, np.int32), (rows, dofs.ravel())), (len(dofs), n))
    pattern = sp.triu(touches.T @ touches, format="csr")
    pattern.sort_indices()
    return pattern


def block_places(blocks: sp.csr_matrix, dofs: NDArray[np.int32]) -> NDArray[np.int32]:
    """(m, 27, 27): place of the pair's block in the block row of the smaller one."""
    n = blocks.shape[0]
    keys = np.repeat(np.arange(n, dtype=np.int64), np.diff(blocks.indptr)) * n + blocks.indices
    places = np.empty((len(dofs), dofs.shape[1], dofs.shape[1]), np.int32)
    for first in range(0, len(dofs), CHUNK):
        cells = dofs[first : first + CHUNK].astype(np.int64)
        low = np.minimum(cells[:, :, None], cells[:, None, :])
        high = np.maximum(cells[:, :, None], cells[:, None, :])
        places[first : first + CHUNK] = np.searchsorted(keys, low * n + high) - blocks.indptr[low]
    return places


def scalar_pattern(blocks: sp.csr_matrix) -> sp.csr_matrix:
    """Upper triangle of the matrix with 3 x 3 blocks."""
    n = blocks.shape[0]
    lengths = np.diff(blocks.indptr)
    row_lengths = (3 * lengths[:, None] - np.arange(3)).ravel()
    indptr = np.concatenate([[0], np.cumsum(row_lengths)])
    if indptr[-1] >= 2**31:
        raise LinearSolverError(
            f"{indptr[-1]} entries are more than PARDISO's 32-bit numbers hold; use MUMPS on more ranks"
        )
    columns = (3 * blocks.indices[:, None] + np.arange(3)).astype(np.int32)
    indices = np.empty(indptr[-1], np.int32)
    for i in range(3):
        keep = np.ones(columns.shape, bool)
        keep[blocks.indptr[:-1], :i] = False
        owner = np.repeat(np.arange(n), 3 * lengths)[keep.ravel()]
        starts = indptr[3 * owner + i]
        within = np.arange(len(owner)) - np.repeat(np.cumsum(row_lengths[i::3]) - row_lengths[i::3], row_lengths[i::3])
        indices[starts + within] = columns.ravel()[keep.ravel()]
    return sp.csr_matrix((np.zeros(indptr[-1]), indices, indptr.astype(np.int32)), (3 * n, 3 * n))
