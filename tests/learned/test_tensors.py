"""Images as the network's own camera takes them."""

import numpy as np
import pytest

from geovp_classic.geometry import pinhole
from geovp_classic.types import ByteArray, Intrinsics
from geovp_learned.tensors import seen_by

CAMERA = Intrinsics(100.0, 100.0, 49.5, 39.5, 100, 80)


def view(camera: Intrinsics) -> ByteArray:
    """What a camera sees of smooth colours infinitely far away."""
    rays = pinhole.rays(camera)
    x, y = rays[..., 0] / rays[..., 2], rays[..., 1] / rays[..., 2]
    return np.stack(
        [127 + 100 * np.sin(5 * x), 127 + 100 * np.cos(4 * y), 127 + 100 * x], axis=-1
    ).astype(np.uint8)


@pytest.mark.parametrize("focal_px", [120.0, 50.0])
def test_another_calibration_sees_what_its_own_rays_see(focal_px: float) -> None:
    """Shorter focal lengths shrink the frame first; longer ones do not enlarge it."""
    wanted = Intrinsics(focal_px, 110.0, 14.0, 33.0, 28, 64)
    seen = seen_by(view(CAMERA), CAMERA, wanted)
    np.testing.assert_allclose(seen.astype(int), view(wanted), atol=3)
