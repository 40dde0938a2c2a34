"""Scores and tables of forecasters, with numbers worked out by hand."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geovp_benchmarks.trajectories import forecasting
from geovp_benchmarks.trajectories.forecasting import (
    highest_density_ranks,
    read_windows,
    window_scores,
)
from geovp_classic import registry
from geovp_classic.data.formats import pose_files
from geovp_classic.errors import BadData
from geovp_classic.forecasting.body_motion import BodyForecast
from geovp_classic.forecasting.constant import Hold
from geovp_classic.forecasting.planar_forecaster import PlanarForecast
from geovp_classic.forecasting.selected import Selected
from geovp_classic.geometry import se3
from geovp_classic.types import Trajectory
from tests.benchmarks.conftest import Says
from tests.benchmarks.made import rows_of


def circle(num_steps: int, speed_m_s: float = 10.0, turn_rad_s: float = 0.1) -> Trajectory:
    times_s = np.arange(num_steps) * 0.1
    return Trajectory(
        se3.exp(times_s[:, None] * np.array([0, 0, speed_m_s, 0, turn_rad_s, 0])), times_s, True
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("03", "05"):
        trajectory = circle(60)
        pose_files.write_kitti(tmp_path / f"{name}.txt", trajectory)
        (tmp_path / f"{name}_times.txt").write_text(
            "\n".join(f"{time:.6f}" for time in trajectory.times_s)
        )
    return tmp_path


def test_windows_are_cut_every_stride_frames_to_the_end(folder: Path) -> None:
    windows = read_windows(folder, ["03"], 30, 20, 5)  # of 60 poses: 11 starts, every fifth
    assert [past.times_s[0] for past, _ in windows] == pytest.approx([0.0, 0.5, 1.0])
    assert tuple(map(len, windows[0])) == (30, 20)
    assert len(read_windows(folder, [], 30, 20, 5)) == 6  # of all sequences
    with pytest.raises(BadData, match="61 poses"):
        read_windows(folder, ["03"], 30, 31, 5)


def test_a_forecaster_may_draw_samples_in_some_windows_only() -> None:
    """Selected forecasts a drive by the motion prior, and a stationary camera by one future."""
    waiting = circle(30, 0.0, 0.0)
    windows = [window(), (waiting[:10], waiting[10:])]
    scores = forecasting.evaluate(windows, Selected())
    assert scores["FDE m"] < 5.0
    assert "ADE m, best of 5" not in scores
    assert "ADE m, best of 5" in window_scores(Selected(), *windows[0])


def window(turn_rad_s: float = 0.1) -> tuple[Trajectory, Trajectory]:
    """Return ten poses and the next twenty at 10 m/s."""
    path = circle(30, 10.0, turn_rad_s)
    return path[:10], path[10:]


def test_holding_is_off_by_the_distance_driven_and_the_angle_turned() -> None:
    scores = window_scores(Hold(), *window(0.1))
    chord_m = 2 * 100 * np.sin(0.1)  # of 0.2 rad at 100 m radius
    assert scores["FDE m"] == pytest.approx(chord_m)
    assert scores["yaw deg @20"] == pytest.approx(np.degrees(0.2))
    assert not [name for name in scores if " in " in name or "best of" in name]


def test_ranks_are_the_ellipsoids_probability() -> None:
    body = BodyForecast(
        np.zeros((1, 3)), np.ones((1, 3)), np.full(3, 1e6)
    )  # so many degrees of freedom are a Gaussian
    forecast = PlanarForecast(
        np.ones(1), np.zeros((1, 1, 3)), np.eye(3)[None, None], np.eye(4), np.eye(4), body
    )
    # Chi-squared of three degrees of freedom: 2.366 holds 50 %, 6.251 holds 90 %; of six: 5.348 and
    # 10.645.
    for square, whole, probability in ((2.366, 5.348, 0.5), (6.251, 10.645, 0.9)):
        truth, over = (
            np.array([[np.sqrt(square), 0.0, 0.0]]),
            np.array([[0.0, np.sqrt(whole - square), 0.0]]),
        )
        ranks = highest_density_ranks(forecast, truth, over, num_samples=20000)
        for name in ("x, z, yaw", "all six"):
            assert ranks[name] == pytest.approx([probability], abs=0.015)
    alone = highest_density_ranks(replace(forecast, body=None), truth, over)
    assert list(alone) == ["x, z, yaw"]


def test_the_command_prints_a_column_per_forecaster(folder: Path, printed: Says) -> None:
    names = ["--methods", "hold", "turn-rate-kalman"]
    lines = printed("forecast", folder, "--sequences", "03", "05", *names).splitlines()
    assert lines[0] == "14 windows of 03, 05"  # 60 frames: 7 starts each
    rows = rows_of(lines)
    assert rows[""] == ["hold", "turn-rate-kalman"]
    # chords of 1 to 20 steps of 0.01 rad at 100 m radius
    ade_m = np.mean(200 * np.sin(0.005 * np.arange(1, 21)))
    assert float(rows["ADE m"][0]) == pytest.approx(ade_m, abs=0.0005)
    assert rows["all six in 90% @20"][0] == "-"  # hold has no distribution
    assert 0 <= float(rows["all six in 90% @20"][1]) <= 1
    assert not [name for name in rows if "turning" in name]  # 2 s of 0.1 rad/s are 11.5 degrees


def test_the_best_forecaster_beats_every_other_on_real_poses() -> None:
    root = os.environ.get("GEOVP_TEST_DATA")
    if root is None or not (Path(root) / "kitti_full_poses").is_dir():
        pytest.skip("GEOVP_TEST_DATA is not set: needs kitti_full_poses")
    windows = forecasting.read_windows(Path(root) / "kitti_full_poses", ["04"], stride=60)
    errors = {}
    for name in ("hold", "constant-turn", "acceleration-kalman", "motion-prior"):
        forecaster = registry.build("forecasters", name)
        errors[name] = forecasting.evaluate(windows, forecaster)["ADE m"]
    assert min(errors, key=errors.__getitem__) != "hold"
    assert errors["motion-prior"] < 1.0
