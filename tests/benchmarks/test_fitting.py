"""Fits of the forecasters: gradients, training windows, calibration and likelihoods."""

import tomllib
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp

from geovp_benchmarks.fitting import kalman_noise, network_training, prior, training_windows
from geovp_benchmarks.fitting.calibration import Calibration, rescaled
from geovp_benchmarks.fitting.kalman_noise import NoiseFit
from geovp_benchmarks.fitting.network_training import Schedule
from geovp_benchmarks.fitting.prior import PriorFit
from geovp_benchmarks.fitting.training_windows import Augmentation, Grid
from geovp_classic.errors import BadData
from geovp_classic.forecasting import kalman, motion_network, motion_prior
from geovp_classic.forecasting.motion_network import Coefficients
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Trajectory

SMALL_FIT = PriorFit(
    num_members=1,
    centre_width=8,
    centre_epochs=2,
    num_modes=2,
    depth=3,
    spread_width=8,
    spread_epochs=2,
)


def winding_road(num_steps: int, seed: int) -> Trajectory:
    """Drive with wandering speed and turn rate."""
    rng = np.random.default_rng(seed)
    turns = 0.3 * np.sin(np.arange(num_steps) / 25 + seed) + 0.02 * rng.standard_normal(num_steps)
    poses = [np.eye(4)]
    for step, turn in enumerate(turns[1:]):
        speed = 8 + 2 * np.sin(step / 40 + seed)
        poses.append(poses[-1] @ se3.exp(np.array([0, 0, speed, 0, turn, 0]) * 0.1037))
    return Trajectory(np.stack(poses), np.arange(num_steps) * 0.1037, is_metric=True)


def slope_by_differences(loss: Callable[[FloatArray], float], outputs: FloatArray) -> FloatArray:
    step, slopes = 1e-3, np.zeros_like(outputs)
    for index in np.ndindex(*outputs.shape):
        nudge = np.zeros_like(outputs)
        nudge[index] = step
        slopes[index] = (loss(outputs + nudge) - loss(outputs - nudge)) / (2 * step)
    return slopes


def test_back_propagation_agrees_with_finite_differences() -> None:
    rng = np.random.default_rng(0)
    network = network_training.initialised((3, 4, 2), 2, rng)
    network = motion_network.Network(
        tuple(w.astype(np.float64) for w in network.weights), tuple(b + 0.1 for b in network.biases)
    )
    features = rng.standard_normal((2, 5, 3))
    outputs, trace = network_training.forward(network, features, 0.0, rng)
    np.testing.assert_allclose(outputs[0], network(features[0])[0], atol=1e-6)
    slopes = network_training.backward(network, trace, 2 * outputs)

    def loss(first: FloatArray) -> float:
        return float(
            (
                network_training.forward(
                    replace(network, weights=(first, network.weights[1])), features, 0.0, rng
                )[0]
                ** 2
            ).sum()
        )

    np.testing.assert_allclose(
        slopes[0], slope_by_differences(loss, network.weights[0]), rtol=1e-3, atol=1e-4
    )


def test_the_gradient_of_the_mixture_agrees_with_finite_differences() -> None:
    rng = np.random.default_rng(1)
    outputs, wanted = rng.standard_normal((1, 3, 2 * 5)), rng.standard_normal((1, 3, 2))

    def loss(values: FloatArray) -> float:
        log_weights, means, log_deviations = motion_network.mixture_parameters(values, 2)
        white = (wanted[..., None, :] - means) * np.exp(-log_deviations)
        return -float(
            logsumexp(log_weights + (-0.5 * white**2 - log_deviations).sum(-1), axis=-1).mean()
        )

    slopes = prior.mixture_gradient(outputs, wanted, 2)
    np.testing.assert_allclose(slopes, slope_by_differences(loss, outputs), atol=1e-4)


def test_the_gradient_of_the_centre_agrees_with_finite_differences() -> None:
    rng = np.random.default_rng(2)
    outputs, wanted = rng.standard_normal((1, 2, 6)), rng.standard_normal((1, 2, 6))
    scale = np.array([[1.0, 2.0, 0.1], [1.5, 3.0, 0.2]])

    def loss(values: FloatArray) -> float:
        off = (values - wanted).reshape(1, 2, 2, 3) * scale
        distance = np.sqrt((off[..., :2] ** 2).sum(-1) + 1e-4)
        return float((distance + 8 * np.sqrt(off[..., 2] ** 2 + 1e-6)).mean())

    slopes = prior.centre_gradient(outputs, wanted, scale, 8.0)
    np.testing.assert_allclose(slopes, slope_by_differences(loss, outputs), rtol=2e-2, atol=2e-3)


def test_a_network_learns_a_line() -> None:
    rng = np.random.default_rng(3)

    def batch() -> tuple[FloatArray, FloatArray]:
        features = rng.standard_normal((2, 64, 1)).astype(np.float32)
        return features, 3 * features - 1

    def gradient(outputs: FloatArray, wanted: FloatArray) -> FloatArray:
        return (2 * (outputs - wanted) / 64).astype(np.float32)

    start = network_training.initialised((1, 16, 16, 1), 2, rng)
    schedule = Schedule(600, 64, learning_rate=1e-2, weight_decay=0.0, dropout=0.0)
    trained = network_training.train(start, batch, gradient, schedule, rng)
    np.testing.assert_allclose(trained(np.array([[0.5]]))[:, 0, 0], 0.5, atol=0.1)


