"""While the camera is stationary, uncropped frames give the last frame itself."""

from dataclasses import replace

import numpy as np
import pytest

from geovp_classic import registry
from geovp_classic.geometry import se3
from geovp_classic.renderers.depth_fusion import DepthFusion
from geovp_classic.types import PrivilegedInput

NEEDS = PrivilegedInput.PAST_POSES | PrivilegedInput.FULL_FRAMES


@pytest.mark.parametrize("clock_offset_s", [0.0, 0.03])  # of the poses
def test_only_the_last_pose_shows_the_last_frame_itself(clock_offset_s: float) -> None:
    clip = registry.build(
        "datasets", {"name": "synthetic", "num_frames": 12, "size_px": [64, 64], "with_full": True}
    )[0]
    context, _ = clip.split(10, NEEDS)
    past = replace(clip.trajectory[:10], times_s=clip.times_s[:10] + clock_offset_s)
    renderer = DepthFusion(frames="full", exposure=None)
    scene = renderer.reconstruct(context.only(renderer.needs), past)
    steps = se3.exp(np.array([[0, 0, 1e-5, 0, 0, 0], [0, 0, 0.5, 0, 0, 0]]))
    poses = past.world_from_cam[-1] @ steps
    views = scene.view(poses, np.array([2.0, 2.0]), clip.intrinsics)
    np.testing.assert_array_equal(views.frames[0], context.frames[-1])
    assert views.covered[0].all()
    assert (views.frames[1] != context.frames[-1]).mean() > 0.2

    other_camera = clip.intrinsics.resized(32, 32)
    assert scene.view(poses, np.array([2.0, 2.0]), other_camera).frames.shape == (2, 32, 32, 3)
