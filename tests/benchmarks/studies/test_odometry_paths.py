"""`geovp poses`: files that can be read back, drift that is never inpainted, one sentence for
mistakes.
"""

from pathlib import Path

import numpy as np
import pytest

from geovp_classic.data import pose_files
from tests.benchmarks.conftest import Says


def test_files_figure_and_drift_of_a_short_stretch(
    street: Path, tmp_path: Path, printed: Says
) -> None:
    out = printed("poses", street, "07[2:12)", "--out", tmp_path).splitlines()
    by_alignment = {
        words[0]: words[1:] for line in out if (words := line.split()) and words[0] != "alignment"
    }
    assert {"origin", "scale", "se3", "sim3"} <= set(by_alignment)
    assert by_alignment["sim3"][:4] == [
        "too",
        "short",
        "too",
        "short",
    ]  # ten metres have no segment of 100 m
    assert float(by_alignment["sim3"][4]) < 0.5  # ATE in metres over about ten metres
    name = "07-000002-000012"
    poses = pose_files.read_kitti(tmp_path / f"{name}.kitti.txt")
    stamped = pose_files.read_trajectory(tmp_path / f"{name}.tum.txt")
    assert len(poses) == len(stamped) == 10
    np.testing.assert_allclose(stamped.world_from_cam, poses, atol=1e-6)
    np.testing.assert_allclose(stamped.times_s[0], 0.2, atol=1e-6)
    assert (tmp_path / f"{name}.png").stat().st_size > 1000
    assert "path from above" in (tmp_path / f"{name}.svg").read_text()


def test_without_a_scale_no_metres_are_told(street: Path, tmp_path: Path, printed: Says) -> None:
    scale = 'scale={name="unit-speed"}'
    told = printed("poses", street, "07", "--set", scale, "--out", tmp_path)
    rows = [line.split() for line in told.splitlines()]
    assert ["origin", "no", "metric", "scale"] in [row[:4] for row in rows]
    assert next(row for row in rows if row[:1] == ["sim3"])[5].replace(".", "").isdigit()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["99"], "99"),
        (["07[5:50)"], "07 has 12 frames"),
        (["07", "--odometry", "monoclar"], "did you mean 'monocular'"),
        (["07", "--odometry", "ground-truth"], "works on clips only"),
        (["07", "--set", "scale"], "not FIELD=VALUE"),
    ],
)
def test_mistakes_get_one_sentence(
    street: Path, tmp_path: Path, refused: Says, arguments: list[str], message: str
) -> None:
    assert message in refused("poses", street, *arguments, "--out", tmp_path)
    assert not list(tmp_path.iterdir())
