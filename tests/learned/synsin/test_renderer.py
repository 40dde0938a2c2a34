from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from geovp_classic.geometry import se3
from geovp_classic.types import Clip, FloatArray, PrivilegedInput, Views
from geovp_learned import checkpoints
from geovp_learned.synsin.renderer import SynSin
from geovp_learned.synsin.train import SynSinTraining

NUM_PAST = 6


@pytest.fixture(scope="module")
def wall(method: SynSinTraining, clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Weights of a new network that sees everything .2 units, that is 10 m, away."""
    torch.manual_seed(0)
    method = replace(method, architecture=replace(method.architecture, depth_range=(0.2, 0.2)))
    file = tmp_path_factory.mktemp("weights") / "wall.safetensors"
    checkpoints.write(file, "synsin", method, method.build(), {})
    return file


def views_of(file: Path, clip: Clip, world_from_cam: FloatArray) -> Views:
    """The last of the past frames, rendered from the poses."""
    context, _ = clip.split(NUM_PAST, PrivilegedInput.NONE)
    scene = SynSin(file).reconstruct(context, clip.trajectory[:NUM_PAST])
    return scene.view(world_from_cam, clip.times_s[-len(world_from_cam) :], clip.intrinsics)


def test_two_metres_ahead_a_wall_at_ten_is_at_eight(wall: Path, clip: Clip) -> None:
    last = clip.trajectory.world_from_cam[NUM_PAST - 1]
    ahead = last @ se3.exp(np.array([0, 0, 2.0, 0, 0, 0]))
    views = views_of(wall, clip, np.stack([last, ahead]))
    assert views.frames.shape == (2, 32, 32, 3)
    # The authors' grid shifts points by up to half a pixel, here the radius of a point
    assert views.covered[0, 8:24, 8:24].all()
    for depths, covered, distance_m in zip(views.depths, views.covered, (10, 8), strict=True):
        assert covered.mean() > 0.3
        np.testing.assert_allclose(depths[covered], distance_m, rtol=1e-4)
        assert not depths[~covered].any()
