"""Alignment of relative depth with multi-view depth."""

import numpy as np
import pytest
import street

from geovp_classic.depth.relative_depth import DepthAlignment
from geovp_classic.types import PrivilegedInput

CLIP = street.clip()
CONTEXT, _ = CLIP.split(6, PrivilegedInput.NONE)
PAST = CLIP.trajectory[:6]


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
