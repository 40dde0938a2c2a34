"""Taking the rotation out: what lies at infinity comes to rest, in every direction, and only what
was seen counts.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geovp_classic.geometry import pinhole, se3
from geovp_classic.metrics.image import Psnr, Ssim
from geovp_classic.metrics.stabilised import Stabilised, turned
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics, Trajectory

CAMERA = Intrinsics(100.0, 100.0, 40.0, 30.0, 81, 61)


def looking(right_rad: float = 0.0, up_rad: float = 0.0, clockwise_rad: float = 0.0) -> FloatArray:
    """world_from_cam [1, 4, 4] of a camera at the origin; y is down, so that looking up turns z
    towards -y.
    """
    rotation = Rotation.from_euler("YXZ", [right_rad, up_rad, clockwise_rad]).as_matrix()
    return se3.compose(rotation[None], np.zeros(3))


def trajectory(world_from_cam: FloatArray) -> Trajectory:
    return Trajectory(world_from_cam, np.arange(1.0, len(world_from_cam) + 1), is_metric=True)


def heavens(world_from_cam: FloatArray, camera: Intrinsics = CAMERA) -> ByteArray:
    """Frames [F, H, W, 3] of hills of light at infinity, 9 px and more from one to the next,
    differing by colour.
    """
    frames = []
    for pose in world_from_cam:
        x, y, z = np.moveaxis(pinhole.rays(camera) @ pose[:3, :3].T, -1, 0)
        right, down = np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))
        waves = [
            np.sin(70 * right + 9),
            np.sin(60 * down + 20 * right),
            np.cos(50 * right - 40 * down),
        ]
        frames.append(127.5 + 100 * np.stack(waves, axis=-1))
    return np.rint(frames).astype(np.uint8)


def dot(u: int, v: int) -> ByteArray:
    frame = np.zeros((1, 61, 81, 3), np.uint8)
    frame[0, v, u] = 255
    return frame


def turned_by(
    frames: ByteArray, predicted: FloatArray, target: FloatArray
) -> tuple[ByteArray, BoolArray]:
    return turned(frames, CAMERA, trajectory(predicted), trajectory(target))


@pytest.mark.parametrize(
    ("predicted", "seen_at"),
    [
        # a star at (u, v) = (60, 20) is 20 px right and 10 px above the middle. Who looks atan(.2)
        # - atan(.1) farther
        # to the right sees the star's vertical plane 10 px right, and it 10 * sqrt(1 + .1^2) /
        # sqrt(1 + .2^2) px above
        (looking(right_rad=np.arctan(0.2) - np.arctan(0.1)), (50.0, 20.145)),
        # who looks atan(.1) higher sees it at the middle's height, 20 / sqrt(1 + .1^2) px right
        (looking(up_rad=np.arctan(0.1)), (59.9, 30.0)),
        # a camera rolled clockwise by 90 degrees sees what was above on its left, and what was
        # right above
        (looking(clockwise_rad=np.pi / 2), (30.0, 10.0)),
    ],
)
def test_a_star_moves_to_its_place_in_the_true_camera(
    predicted: FloatArray, seen_at: tuple[float, float]
) -> None:
    pixel, _ = pinhole.project(np.array([20.0, -10.0, 100.0]) @ predicted[0, :3, :3], CAMERA)
    np.testing.assert_allclose(pixel, seen_at, atol=0.01)
    view, seen = turned_by(dot(*np.rint(pixel).astype(int)), predicted, looking())
    assert view[0, ..., 0].argmax() == 20 * 81 + 60
    assert seen[0, 20, 60]


def test_a_pitch_error_does_not_lower_the_score() -> None:
    true = looking(right_rad=0.05)
    predicted = true @ looking(
        up_rad=np.deg2rad(0.4)
    )  # shifts the image by 100 tan(.4 deg) = .70 px
    frames, target = heavens(predicted), heavens(true)
    view, seen = turned_by(frames, predicted, true)
    plain, stabilised = Psnr()(frames, target)[0], Stabilised()(view, target, seen)[0]
    # two of three waves, of amplitude 100 and .6 and .4 rad a pixel upright, are off by .42 and .28
    # rad: a mean square
    # of 100^2 (.42^2 + .28^2) / 2 / 3 = 425, which is 21.8 dB, and a little more since a pitch
    # shifts the sides less
    assert plain == pytest.approx(22.0, abs=0.3)
    assert stabilised > 40
    assert Stabilised(Ssim())(view, target, seen)[0] > 0.995
    assert np.flatnonzero(~seen[0, :, 40]).tolist() == [
        60
    ]  # the true camera looks lower, .70 px below the frame


def test_pixels_outside_the_prediction_are_masked() -> None:
    # u_true = 40 + 100 tan(atan((u_predicted - 40) / 100) + a) at u_predicted = 0: 40 + 100 (.1 -
    # .4) / 1.04 = 11.2
    view, seen = turned_by(heavens(looking()), looking(right_rad=np.arctan(0.1)), looking())
    assert not seen[0, 30, :12].any()
    assert seen[0, 30, 12:].all()
    # at u_predicted = 80 the other way round: 80 - 11.2 = 68.8; at v_predicted = 60: 30 + 100 (.3 -
    # .1) / 1.03 = 49.4
    _, seen = turned_by(heavens(looking()), looking(right_rad=-np.arctan(0.1)), looking())
    np.testing.assert_array_equal(seen[0, 30], np.arange(81) <= 68)
    _, seen = turned_by(heavens(looking()), looking(up_rad=np.arctan(0.1)), looking())
    np.testing.assert_array_equal(seen[0, :, 40], np.arange(61) <= 49)
    behind, unseen = turned_by(heavens(looking()), looking(right_rad=np.pi), looking())
    assert not unseen.any()
    assert np.isnan(Stabilised()(behind, view, unseen)[0])
