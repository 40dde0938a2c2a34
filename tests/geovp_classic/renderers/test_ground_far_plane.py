"""The ground and far plane on a plain under the sky, whose views are known exactly."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from geovp_classic.errors import Incompatible
from geovp_classic.geometry import planar, se3
from geovp_classic.inpainters.blank import Blank
from geovp_classic.inpainters.nearest_background import NearestBackground
from geovp_classic.renderers.ground_far_plane import GroundFarPlane
from geovp_classic.types import Clip, FloatArray, Intrinsics, PrivilegedInput, Views

NUM_PAST = 8


def predict(clip: Clip, renderer: GroundFarPlane) -> Views:
    context, target = clip.split(NUM_PAST, renderer.needs)
    scene = renderer.reconstruct(context, clip.trajectory[:NUM_PAST])
    future = target.trajectory.world_from_cam
    return scene.view(future, np.zeros(len(future)), clip.intrinsics)


def max_error(views: Views, clip: Clip, beyond_m: float = 10.0) -> float:
    """Return the maximum error on covered near ground, and on sky away from the horizon.

    Four pixels of the horizon are left out: so far reaches Lanczos' kernel.
    """
    depths = clip.depths[NUM_PAST:]
    sky = ndimage.binary_erosion(np.isinf(depths), np.ones((1, 9, 9)))
    counts = views.covered & ((depths < beyond_m) | sky)
    assert counts.mean() > 0.5
    return float(np.abs(views.frames.astype(float) - clip.frames[NUM_PAST:])[counts].max())


@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(0.0, 0.0), (-6.0, 0.0), (4.0, 5.0)])
def test_a_world_of_plain_and_sky_is_reproduced(
    plain: Any, camera: Intrinsics, drive: FloatArray, pitch_deg: float, roll_deg: float
) -> None:
    mounting = planar.level_vehicle_from_cam(np.deg2rad(pitch_deg), np.deg2rad(roll_deg))
    clip = plain.clip(drive @ mounting, camera)
    for renderer in (
        GroundFarPlane(pitch_deg=pitch_deg, roll_deg=roll_deg),
        GroundFarPlane(roll_deg=roll_deg),  # pitch from the direction of travel
    ):
        assert max_error(predict(clip, renderer), clip) < 5


def test_pitch_is_also_estimated_while_backing_up(
    plain: Any, camera: Intrinsics, drive: FloatArray
) -> None:
    mounting = planar.level_vehicle_from_cam(np.deg2rad(-6.0))
    clip = plain.clip(drive[::-1] @ mounting, camera)
    assert max_error(predict(clip, GroundFarPlane()), clip) < 5


def test_depths_are_those_of_the_plain_and_the_sky(
    plain: Any, camera: Intrinsics, drive: FloatArray
) -> None:
    clip = plain.clip(drive, camera)
    views = predict(clip, GroundFarPlane())
    np.testing.assert_allclose(
        views.depths[views.covered], clip.depths[NUM_PAST:][views.covered], rtol=1e-4
    )
    assert np.isinf(views.depths).any()
    assert (views.depths[~views.covered] == 0).all()


def test_a_stationary_camera_sees_the_last_frame(plain: Any, camera: Intrinsics) -> None:
    clip = plain.clip(np.tile(np.eye(4), (10, 1, 1)), camera)
    views = predict(clip, GroundFarPlane())
    assert views.covered.all()
    np.testing.assert_array_equal(views.frames, clip.frames[NUM_PAST:])


def test_turning_away_uncovers_pixels_that_are_inpainted(plain: Any, camera: Intrinsics) -> None:
    turn = se3.exp(
        np.outer(np.r_[np.zeros(8), [0.2, 0.5, 1.5, 3.0]], [0.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    )
    clip = plain.clip(turn, camera)
    blank = predict(clip, GroundFarPlane(inpainter=Blank()))
    inpainted = predict(clip, GroundFarPlane(inpainter=NearestBackground()))
    covered = blank.covered
    fractions = covered.mean(axis=(1, 2))
    assert 0.7 < fractions[0] < 0.9
    assert fractions[2] == fractions[3] == 0  # 86 degrees, and looking back
    assert (blank.frames[~covered] == 0).all()
    np.testing.assert_array_equal(inpainted.covered, covered)
    np.testing.assert_array_equal(inpainted.frames[covered], blank.frames[covered])
    assert (inpainted.frames[0][~covered[0]] > 0).any(axis=-1).mean() > 0.9


def test_a_camera_below_the_ground_sees_the_sky_only(
    plain: Any, camera: Intrinsics, drive: FloatArray
) -> None:
    clip = plain.clip(drive, camera)
    context, _ = clip.split(NUM_PAST, PrivilegedInput.CAMERA_HEIGHT)
    scene = GroundFarPlane(pitch_deg=0.0).reconstruct(context, clip.trajectory[:NUM_PAST])
    sunken = scene.last.world_from_source @ se3.exp(np.array([0.0, 2.0, 0.0, 0.0, 0.0, 0.0]))
    views = scene.view(sunken[None], np.zeros(1), camera)
    assert not views.covered[0, 61:].any()
    assert views.covered[0, :60].all()


def test_missing_inputs_are_refused(plain: Any, camera: Intrinsics, drive: FloatArray) -> None:
    clip = plain.clip(drive, camera)
    context, _ = clip.split(NUM_PAST, PrivilegedInput.CAMERA_HEIGHT)
    past = clip.trajectory[:NUM_PAST]
    with pytest.raises(Incompatible, match="set camera_height_m"):
        GroundFarPlane().reconstruct(replace(context, camera_height_m=None), past)
    with pytest.raises(Incompatible, match="give the odometry a scale"):
        GroundFarPlane().reconstruct(context, replace(past, is_metric=False))
