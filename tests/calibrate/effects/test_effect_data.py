"""Operators as stencils of equal width: what they do is unchanged."""

import numpy as np
import scipy.sparse as sp

from calibrate.effects.support.effect_data import padded


def test_a_stencil_does_what_its_operator_does_where_zeros_are_stored():
    """Sums of neighbours may cancel exactly and stay in a sparse array; in both directions at once they have no place in the stencil."""
    rng = np.random.default_rng(0)
    dense = rng.standard_normal((40, 30)) * (rng.uniform(size=(40, 30)) < 0.4)
    stored = sp.coo_array(dense)
    rows, columns = np.divmod(np.arange(40 * 30), 30)
    operator = sp.csr_array(
        (np.append(stored.data, 0.0 * rows), (np.append(stored.row, rows), np.append(stored.col, columns)))
    )
    assert operator.nnz == 40 * 30
    nodes, weights = padded(operator)
    u = rng.standard_normal(30)
    found = np.einsum("mkj,mk->mj", weights, u[nodes])
    np.testing.assert_allclose(found.ravel(), operator @ u, atol=1e-12)
