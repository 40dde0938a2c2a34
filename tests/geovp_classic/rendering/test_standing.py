"""Where a camera stands, uncropped frames are as good as the crop: the last one, bit by bit."""

from dataclasses import replace

import numpy as np
import pytest

from geovp_classic import registry
from geovp_classic.geometry import se3
from geovp_classic.renderers.depth_fusion import DepthFusion
from geovp_classic.rendering import patches
from geovp_classic.rendering.standing import StandingScene
from geovp_classic.types import PrivilegedInput, Views

GRANT = PrivilegedInput.PAST_POSES | PrivilegedInput.FULL_FRAMES


@pytest.mark.parametrize(
    "late_s", [0.0, 0.03]
)  # poses may be stamped by another clock than the frames
def test_a_wide_view_from_the_last_pose_is_the_last_frame_and_only_there(late_s: float) -> None:
    clip = registry.build(
        "datasets", {"name": "synthetic", "num_frames": 12, "size_px": [64, 64], "with_full": True}
    )[0]
    context, _ = clip.split(10, GRANT)
    past = replace(clip.trajectory[:10], times_s=clip.times_s[:10] + late_s)
    renderer = DepthFusion(frames="full", dynamic_objects=None, exposure=None)
    moved = past.world_from_cam[-1] @ se3.exp(
        np.array([[0, 0, 1e-5, 0, 0, 0], [0, 0, 0.5, 0, 0, 0]])
    )
    views = renderer.reconstruct(context.only(renderer.needs), past).view(
        moved, np.zeros(2) + 2, clip.intrinsics
    )
    np.testing.assert_array_equal(views.frames[0], context.frames[-1])
    assert views.covered[0].all()
    assert (views.frames[1] != context.frames[-1]).mean() > 0.2


def test_another_camera_at_the_same_place_sees_the_scene() -> None:
    clip = registry.build("datasets", {"name": "synthetic", "num_frames": 2, "size_px": [32, 32]})[
        0
    ]

    class Empty:
        def view(
            self, world_from_cam: np.ndarray, times_s: np.ndarray, intrinsics: object
        ) -> Views:
            size = (len(world_from_cam), 16, 16)
            return Views(
                np.zeros((*size, 3), np.uint8), np.zeros(size, bool), np.zeros(size, np.float32)
            )

    last = patches.Source(clip.frames[-1], clip.intrinsics, np.eye(4))
    views = StandingScene(Empty(), last, 1.0).view(
        np.eye(4)[None], np.zeros(1), clip.intrinsics.resized(16, 16)
    )
    assert not views.frames.any()
