"""Renderers that begin with a depth source: what they ask for, and what they do with poses that
images contradict.
"""

import numpy as np

from geovp_classic import registry
from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.depth.multiview import Multiview
from geovp_classic.depth.stereo import Stereo
from geovp_classic.renderers.depth_fusion import DepthFusion
from geovp_classic.types import PrivilegedInput


def test_no_field_is_needed() -> None:
    assert registry.build("renderers", {"name": "depth-fusion"}) == DepthFusion(Multiview())
    assert DepthFusion().needs == PrivilegedInput.NONE
    assert DepthFusion(Stereo()).needs == PrivilegedInput.RIGHT_FRAMES


def test_a_car_goes_on_where_the_street_stays() -> None:
    # The synthetic street at 128 pixels: a car in front drives off, its mask is known.
    clip = Synthetic(seed=0, num_frames=13, num_clips=6, size_px=(128, 128))[5]
    context, target = clip.split(10, PrivilegedInput.NONE)
    past, future = clip.trajectory[:10], clip.trajectory.world_from_cam[10:]
    renderers = DepthFusion(), DepthFusion(dynamic_objects=None)
    (car,) = renderers[0].sprites(context, past)
    found, true = car.mask, clip.moving[9]
    assert (found & true).sum() / found.sum() > 0.65  # measured: 575 of 806 pixels found
    assert (found & true).sum() / true.sum() > 0.4  # of 1214, shadow included
    errors = [
        np.abs(
            one.reconstruct(context, past)
            .view(future, clip.times_s[10:], clip.intrinsics)
            .frames.astype(float)
            - target.frames
        )[clip.moving[10:]].mean()
        for one in renderers
    ]
    assert errors[0] < errors[1]


def test_the_last_observed_frame_is_seen_again_to_the_bit() -> None:
    # With and without a car that moves: at the last pose and time everything is where it was.
    for number in (0, 5):
        clip = Synthetic(seed=0, num_frames=13, num_clips=6, size_px=(128, 128))[number]
        context, _ = clip.split(10, PrivilegedInput.NONE)
        scene = DepthFusion().reconstruct(context, clip.trajectory[:10])
        views = scene.view(
            clip.trajectory.world_from_cam[9:10], clip.times_s[9:10], clip.intrinsics
        )
        np.testing.assert_array_equal(views.frames[0], context.frames[-1])
