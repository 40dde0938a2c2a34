"""Fits of the forecasters to made drives: drivability, windows, networks, spreads and files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="torch is not installed: fits need the extra 'learned'")

from geovp_classic.data.formats import pose_files
from geovp_classic.forecasting import kalman as shipped
from geovp_classic.forecasting import motion_prior
from geovp_classic.forecasting.body_motion import BodyMotion
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Trajectory
from studies import command_line
from studies.fitting import kalman, windows
from studies.fitting import motion_prior as fitting
from studies.fitting.motion_prior import Ensemble, PriorFit
from studies.fitting.windows import STEP_S, drivable_steps

LEVER_M = 1.6  # from the rear axle to the camera
SMALL = PriorFit(Ensemble(1, 8, 40), Ensemble(1, 8, 40), num_modes=2, depth=3)


def twists(num_steps: int, seed: int = 0) -> FloatArray:
    """Return velocities [N, 6] of a camera on a car that turns and accelerates."""
    time_s = np.arange(num_steps) * STEP_S
    rates = np.zeros((num_steps, 6))
    rates[:, 2] = 8 + 3 * np.sin(time_s / 4)
    rates[:, 4] = 0.4 * np.sin(time_s / 3 + seed) ** 3
    rates[:, 0] = LEVER_M * rates[:, 4] + 0.01 * rates[:, 2]
    rates[:, 1] = -0.02 * rates[:, 2]
    noise = np.random.default_rng(seed).standard_normal(rates.shape)
    return rates + noise * np.repeat([0.03, 0.0003], 3)


def drive(rates: FloatArray) -> Trajectory:
    poses = [np.eye(4)]
    for step in se3.exp(rates * STEP_S):
        poses.append(poses[-1] @ step)
    return Trajectory(np.stack(poses), np.arange(len(poses)) * STEP_S, is_metric=True)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_slide_across_the_car_is_found_where_it_is(axis: int) -> None:
    rates = twists(400)
    rates[200:206, axis] += 0.6
    usable = drivable_steps(drive(rates))
    assert not usable[201:205].any()
    assert usable[:195].all()
    assert usable[211:].all()


def test_a_prior_survives_a_file(tmp_path: Path) -> None:
    roads = [windows.cut(drive(twists(160, seed))) for seed in range(2)]
    fitted = SMALL.fit(roads)
    path = tmp_path / "prior.npz"
    np.savez(path, **fitting.arrays_of(fitted))  # type: ignore[arg-type]
    again = motion_prior.load(path)
    assert again.basis.shape == (21, 3, 3)
    past, _ = roads[0]
    np.testing.assert_allclose(again.central_paths(past), fitted.central_paths(past), atol=1e-4)
    paths = motion_prior.path_mixture(again, past[:1], STEP_S * np.arange(1, 22))
    assert np.isfinite(paths.covariances).all()


def test_the_noise_fit_raises_the_likelihood() -> None:
    road = drive(twists(200, 2))
    pairs = [
        (road[first : first + 10], road[first + 10 : first + 30]) for first in range(0, 170, 40)
    ]
    start = replace(shipped.fitted("turn-rate"), turn_noise=0.5, slip_noise=0.5)
    fitted = kalman.fit(pairs, start, max_evaluations=20)
    assert kalman.log_density(pairs, fitted) > kalman.log_density(pairs, start)
    assert fitted.position_noise_m == start.position_noise_m
    assert fitted.turn_damping_hz == 0


def test_the_command_writes_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    road = drive(twists(160))
    pose_files.write_kitti(tmp_path / "00.txt", road)
    np.savetxt(tmp_path / "00_times.txt", road.times_s, fmt="%.6f")
    monkeypatch.chdir(tmp_path)
    args = command_line().parse_args(["fitting", "body-motion", ".", "--sequences", "00"])
    assert [*args.run(args)] == ["written to body-motion.npz"]
    past = road[:10]
    forecast = BodyMotion(tmp_path / "body-motion.npz").distribution(past, past.times_s[-1:] + 1.0)
    assert np.isfinite(forecast.means).all()
