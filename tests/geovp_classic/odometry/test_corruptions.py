"""Hard images: the odometry bridges and says so, and never raises or answers with anything but rigid poses."""

import numpy as np
import pytest

from benchmarks import faults
from geovp_classic.odometry.monocular import Monocular
from geovp_classic.types import ByteArray, Clip, Context, FloatArray, Intrinsics, Trajectory

BY_NAME = {fault.name: fault for fault in faults.FAULTS}
HARDEST = [(fault.name, fault.strengths[-1]) for fault in faults.FAULTS]


@pytest.fixture(scope="module")
def clip(straight: tuple[ByteArray, FloatArray], camera: Intrinsics) -> Clip:
    frames, poses = straight
    times_s = 0.1 * np.arange(len(frames))
    return Clip("corridor", frames, times_s, camera, Trajectory(poses, times_s, True), camera_height_m=1.65)


def row(clip: Clip, name: str, strength: float) -> faults.FaultRow:
    fault = faults.Fault(name, "", (strength,), BY_NAME[name].spoil)
    return faults.measure(Monocular(), [clip], [fault])[0]


@pytest.mark.parametrize(("name", "strength"), HARDEST, ids=str)
def test_nothing_raises_and_all_poses_are_finite(clip: Clip, name: str, strength: float) -> None:
    found = row(clip, name, strength)  # Trajectory's own checks would raise on anything not rigid
    assert 0 <= found.bridged <= 1
    assert np.isfinite(found.rotation_deg)


def test_a_clean_clip_is_tracked(clip: Clip) -> None:
    found = row(clip, "black", 0)
    assert (found.bridged, found.rotation_deg < 0.05, found.path_percent < 0.5) == (0, True, True)


@pytest.mark.parametrize("count", [1, 2])
def test_black_images_are_bridged_by_the_last_motion(clip: Clip, count: int) -> None:
    found = row(clip, "black", count)
    assert found.bridged == pytest.approx(count / 10)
    assert found.path_percent < 2


def test_a_dropped_or_repeated_image_is_still_tracked(clip: Clip) -> None:
    for name in ("dropped", "repeated"):
        found = row(clip, name, 1)
        assert found.bridged == 0
        assert found.path_percent < 1


def test_exposure_jumps_cost_nothing(clip: Clip) -> None:
    assert row(clip, "exposure", -1).path_percent < 1
    assert row(clip, "exposure", -1).bridged == 0


def test_no_texture_at_all_is_all_bridged_and_stands(clip: Clip) -> None:
    found = row(clip, "flat", 1)
    assert (found.bridged, found.path_percent) == (1, 100)


def test_standing_and_turning_are_not_turned_into_noise(clip: Clip) -> None:
    assert row(clip, "standing", 5).rotation_deg < 0.01
    assert row(clip, "turning", 1).rotation_deg < 0.05


def test_random_images_of_any_size_are_survived() -> None:
    rng = np.random.default_rng(0)
    for height_px, width_px in ((8, 8), (17, 40), (64, 64)):
        camera = Intrinsics(50.0, 50.0, width_px / 2, height_px / 2, width_px, height_px)
        frames = rng.integers(0, 256, (5, height_px, width_px, 3), dtype=np.uint8)
        given = Context(frames, np.arange(6.0), camera, camera_height_m=1.65)
        trajectory, tracked = Monocular().track(given)
        assert (len(trajectory), len(tracked)) == (5, 5)


def test_the_table_has_a_line_for_every_fault_and_strength(clip: Clip) -> None:
    chosen = [faults.Fault("black", "frames", (0, 1), BY_NAME["black"].spoil)]
    lines = faults.table(faults.measure(Monocular(), [clip], chosen), chosen).splitlines()
    assert len(lines) == 3
    assert lines[2].split()[:4] == ["black", "1", "frames", "10"]


def test_clips_that_stand_do_not_hide_the_path_error_of_the_others() -> None:
    chosen = [faults.Fault("black", "frames", (0,), BY_NAME["black"].spoil)]
    rows = [faults.FaultRow("black", 0, name, 0, 0.1, error) for name, error in (("a", 2.0), ("b", float("nan")))]
    assert faults.table(rows, chosen).splitlines()[1].split()[-1] == "2.00"
