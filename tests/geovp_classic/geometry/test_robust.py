"""Robust fits: a line among outliers, and the values of the weight functions."""

import numpy as np

from geovp_classic.geometry import robust


def test_weights_at_zero_and_at_the_scale() -> None:
    residual = np.array([0.0, 2.0, -2.0])
    assert robust.cauchy_weight(residual, 2.0).tolist() == [1.0, 0.5, 0.5]
    assert robust.geman_mcclure_weight(residual, 2.0).tolist() == [1.0, 0.25, 0.25]


def test_a_line_is_found_among_outliers() -> None:
    """Y = 2 x + 1 with noise 0.01; a fifth of the points is 10 too high."""
    rng = np.random.default_rng(0)
    x = np.linspace(0, 1, 100)
    y = 2 * x + 1 + rng.normal(0, 0.01, 100)
    y[::5] += 10
    jacobian = np.stack([x, np.ones(100)], axis=1)
    line = robust.irls(
        np.zeros(2),
        linearise=lambda line: (jacobian @ line - y, jacobian),
        retract=lambda line, step: line + step,
        scale=lambda residual: max(0.02, float(np.median(np.abs(residual)))),
        num_rounds=30,
    )
    np.testing.assert_allclose(line, [2, 1], atol=0.02)
