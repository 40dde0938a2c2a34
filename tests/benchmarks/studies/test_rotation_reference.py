"""The bundle adjustment of SIFT features, on the synthetic street, whose poses are exact."""

from pathlib import Path

import numpy as np

from geovp_classic import registry
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import FloatArray
from studies.rotation_reference import adjust_sift


def test_wrong_rotations_are_corrected(tmp_path: Path) -> None:
    clip = registry.build("datasets", {"name": "synthetic", "num_clips": 1, "num_frames": 5})[0]
    assert clip.trajectory is not None
    exact = clip.trajectory.world_from_cam
    twists = np.zeros((5, 6))
    twists[1:, 4] = np.radians(0.3) * np.array([1, -1, 1, 1])
    adjusted = adjust_sift(
        map(pinhole.grey8, clip.frames), clip.intrinsics, exact @ se3.exp(twists), tmp_path
    )
    assert _error_deg(exact @ se3.exp(twists), exact) > 0.3
    assert _error_deg(adjusted, exact) < 0.1


def _error_deg(world_from_cam: FloatArray, exact: FloatArray) -> float:
    """Return the root mean square error of the rotations between consecutive frames."""
    turns = se3.inverse(se3.steps(exact)) @ se3.steps(world_from_cam)
    return float(np.degrees(np.sqrt((se3.log(turns)[:, 3:] ** 2).sum(axis=1).mean())))
