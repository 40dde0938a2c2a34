"""Alignment of relative depth, and its fusion with a plane sweep."""

from dataclasses import dataclass

import numpy as np
import pytest
import street

from geovp_classic.depth.hybrid import Hybrid
from geovp_classic.depth.relative_depth import DepthAlignment
from geovp_classic.types import Context, FloatArray, PrivilegedInput, Trajectory

CLIP = street.clip()
CONTEXT, _ = CLIP.split(6, PrivilegedInput.NONE)
PAST = CLIP.trajectory[:6]


@dataclass(frozen=True)
class Maps:
    """Inverse depth of all pixels, with confidences by column."""

    inverse_depth: float
    confidence: tuple[float, ...]
    needs = PrivilegedInput.NONE

    def inverse_depths(self, context: Context, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        shape = (*context.frames.shape[:2], len(self.confidence))
        return np.full(shape, self.inverse_depth), np.broadcast_to(self.confidence, shape)


def test_scale_and_shift_are_robust() -> None:
    rng = np.random.default_rng(0)
    relative = rng.uniform(10, 20, 1000)
    reference = 0.02 * relative - 0.1 + rng.normal(0, 0.001, 1000)
    reference[:300] = rng.uniform(0, 0.3, 300)
    scale, shift = DepthAlignment().fit(relative, reference)
    assert scale == pytest.approx(0.02, rel=0.01)
    assert shift == pytest.approx(-0.1, rel=0.04)


def test_maps_that_contradict_the_plane_sweep_are_not_aligned() -> None:
    relative = np.linspace(0, 1, 1000)
    assert DepthAlignment().fit(relative, 1 - relative) is None
    upside_down = CLIP.depths[:6]  # depth instead of inverse depth
    _, confidence = DepthAlignment().align(np.minimum(upside_down, 50), CONTEXT, PAST)
    assert (confidence == 0).all()


def test_the_plane_sweep_decides_where_it_is_confident() -> None:
    """Where the other source is unknown, in the last column, the plane sweep's guess remains."""
    sweep = Maps(0.2, (1.0, 0.5, 0.25, 0.0, 0.0))
    other = Maps(0.4, (1.0, 1.0, 1.0, 1.0, 0.0))
    inverse_depths, confidence = Hybrid(other, sweep, 0.5, 0).inverse_depths(CONTEXT, PAST)
    np.testing.assert_allclose(inverse_depths[0, 0], [0.2, 0.2, 0.3, 0.4, 0.2], rtol=1e-6)
    assert confidence[0, 0].tolist() == [1, 1, 1, 1, 0]


def test_the_other_source_is_corrected_near_the_plane_sweep() -> None:
    """The plane sweep knows the left half: the other source is right beside it, and free far away.

    At three standard deviations, a Gaussian has 0.00135 of its mass beyond the border.
    """
    sweep = Maps(0.2, (1.0,) * 64 + (0.0,) * 64)
    other = Maps(0.4, (1.0,) * 128)
    inverse_depths, _ = Hybrid(other, sweep).inverse_depths(CONTEXT, PAST)
    row = inverse_depths[-1, 64]
    np.testing.assert_allclose(row[:72], 0.2, atol=1e-6)
    assert row[64 + 24] == pytest.approx(0.4 - 0.2 * 0.00135 / 0.05, abs=2e-3)
    np.testing.assert_allclose(row[110:], 0.4, atol=1e-6)
