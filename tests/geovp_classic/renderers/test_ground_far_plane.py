"""The ground and far plane on a plain under the sky, whose views are known exactly."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from geovp_classic.errors import Incompatible
from geovp_classic.geometry import pinhole, planar, se3
from geovp_classic.inpainters.blank import Blank
from geovp_classic.inpainters.nearest_background import NearestBackground
from geovp_classic.renderers.ground_far_plane import GroundFarPlane
from geovp_classic.types import Clip, FloatArray, Intrinsics, PrivilegedInput, Trajectory, Views

NUM_PAST = 8
HEIGHT_M = 1.65
CAMERA = Intrinsics(120.0, 118.0, 63.0, 60.0, 128, 120)
# 12 poses: 0.3 m a step along the plain, turning right by 0.4 degrees a step.
DRIVE = se3.exp(np.outer(np.arange(12), [0.0, 0.0, 0.3, 0.0, np.deg2rad(0.4), 0.0]))


def draw(world_from_cam: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the image [H, W, 3] and z-depth [H, W] of a patterned plain and a patterned sky."""
    rays = pinhole.rays(CAMERA) @ world_from_cam[:3, :3].T
    origin = world_from_cam[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(rays[..., 1] > 0, (HEIGHT_M - origin[1]) / rays[..., 1], np.inf)
    is_plain = np.isfinite(depth)[..., None]
    x, _, z = np.moveaxis(origin + np.where(is_plain, depth[..., None], 0) * rays, -1, 0)
    direction = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    phases = np.array([0, 1, 2])
    sky = 128 + 60 * np.sin(12 * direction + phases)
    plain = 128 + 60 * np.sin(x[..., None] * 2 + phases) * np.cos(z[..., None])
    return np.where(is_plain, plain, sky), depth


def film(world_from_cam: FloatArray) -> Clip:
    """Return the world seen from every pose."""
    frames, depths = zip(*map(draw, world_from_cam), strict=True)
    times_s = 0.1 * np.arange(len(world_from_cam))
    return Clip(
        "plain",
        np.rint(frames).astype(np.uint8),
        times_s,
        CAMERA,
        Trajectory(world_from_cam, times_s, is_metric=True),
        np.asarray(depths, dtype=np.float32),
        camera_height_m=HEIGHT_M,
    )


def predict(clip: Clip, renderer: GroundFarPlane) -> Views:
    context, target = clip.split(NUM_PAST, renderer.needs)
    scene = renderer.reconstruct(context, clip.trajectory[:NUM_PAST])
    future = target.trajectory.world_from_cam
    return scene.view(future, np.zeros(len(future)), clip.intrinsics)


def max_error(views: Views, clip: Clip) -> float:
    """Return the maximum error on covered near ground, and on sky away from the horizon.

    Four pixels of the horizon are left out: so far reaches Lanczos' kernel.
    """
    depths = clip.depths[NUM_PAST:]
    sky = ndimage.binary_erosion(np.isinf(depths), np.ones((1, 9, 9)))
    counts = views.covered & ((depths < 10) | sky)
    assert counts.mean() > 0.5
    return float(np.abs(views.frames.astype(float) - clip.frames[NUM_PAST:])[counts].max())


@pytest.mark.parametrize("pitch_deg", [0.0, -6.0, 4.0])
def test_a_world_of_plain_and_sky_is_reproduced(pitch_deg: float) -> None:
    clip = film(DRIVE @ planar.level_vehicle_from_cam(np.deg2rad(pitch_deg)))
    assert max_error(predict(clip, GroundFarPlane()), clip) < 5


def test_turning_away_uncovers_pixels_that_are_inpainted() -> None:
    turn = se3.exp(
        np.outer(np.r_[np.zeros(8), [0.2, 0.5, 1.5, 3.0]], [0.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    )
    clip = film(turn)
    blank = predict(clip, GroundFarPlane(inpainter=Blank()))
    covered = blank.covered
    fractions = covered.mean(axis=(1, 2))
    assert 0.7 < fractions[0] < 0.9
    assert fractions[2] == fractions[3] == 0  # 86 degrees, and looking back
    assert (blank.frames[~covered] == 0).all()
    inpainted = predict(clip, GroundFarPlane(inpainter=NearestBackground()))
    assert (inpainted.frames[0][~covered[0]] > 0).any(axis=-1).mean() > 0.9


def test_a_camera_below_the_ground_sees_the_sky_only() -> None:
    sunken = DRIVE.copy()
    sunken[NUM_PAST:, 1, 3] = 2.0
    covered = predict(film(sunken), GroundFarPlane()).covered
    assert covered[:, :60].any()
    assert not covered[:, 61:].any()


def test_missing_inputs_are_refused() -> None:
    clip = film(DRIVE)
    context, _ = clip.split(NUM_PAST, PrivilegedInput.CAMERA_HEIGHT)
    past = clip.trajectory[:NUM_PAST]
    with pytest.raises(Incompatible, match="set camera_height_m"):
        GroundFarPlane().reconstruct(replace(context, camera_height_m=None), past)
    with pytest.raises(Incompatible, match="give the odometry a scale"):
        GroundFarPlane().reconstruct(context, replace(past, is_metric=False))
