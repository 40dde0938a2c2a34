"""Depth fusion of the synthetic street, with a car that drives off in front."""

import numpy as np

from geovp_classic import registry
from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.depth.multiview import Multiview
from geovp_classic.depth.stereo import Stereo
from geovp_classic.renderers.depth_fusion import DepthFusion
from geovp_classic.types import Clip, Context, PrivilegedInput, Trajectory


def street(index: int) -> tuple[Clip, Context, Trajectory]:
    clip = Synthetic(seed=0, num_frames=13, num_clips=6, size_px=(128, 128))[index]
    context, _ = clip.split(10, PrivilegedInput.NONE)
    assert clip.trajectory is not None
    return clip, context, clip.trajectory[:10]


def test_all_settings_have_defaults() -> None:
    assert registry.build("renderers", {"name": "depth-fusion"}) == DepthFusion(Multiview())
    assert DepthFusion().needs == PrivilegedInput.NONE
    assert DepthFusion(Stereo()).needs == PrivilegedInput.RIGHT_FRAMES


def test_nested_settings_are_built_from_tables() -> None:
    table = {
        "name": "depth-fusion",
        "detail": "none",
        "dynamic_objects": {"velocity": {"grey_scale": 4.0}, "min_speed_hz": 1.0},
        "exposure": {"inertia_s": 0.2},
    }
    renderer = registry.build("renderers", table)
    assert renderer.detail is None
    assert renderer.dynamic_objects.velocity.grey_scale == 4.0
    assert renderer.exposure.inertia_s == 0.2
    assert registry.build("renderers", registry.describe(renderer)) == renderer


def test_a_moving_car_is_masked_and_moved() -> None:
    clip, context, past = street(5)
    (car,) = DepthFusion().sprites(context, past)
    true = clip.moving[9]
    overlap = (car.mask & true).sum()
    assert overlap / car.mask.sum() > 0.65  # measured: 575 of 806 detected pixels
    assert overlap / true.sum() > 0.4  # of 1214, shadow included

    def moving_error(renderer: DepthFusion) -> float:
        scene = renderer.reconstruct(context, past)
        poses = clip.trajectory.world_from_cam[10:]
        views = scene.view(poses, clip.times_s[10:], clip.intrinsics)
        difference = np.abs(views.frames.astype(float) - clip.frames[10:])
        return float(difference[clip.moving[10:]].mean())

    assert moving_error(DepthFusion()) < moving_error(DepthFusion(dynamic_objects=None))


def test_a_change_of_exposure_moves_nothing() -> None:
    for index, num_objects in ((0, 0), (5, 1)):
        _, context, past = street(index)
        gains = np.linspace(0.8, 1.0, 10)[:, None, None, None]
        darker = (gains * context.frames).astype(np.uint8)
        changed = Context(darker, context.times_s, context.intrinsics)
        assert len(DepthFusion().sprites(changed, past)) == num_objects


def test_the_last_pose_shows_the_last_frame() -> None:
    for index in (0, 5):  # without and with a moving car
        clip, context, past = street(index)
        scene = DepthFusion().reconstruct(context, past)
        views = scene.view(past.world_from_cam[-1:], past.times_s[-1:], clip.intrinsics)
        assert np.abs(views.frames[0].astype(int) - context.frames[-1]).max() <= 1
