"""`geovp poses --clips`: errors of known wrong steps, the table, one sentence for mistakes."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import geovp_classic as geovp
from geovp_benchmarks.evaluation.odometry import clips
from geovp_classic.geometry import se3
from geovp_classic.types import BoolArray, Clip, Context, Intrinsics, PrivilegedInput, Trajectory
from tests.benchmarks.conftest import Says
from tests.benchmarks.made import intrinsics_of


def drive(num_frames: int) -> Clip:
    """One metre a frame straight ahead, of black images."""
    times_s = np.arange(num_frames) / 10
    poses = se3.exp(np.arange(num_frames)[:, None] * np.array([0.0, 0, 1, 0, 0, 0]))
    frames = np.zeros((num_frames, 8, 8, 3), dtype=np.uint8)
    return Clip(
        "drive",
        frames,
        times_s,
        Intrinsics(8, 8, 3.5, 3.5, 8, 8),
        Trajectory(poses, times_s, is_metric=True),
    )


@dataclass(frozen=True)
class Skewed:
    """An odometry whose every step is 3 degrees wrong, 10 % too long, and goes 4 degrees to the
    right.
    """

    is_metric: bool = True

    @property
    def needs(self) -> PrivilegedInput:
        return PrivilegedInput.NONE

    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        assert context.past is None
        aside = np.radians(4)
        step = se3.exp(np.array([0, 0, 0, 0, np.radians(3), 0]))
        step[:3, 3] = 1.1 * np.array([np.sin(aside), 0, np.cos(aside)])
        poses = [np.eye(4)]
        for _ in range(context.num_past - 1):
            poses.append(poses[-1] @ step)
        tracked = np.arange(context.num_past) != 1
        return Trajectory(
            np.stack(poses), context.times_s[: context.num_past], self.is_metric
        ), tracked


def test_wrong_steps_are_measured() -> None:
    steps = clips.errors(Skewed(), drive(6), num_past=5)
    np.testing.assert_allclose(steps.rotation_deg, [3.0] * 4)
    np.testing.assert_allclose(steps.direction_deg, [4.0] * 4)
    np.testing.assert_allclose(steps.length_percent, [10.0])
    assert steps.row("07") == ("07", "1", "75.0%", "3.0000", "4.00", "10.0")


def test_a_path_without_metres_has_no_length() -> None:
    steps = clips.errors(Skewed(is_metric=False), drive(6), num_past=5)
    assert np.isnan(steps.length_percent).all()
    both = clips.StepErrors.joined([steps, clips.errors(Skewed(), drive(3), num_past=2)])
    assert both.row("07")[1] == "2"
    assert len(both.rotation_deg) == 5
    assert both.row("07")[-1] == "10.0"


def test_the_command_prints_one_row_a_stretch(street: Path, printed: Says) -> None:
    words = [
        "poses",
        street,
        "07[0:12)",
        "07[2:12)",
        "--clips",
        "8",
        "--stride",
        "2",
        "--size",
        "160",
    ]
    head, *rows = printed(*words).splitlines()
    assert "rotation (deg/frame)" in head
    assert [row.split()[:2] for row in rows] == [["07[0:12)", "2"], ["07[2:12)", "1"]]
    assert float(rows[0].split()[3]) < 0.2  # degrees a frame


@pytest.mark.parametrize(("name", "length"), [("tum", "0.0"), ("euroc", "0.0"), ("colmap", "-")])
def test_other_layouts_are_found_by_what_lies_in_them(
    tmp_path: Path,
    name: str,
    length: str,
    request: pytest.FixtureRequest,
    printed: Says,
    refused: Says,
) -> None:
    """Recorded poses have no error against themselves; a COLMAP model has no metres to measure a
    length in.
    """
    clip = geovp.open_clip({"name": "synthetic", "num_frames": 8, "size_px": [32, 32]})
    request.getfixturevalue(f"write_{name}")(tmp_path, "a", clip)
    own = ["--data", f"intrinsics={intrinsics_of(clip.intrinsics)}"] if name == "tum" else []
    words = ["poses", tmp_path, "a", "--clips", "4", "--stride", "3", "--size", "32", *own]
    last = printed(*words, "--odometry", "ground-truth").splitlines()[-1]
    assert last.split() == ["a[0:8)", "2", "100.0%", "0.0000", "0.00", length]
    assert printed("data", "doctor", tmp_path).splitlines()[1].startswith("a         8       32x32")
    assert "has no field 'colour'" in refused(*words, "--data", "colour=1")
