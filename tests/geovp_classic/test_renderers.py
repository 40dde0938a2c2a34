"""Renderers that begin with a depth source: what they ask for, and what they do with poses that images contradict."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from geovp_classic import registry
from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.depth.multiview import Multiview
from geovp_classic.depth.stereo import Stereo
from geovp_classic.dynamic_objects.sprites import Traffic
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole, se3
from geovp_classic.geometry.ground_plane import Ground
from geovp_classic.pose_refinement.nonholonomic import Course
from geovp_classic.pose_refinement.road_height import BELIEF, RoadAhead
from geovp_classic.pose_refinement.rotation_drift import Drift
from geovp_classic.render.exposure import Exposed
from geovp_classic.renderers import DepthFusion, Steered
from geovp_classic.types import FloatArray, Grant, Intrinsics, Views

CAMERA = Intrinsics(60, 60, 31.5, 23.5, 64, 48)


@dataclass
class Recording:
    """A scene that notes where it was seen from."""

    asked: list[FloatArray] = field(default_factory=list)

    def view(self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics) -> Views:
        self.asked.append(world_from_cam)
        count = len(world_from_cam)
        nothing = np.zeros((count, 48, 64))
        return Views(np.zeros((count, 48, 64, 3), np.uint8), nothing > 0, nothing.astype(np.float32))


def test_no_field_is_needed() -> None:
    assert registry.build("renderers", {"name": "depth-fusion"}) == DepthFusion(Multiview())
    assert DepthFusion().needs == Grant.NONE
    assert DepthFusion(Stereo()).needs == Grant.RIGHT_FRAMES


def test_a_car_goes_on_where_the_street_stays() -> None:
    # The synthetic street at 128 pixels: a car in front drives off, its mask is known.
    clip = Synthetic(seed=0, num_frames=13, num_clips=6, size_px=(128, 128))[5]
    assert clip.trajectory is not None
    assert clip.moving is not None
    context, target = clip.split(10, Grant.NONE)
    past, future = clip.trajectory[:10], clip.trajectory.world_from_cam[10:]
    carried, ignored = (DepthFusion(moving=way).reconstruct(context, past) for way in ("carried", "ignored"))
    assert isinstance(carried, Steered)
    assert isinstance(carried.scene, Exposed)
    assert isinstance(carried.scene.scene, Traffic)
    (car,) = carried.scene.scene.billboards
    found, true = car.mask, clip.moving[9]
    assert (found & true).sum() / found.sum() > 0.65  # measured: 575 of 806 pixels found
    assert (found & true).sum() / true.sum() > 0.4  # of 1214, shadow included
    errors = [
        np.abs(scene.view(future, clip.intrinsics).frames.astype(float) - target.frames)[clip.moving[10:]].mean()
        for scene in (carried, ignored)
    ]
    assert errors[0] < errors[1]


def test_ways_to_treat_moving_things_that_do_not_exist_are_refused() -> None:
    with pytest.raises(BadData, match="expected 'carried' or 'ignored'"):
        DepthFusion(moving="banned")  # type: ignore[arg-type]


def test_samples_are_counted_from_one() -> None:
    with pytest.raises(BadData, match="samples is 0, expected 1 or more"):
        DepthFusion(samples=0)


def test_views_of_more_samples_are_of_the_size_asked_for_and_alike() -> None:
    clip = Synthetic(seed=0, num_frames=12, num_clips=1, size_px=(64, 64))[0]
    assert clip.trajectory is not None
    context, _ = clip.split(10, Grant.NONE)
    future = clip.trajectory.world_from_cam[10:]
    one, four = (
        DepthFusion(samples=count).reconstruct(context, clip.trajectory[:10]).view(future, clip.intrinsics)
        for count in (1, 2)
    )
    assert four.frames.shape == one.frames.shape
    assert 0 < np.abs(four.frames.astype(float) - one.frames).mean() < 10


def steered(
    scene: Recording,
    world_from_reference: FloatArray,
    errors: Drift | None = None,
    steering: FloatArray | None = None,
    way: Course | None = None,
    road: RoadAhead | None = None,
) -> Steered:
    """A scene at 10 Hz for which nothing is mended but what is named."""
    seconds = np.arange(1, 21) * 0.1
    steering = np.eye(3) if steering is None else steering
    return Steered(scene, world_from_reference, seconds, errors, steering, way, road)


def test_translations_are_turned_and_rotations_kept() -> None:
    scene = Recording()
    world_from_reference = se3.exp(np.array([3.0, 0, 5, 0, 0.4, 0]))
    quarter = se3.exp(np.array([0, 0, 0, 0, np.pi / 2, 0]))[:3, :3]  # z to x
    ahead = se3.exp(np.array([[0, 0, 2.0, 0, 0, 0], [0, 0, 2.0, 0, 0.1, 0]]))
    steered(scene, world_from_reference, steering=quarter).view(world_from_reference @ ahead, CAMERA)
    seen = se3.inverse(world_from_reference) @ scene.asked[0]
    np.testing.assert_allclose(seen[0, :3, 3], [2, 0, 0], atol=1e-12)
    np.testing.assert_allclose(seen[:, :3, :3], ahead[:, :3, :3], atol=1e-12)


def test_poses_are_held_to_the_vehicles_course_where_there_is_one() -> None:
    scene = Recording()
    world_from_reference = se3.exp(np.array([3.0, 0, 5, 0, 0.4, 0]))
    sinking = se3.exp(np.array([[0, 0.02, 2.0, 0, 0, 0], [0, 0.04, 4.0, 0, 0, 0]]))
    level = Course(np.array([0, 0, 1.0]), given_rad=0.02, held_rad=0.0)
    steered(scene, world_from_reference, way=level).view(world_from_reference @ sinking, CAMERA)
    seen = se3.inverse(world_from_reference) @ scene.asked[0]
    np.testing.assert_allclose(seen[:, :3, 3], [[0, 0, 2], [0, 0, 4]], atol=1e-3)


def test_what_is_not_to_be_mended_stays() -> None:
    clip = Synthetic(seed=0, num_frames=12, num_clips=1, size_px=(64, 64))[0]
    assert clip.trajectory is not None
    context, _ = clip.split(10, Grant.NONE)
    past = clip.trajectory[:10]
    scene = DepthFusion().reconstruct(context, past)
    assert isinstance(scene, Steered)
    assert scene.errors is not None
    assert scene.road is not None
    plain = DepthFusion(with_drift=False, with_road_ahead=False).reconstruct(context, past)
    assert isinstance(plain, Steered)
    assert (plain.errors, plain.road) == (None, None)


def test_poses_are_carried_by_the_road_and_lose_the_drift_to_be_expected() -> None:
    scene = Recording()
    world_from_reference = se3.exp(np.array([3.0, 0, 5, 0, 0.4, 0]))
    rising = se3.exp(np.arange(1, 13)[:, None] * np.array([0, -0.01, 1.0, 0, 0, 0]))
    rays = pinhole.rays(CAMERA)
    road = RoadAhead.seen(np.maximum(rays[..., 1] / 1.65, 0), CAMERA, Ground(np.array([0, 1.0, 0]), 1.65))
    given = se3.exp(np.arange(-9, 1)[:, None] * np.array([0, -0.01, 1.0, 0, 0, 0]))
    seen = np.concatenate([se3.turned(given[:-1], np.tile([0.001, 0, 0], (9, 1))), given[-1:]])
    too_low = Drift(given, seen, np.arange(-9, 1) * 0.1, is_metric=False)
    steered(scene, world_from_reference, errors=too_low, road=road).view(world_from_reference @ rising, CAMERA)
    seen = se3.inverse(world_from_reference) @ scene.asked[0]
    np.testing.assert_allclose(seen[-1, :3, 3], [0, -0.12 * (1 - BELIEF), 12], atol=0.01)
    turned = se3.log(seen)[:, 3]
    assert (turned > 1e-4).all()
    assert (turned < 1e-3).all()
