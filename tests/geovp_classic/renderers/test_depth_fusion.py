"""Depth fusion of the synthetic street: its settings, and the view from the last pose."""

import numpy as np

from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.renderers.depth_fusion import DepthFusion
from geovp_classic.types import Clip, Context, PrivilegedInput, Trajectory


def street(index: int) -> tuple[Clip, Context, Trajectory]:
    clip = Synthetic(seed=0, num_frames=13, num_clips=6, size_px=(128, 128))[index]
    context, _ = clip.split(10, PrivilegedInput.NONE)
    return clip, context, clip.trajectory[:10]


def test_the_last_pose_shows_the_last_frame() -> None:
    for index in (0, 5):  # without and with a moving car
        clip, context, past = street(index)
        scene = DepthFusion().reconstruct(context, past)
        views = scene.view(past.world_from_cam[-1:], past.times_s[-1:], clip.intrinsics)
        assert np.abs(views.frames[0].astype(int) - context.frames[-1]).max() <= 1