def test_shortened_pasts_repeat_their_first_step() -> None:
    twists = np.arange(9.0)[None, :, None] * np.ones(6)
    np.testing.assert_array_equal(
        training_windows.shortened(twists, np.array([3]))[0, :, 0], [6, 6, 6, 6, 6, 6, 6, 7, 8]
    )


def test_training_windows_of_a_circle_are_its_states() -> None:
    times_s = np.arange(60) * training_windows.STEP_S
    twist = np.array([0, 0, 10.0, 0, 0.1, 0])
    circle = Trajectory(se3.exp(times_s[:, None] * twist), times_s, True)
    data = Grid(stride=7).windows(circle)
    np.testing.assert_allclose(data.twists, np.tile(twist, (len(data), 9, 1)), atol=1e-6)
    angle = 0.1 * training_windows.STEP_S * 21
    expected = [100 * (1 - np.cos(angle)), 100 * np.sin(angle), angle]
    np.testing.assert_allclose(data.states[:, -1], np.tile(expected, (len(data), 1)), atol=1e-6)


@pytest.fixture(scope="module")
def small_prior() -> Coefficients:
    roads = {f"{seed}": winding_road(120, seed) for seed in range(2)}
    other = {"other": winding_road(90, 3)}
    calls: list[tuple[int, int]] = []
    fitted = SMALL_FIT.fit(roads, other, lambda *done: calls.append(done))
    # A centre and a spread without each of 2 sequences, and with all.
    assert calls == [(done, 6) for done in range(7)]
    return fitted


def test_a_fitted_prior_survives_a_file(small_prior: Coefficients) -> None:
    again = motion_prior.unpacked(prior.packed(small_prior))
    assert again.spread.basis.shape == (21, 3, 3)
    twists = Grid(stride=9).windows(winding_road(120, 0)).twists
    np.testing.assert_allclose(again.centre(twists), small_prior.centre(twists))


def test_a_doubled_region_covers_what_the_original_covers_of_halved_errors(
    small_prior: Coefficients,
) -> None:
    data = Grid(stride=1).windows(winding_road(200, 5))
    calibration = Calibration()
    covered = calibration.coverage(small_prior, data)
    assert covered.shape == (len(calibration.choices), 21)
    assert covered[0].mean() < covered[-1].mean()
    twice = rescaled(small_prior, np.full(21, 2.0))
    by_one, by_two = (np.argmin(np.abs(calibration.choices - factor)) for factor in (1, 2))
    covered_by_twice = calibration.coverage(twice, data)[by_one]
    np.testing.assert_allclose(covered_by_twice, covered[by_two], atol=0.1)
    assert twice.centre is small_prior.centre


def test_calibrated_regions_have_their_coverage(small_prior: Coefficients) -> None:
    data = Grid(stride=1).windows(winding_road(400, 6))
    calibration = Calibration()
    calibrated = rescaled(small_prior, calibration.factors([[(small_prior, data)]]))
    by_one = np.argmin(np.abs(calibration.choices - 1))
    np.testing.assert_allclose(calibration.coverage(calibrated, data)[by_one], 0.9, atol=0.06)


def test_rescaled_windows_have_the_same_turns_on_longer_paths() -> None:
    data = Grid(stride=1).windows(winding_road(200, 7))
    longer = Augmentation(rescaled_fraction=1.0).rescaled(data, np.random.default_rng(0))
    factor = longer.twists[:, -1, 2] / data.twists[:, -1, 2]
    assert 0.8 < factor.min() < factor.max() < 2.3
    np.testing.assert_allclose(longer.states[..., 1], data.states[..., 1] * factor[:, None])
    np.testing.assert_array_equal(longer.states[..., 2], data.states[..., 2])
    np.testing.assert_array_equal(longer.twists[..., 3:], data.twists[..., 3:])


def test_a_single_sequence_is_rejected() -> None:
    with pytest.raises(BadData, match="two or more"):
        PriorFit().fit({"only": winding_road(120, 0)}, {})


def past_and_future(
    trajectory: Trajectory, num_future: int, stride: int
) -> list[tuple[Trajectory, Trajectory]]:
    starts = range(0, len(trajectory) - 10 - num_future + 1, stride)
    return [
        (trajectory[first : first + 10], trajectory[first + 10 : first + 10 + num_future])
        for first in starts
    ]


def test_the_noise_fit_raises_the_likelihood_and_writes_toml() -> None:
    pairs = past_and_future(winding_road(200, 2), 20, 40)
    start = replace(kalman.fitted("turn-rate"), turn_noise=0.5, slip_noise=0.5)
    noise_fit = NoiseFit(max_evaluations=40)
    fitted = noise_fit.fit(pairs, start)
    assert noise_fit.log_density(pairs, fitted) > noise_fit.log_density(pairs, start)
    table = tomllib.loads(kalman_noise.as_toml({"turn-rate": fitted}))["turn-rate"]
    assert table["position_noise_m"] >= 1e-3
    assert table["turn_damping_hz"] == 0
