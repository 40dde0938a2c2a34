"""Images as the network's own camera takes them."""

import numpy as np
import pytest

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import ByteArray, FloatArray, Intrinsics
from geovp_learned.tensors import images_from_frames, reproject, shrink

CAMERA = Intrinsics(100.0, 100.0, 49.5, 39.5, 100, 80)


def view(camera: Intrinsics, cam_from_world: FloatArray | None = None) -> ByteArray:
    """What a camera sees of smooth colours infinitely far away."""
    rays = pinhole.rays(camera) @ (np.eye(3) if cam_from_world is None else cam_from_world)
    x, y = rays[..., 0] / rays[..., 2], rays[..., 1] / rays[..., 2]
    return np.stack(
        [127 + 100 * np.sin(5 * x), 127 + 100 * np.cos(4 * y), 127 + 100 * x], axis=-1
    ).astype(np.uint8)


def test_channels_come_first_and_white_is_one() -> None:
    frames = np.zeros((2, 4, 5, 3), dtype=np.uint8)
    frames[1, 2, 3, 0] = 255
    images = images_from_frames(frames)
    assert images.shape == (2, 3, 4, 5)
    assert float(images[1, 0, 2, 3]) == 1.0
    assert float(images.sum()) == 1.0


def test_another_calibration_and_a_turned_camera_see_what_their_own_rays_see() -> None:
    wanted = Intrinsics(120.0, 110.0, 28.0, 33.0, 64, 64)
    for right_rad in (0.0, 0.1):
        right = se3.exp(np.array([0, 0, 0, 0, right_rad, 0]))[:3, :3]
        seen = reproject(view(CAMERA), CAMERA, wanted, right)
        np.testing.assert_allclose(seen.astype(int), view(wanted, right.T), atol=3)
        # what is at x = 0.1 is in the middle after 0.1 rad to the right
        assert seen[33, 28, 2] == pytest.approx(127 + 100 * right_rad, abs=2)


def test_shrinking_keeps_directions_and_never_enlarges() -> None:
    wanted = Intrinsics(50.0, 400.0, 31.5, 31.5, 64, 64)
    small, camera = shrink(view(CAMERA), CAMERA, wanted)
    assert small.shape == (80, 50, 3)  # half as wide; as high as it was
    assert (camera.fx_px, camera.fy_px, camera.cx_px) == (50.0, 100.0, 24.5)
    np.testing.assert_allclose(small.astype(int), view(camera), atol=3)
