"""Eq. 3.4 to 3.6 with numbers worked out by hand."""

import numpy as np
import pytest
import torch

from geovp_classic.geometry import planar, se3
from geovp_learned.deepvo.network import Architecture, coordinates, motions, squared_errors
from geovp_learned.deepvo.train import DeepVoTraining


def flat(*steps: tuple[float, float, float]) -> torch.Tensor:
    return motions(torch.tensor(steps, dtype=torch.float64), "2d")


def test_yaw_and_plane_are_those_of_the_classical_room() -> None:
    states = np.array([[0.3, 2.0, 0.4], [-1.0, 5.0, -2.9]])
    ours, level = motions(torch.from_numpy(states), "2d"), np.eye(4)
    np.testing.assert_allclose(ours, planar.lift(states, level, level), atol=1e-12)
    again = planar.reduce(ours.numpy(), level, level)
    np.testing.assert_allclose(coordinates(ours, "2d"), again, atol=1e-12)


def test_three_dimensional_steps_are_rigid_and_come_back() -> None:
    rng = np.random.default_rng(0)
    steps = torch.from_numpy(rng.uniform(-1.2, 1.2, (50, 6)))
    matrices = motions(steps, "3d")
    np.testing.assert_allclose(
        matrices.numpy() @ se3.inverse(matrices.numpy()), np.tile(np.eye(4), (50, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(coordinates(matrices, "3d"), steps, atol=1e-9)


def test_rotation_errors_are_the_short_way_round() -> None:
    _, rotation = squared_errors(flat((0, 0, np.pi - 0.1)), flat((0, 0, -np.pi + 0.1)), "2d")
    assert float(rotation) == pytest.approx(0.04)


def steps_2d(*rows: tuple[float, float, float]) -> torch.Tensor:
    return torch.tensor([rows])


STRAIGHT = flat((0, 1, 0), (0, 1, 0), (0, 1, 0))[None].float()


def test_the_absolute_loss_by_hand() -> None:
    """The past step turns 0.1 rad to the right where there was none; everything else is right, in
    its own frame.

    Absolute: the past is off by 0.1 rad: 100 * 0.01 = 1. The first future pose is off by 0.1 rad
    and stands at (sin 0.1, 1 + cos 0.1) for (0, 2): 4 sin^2(0.05) = 0.009992 m^2; the second is
    twice as far: 0.039967 m^2.
    """
    method = DeepVoTraining(architecture=Architecture(head="2d"))
    past = steps_2d((0, 1, 0.1)).requires_grad_()
    losses = method.losses(past, steps_2d((0, 1, 0), (0, 1, 0)), STRAIGHT)
    losses["future"].backward()
    assert past.grad.all()  # the future's error trains the encoder as well
    errors = {name: float(loss.detach()) for name, loss in losses.items()}
    assert errors["past"] == pytest.approx(1.0, rel=1e-5)
    assert errors["future"] == pytest.approx(1.0 + (0.0099917 + 0.0399667) / 2, rel=1e-5)
    assert errors["total"] == pytest.approx(errors["past"] + errors["future"])


def test_the_relative_loss_sees_only_the_wrong_step() -> None:
    method = DeepVoTraining(loss="relative")
    losses = method.losses(steps_2d((0, 1, 0.1)), steps_2d((0, 1, 0), (0, 1, 0)), STRAIGHT)
    assert float(losses["past"]) == pytest.approx(1.0, rel=1e-5)
    assert float(losses["future"]) == pytest.approx(0.0, abs=1e-9)
