"""Detection of poses that a car cannot have driven, on drives with known errors."""

import numpy as np
import pytest

from geovp_benchmarks.fitting.plausibility import Drivability
from geovp_benchmarks.fitting.prior import PriorFit
from geovp_benchmarks.fitting.training_windows import Grid
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Trajectory

STEP_S = 0.1037
LEVER_M = 1.6  # from the rear axle to the camera
DRIVABILITY = Drivability()


def twists(num_steps: int) -> FloatArray:
    """Return velocities [N, 6] of a camera on a car that turns and accelerates."""
    time_s = np.arange(num_steps) * STEP_S
    rates = np.zeros((num_steps, 6))
    rates[:, 2] = 8 + 3 * np.sin(time_s / 4)
    rates[:, 4] = 0.4 * np.sin(time_s / 3) ** 3
    rates[:, 0] = LEVER_M * rates[:, 4] + 0.01 * rates[:, 2]
    rates[:, 1] = -0.02 * rates[:, 2]
    return rates + 0.03 * np.random.default_rng(0).standard_normal(rates.shape) * [
        1,
        1,
        1,
        0.01,
        0.01,
        0.01,
    ]


def drive(rates: FloatArray) -> Trajectory:
    poses = [np.eye(4)]
    for step in se3.exp(rates * STEP_S):
        poses.append(poses[-1] @ step)
    return Trajectory(np.stack(poses), np.arange(len(poses)) * STEP_S, is_metric=True)


def test_a_car_in_town_is_drivable() -> None:
    assert DRIVABILITY.steps(drive(twists(400))).all()


def test_standing_still_is_drivable() -> None:
    assert DRIVABILITY.steps(drive(np.zeros((50, 6)))).all()


@pytest.mark.parametrize("axis", [0, 1])
def test_a_slide_across_the_car_is_found_where_it_is(axis: int) -> None:
    rates = twists(400)
    rates[200:206, axis] += 0.6
    usable = DRIVABILITY.steps(drive(rates))
    assert not usable[201:205].any()
    assert usable[:195].all()
    assert usable[211:].all()


def test_a_jump_ahead_is_found_at_both_ends() -> None:
    rates = twists(400)
    rates[200, 2] += 1.2
    usable = DRIVABILITY.steps(drive(rates))
    np.testing.assert_array_equal(np.flatnonzero(~usable), [200, 201])


def test_braking_for_a_light_is_drivable() -> None:
    rates = np.zeros((80, 6))
    rates[:, 2] = np.interp(np.arange(80) * STEP_S, [2.0, 5.0], [12.0, 0.0])  # 4 m/s^2
    assert DRIVABILITY.steps(drive(rates)).all()


def test_training_windows_avoid_unusable_steps() -> None:
    trajectory = drive(twists(120))
    usable = np.ones(120, dtype=bool)
    usable[60] = False
    grid = Grid(stride=1)
    complete = grid.windows(trajectory)
    partial = grid.windows(trajectory, usable=usable)
    assert len(complete) - len(partial) == grid.num_past + grid.num_future
    np.testing.assert_array_equal(partial.twists[0], complete.twists[0])
    np.testing.assert_array_equal(partial.states[-1], complete.states[-1])


def test_undrivable_poses_are_rejected_with_the_name_of_the_sequence() -> None:
    rates = twists(200)
    rates[::8, 2] += 3
    with pytest.raises(BadData, match="sequence wild has no stretch"):
        PriorFit().fit({"wild": drive(rates), "tame": drive(twists(200))}, {})


def test_a_long_sequence_is_held_out_piece_by_piece() -> None:
    roads = {"long": drive(twists(399)), "short": drive(twists(199))}
    small = PriorFit(
        piece_steps=100,
        num_members=1,
        centre_width=4,
        centre_epochs=1,
        num_modes=2,
        depth=2,
        spread_width=4,
        spread_epochs=1,
    )
    calls: list[tuple[int, int]] = []
    small.fit(roads, {}, lambda *done: calls.append(done))
    assert calls[-1] == (14, 14)  # a centre and a spread without each of 4 + 2 pieces, and with all
