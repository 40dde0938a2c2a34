"""Points of known places before a camera that drives forward."""

import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(700.0, 705.0, 600.0, 170.0, 1240, 370)


def scene(count: int = 120, seed: int = 0) -> FloatArray:
    """Return random points [N, 3], 8 to 40 m ahead."""
    rng = np.random.default_rng(seed)
    return rng.uniform((-8, -3, 8), (8, 1.6, 40), (count, 3))


def project(points: FloatArray, cam_from_world: FloatArray) -> FloatArray:
    """Return the pixels [..., N, 2] of points [N, 3]."""
    return pinhole.project(se3.transform(cam_from_world, points), CAMERA)[0]


def path(count: int) -> FloatArray:
    """Return cam_from_world [K, 4, 4] every 0.6 m of a gentle curve."""
    return np.asarray(se3.exp(np.arange(count)[:, None] * np.array([0, 0, -0.6, 0, 0.005, 0])))
