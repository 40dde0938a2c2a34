"""Scores and tables of forecasters, with numbers worked out by hand."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geovp_benchmarks.evaluation.forecasting import evaluation
from geovp_benchmarks.evaluation.forecasting.evaluation import (
    OdometryNoise,
    cut,
    energy_score,
    highest_density_ranks,
    measure,
)
from geovp_classic.data import pose_files
from geovp_classic.forecasting.constant import ConstantTurn, Hold
from geovp_classic.forecasting.sampling import BodyForecast, PlanarForecast
from geovp_classic.geometry import se3
from geovp_classic.types import Trajectory
from tests.benchmarks.conftest import Says


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


def test_windows_are_cut_every_stride_frames_to_the_end() -> None:
    cuts = list(cut(circle(41), 10, 20, 5))
    assert [round(past.times_s[0], 6) for past, _ in cuts] == [
        0.0,
        0.5,
        1.0,
    ]  # 11 starts, every fifth
    assert tuple(len(part) for part in cuts[0]) == (10, 20)
    assert list(cut(circle(29), 10, 20, 5)) == []


def test_holding_is_off_by_the_distance_driven_and_the_angle_turned() -> None:
    window = next(cut(circle(30, 10.0, 0.1), 10, 20, 5))
    scores = measure(Hold(), [window])
    assert scores.position_m[0, 9] == pytest.approx(
        2 * 100 * np.sin(0.05)
    )  # the chord of 0.1 rad at 100 m radius
    assert scores.yaw_deg[0, -1] == pytest.approx(np.degrees(0.2))
    assert np.isnan(scores.rank).all()
    assert scores.energy_m[0] == pytest.approx(scores.position_m[0].mean())


def test_a_constant_turn_forecasts_a_circle() -> None:
    scores = measure(ConstantTurn(), cut(circle(60)))
    assert scores.position_m.max() < 1e-6
    assert scores.yaw_deg.max() < 1e-6


def test_the_energy_score_of_two_samples() -> None:
    samples = np.array([[[0.0, 0.0]], [[2.0, 0.0]]])
    # distances to the truth 1 and 1; the samples are 2 apart, half of which is taken off
    assert energy_score(samples, np.array([[1.0, 0.0]])) == pytest.approx(0.0)
    assert energy_score(samples[:1], np.array([[1.0, 0.0]])) == pytest.approx(1.0)


def test_ranks_are_the_ellipsoids_probability() -> None:
    body = BodyForecast(
        np.zeros((1, 3)), np.ones((1, 3)), np.full(3, 1e6)
    )  # so many degrees of freedom are a Gaussian
    forecast = PlanarForecast(
        np.ones(1), np.zeros((1, 1, 3)), np.eye(3)[None, None], np.eye(4), np.eye(4), body
    )
    # Chi-squared of three degrees of freedom: 2.366 holds 50 %, 6.251 holds 90 %; of six: 5.348 and
    # 10.645.
    for square, whole, share in ((2.366, 5.348, 0.5), (6.251, 10.645, 0.9)):
        truth, over = (
            np.array([[np.sqrt(square), 0.0, 0.0]]),
            np.array([[0.0, np.sqrt(whole - square), 0.0]]),
        )
        ranks = highest_density_ranks(forecast, truth, over, num_samples=20000)[0]
        assert ranks == pytest.approx([share, share], abs=0.015)
    alone = highest_density_ranks(replace(forecast, body=None), truth, over)
    assert np.isnan(alone[0, 1])


def test_odometry_noise_keeps_the_last_pose_and_repeats() -> None:
    past = circle(10)
    noisy = OdometryNoise()(past)
    np.testing.assert_allclose(noisy.world_from_cam[-1], past.world_from_cam[-1])
    np.testing.assert_array_equal(noisy.world_from_cam, OdometryNoise()(past).world_from_cam)
    off = noisy.world_from_cam[0, :3, 3] - past.world_from_cam[0, :3, 3]
    assert 0.005 < np.linalg.norm(off) < 0.4  # nine steps of 2 cm and 0.05 degrees


def test_a_scale_error_stretches_the_past_alone() -> None:
    past = circle(10, 10.0, 0.0)
    noisy = OdometryNoise(0.0, 0.0, scale=0.05)(past)
    lengths = np.linalg.norm(np.diff(noisy.world_from_cam[:, :3, 3], axis=0), axis=-1)
    np.testing.assert_allclose(lengths, lengths[0])  # one factor for all steps of 1 m
    assert 0.0 < abs(np.log(lengths[0])) < 0.2


def test_the_command_writes_a_table_with_a_row_per_forecaster(folder: Path, printed: Says) -> None:
    rows = ["--only", "hold", "CTRV, extended"]
    lines = printed("forecast", "evaluate", folder, "--sequences", "03", "05", *rows).splitlines()
    assert lines[0] == "14 windows of 03, 05"  # 60 frames: 7 starts each
    assert lines[1] == "turning: 0 windows, by more than 15 degrees"  # 2 s of 0.1 rad/s are 11.5
    names = [line.split("|")[1].strip() for line in lines if line.startswith("|")]
    head, rule = "forecaster", "---"
    assert names == [
        head,
        rule,
        "hold",
        "CTRV, extended",
        head,
        rule,
        "CTRV, extended",
    ]  # hold has no distribution
    assert "in 90%" not in lines[3]
    assert "all six in 90% @20" in lines[8]


def test_the_best_forecaster_beats_every_other_on_real_poses() -> None:
    root = os.environ.get("GEOVP_TEST_DATA")
    if root is None or not (Path(root) / "kitti_full_poses").is_dir():
        pytest.skip("GEOVP_TEST_DATA is not set: needs kitti_full_poses")
    rows = evaluation.forecasters()
    chosen = {
        name: rows[name] for name in ("hold", "constant twist", "CTRA, damped", "motion prior")
    }
    cuts = evaluation.read_windows(Path(root) / "kitti_full_poses", ["04"], stride=60)
    scores = evaluation.evaluate(cuts, chosen)
    errors = {name: float(row.position_m.mean()) for name, row in scores.items()}
    assert min(errors, key=errors.__getitem__) != "hold"
    assert errors["motion prior"] < 1.0


def test_the_best_of_a_few_falls_with_their_number(folder: Path, printed: Says) -> None:
    lines = printed(
        "forecast", "best-of", folder, "--sequences", "03", "05", "--counts", "1", "3"
    ).splitlines()
    assert lines[0] == "4 windows of 03, 05"
    cells = {line.split("|")[1].strip(): line.split("|")[2:-1] for line in lines[3:]}
    assert list(cells) == [
        *("CTRV", "CTRV, representative", "more than CTRV"),
        *("motion prior", "motion prior, representative", "more than motion prior"),
    ]
    for name in ("CTRV, representative", "motion prior, representative"):
        one, three = np.array(cells[name], float).reshape(3, 2).T
        assert (three <= one).all()  # the first is the centre
        drawn = np.array(cells[name.removesuffix(", representative")], float).reshape(3, 2)[:, 1]
        more = [
            float(cell.split()[0])
            for cell in cells[f"more than {name.removesuffix(', representative')}"][1::2]
        ]
        np.testing.assert_allclose(three - drawn, more, atol=0.0011)
