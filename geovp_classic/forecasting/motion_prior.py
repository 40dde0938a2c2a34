"""Forecast as drivers drive: a motion prior fitted to recorded poses, with an honest spread.

Two small networks look at the camera's twists over the last 0.93 s. One says the centre path as a correction of a
damped turn, fitted to the distance in metres and the absolute yaw error, so it is a median and not a mean. The other
says a mixture of Gaussians over smooth deviations from it (turn or not, brake or not), fitted to the errors that the
first one makes on roads it was not fitted to. The size of the regions is set last, step by step, so that they hold
what they say on roads unknown to both. Recorded poses that no car could drive have no part in any of it.

The coefficients are fitted by `geovp forecast fit-prior` to ground-truth poses of KITTI odometry 00, 02, 08 and 09,
the regions' size to 01 and 04 as well (Geiger et al. 2012); they are CC BY-NC-SA 3.0 and not included.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from geovp_classic.errors import BadData
from geovp_classic.forecasting import motion_network, past_motion
from geovp_classic.forecasting.motion_network import MIRRORED_STATES, Coefficients, Network, Standard
from geovp_classic.forecasting.sampling import PlanarForecast
from geovp_classic.geometry import planar
from geovp_classic.types import FloatArray, Trajectory

NUM_PAST_STEPS = 9
FASTEST_TURN_RAD_S = 1.5  # nothing on the train poses turns faster; beyond it the history is taken as turning so fast
SCALE_FREE_SPEED_M_S = 9.0  # about the median of the train poses
LICENCE = "Fitted to ground-truth poses of KITTI odometry 00, 01, 02, 04, 08, 09 (Geiger et al. 2012), CC BY-NC-SA 3.0."


@dataclass(frozen=True)
class MotionPrior:
    """The centre path, or draws around it when more than one sample is asked for.

    Any number of past poses and any future times: histories are brought to an even grid of 0.1037 s, shorter ones
    continued backwards by their earliest step, longer ones cut; a single pose is held. Beyond the fitted 2.2 s the path
    goes on with its last speed and turn rate. A past without metres is taken as driven at SCALE_FREE_SPEED_M_S.
    Height, pitch and roll are those of the last pose, on the plane that the past motion suggests.
    """

    seed: int = 0
    coefficients: Path | None = None  # another file of `fit-prior`; None: the one that comes along

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        """Futures [S, F, 4, 4]; with one sample the centre path, otherwise all are draws."""
        ahead_s = past_motion.seconds_ahead(past, times_s)
        if len(past) == 1:
            return np.tile(past.world_from_cam[-1], (num_samples, len(ahead_s), 1, 1))
        outlook = self._outlook(past, ahead_s)
        if num_samples == 1:
            states = outlook.centre[None]
        else:
            states = outlook.drawn(num_samples, np.random.default_rng(self.seed))
        plane = past_motion.vehicle_from_cam(past)
        return planar.lift(states / outlook.unit, past.world_from_cam[-1], plane)

    def distribution(self, past: Trajectory, times_s: FloatArray) -> PlanarForecast:
        """The predictive mixture of (x, z, yaw) at every future time; BadData for a single past pose."""
        ahead_s = past_motion.seconds_ahead(past, times_s)
        if len(past) == 1:
            raise BadData("one past pose shows no motion, so there is no distribution to give: give at least two")
        outlook = self._outlook(past, ahead_s)
        means, covariances = outlook.moments()
        scale = outlook.unit[:, None] * outlook.unit
        plane = past_motion.vehicle_from_cam(past)
        return PlanarForecast(
            outlook.weights, means / outlook.unit, covariances / scale, past.world_from_cam[-1], plane
        )

    def _outlook(self, past: Trajectory, ahead_s: FloatArray) -> Outlook:
        fitted = load(self.coefficients)
        factor = past_motion.metres_per_unit(past, SCALE_FREE_SPEED_M_S)
        rates = past_motion.body_rates(past_motion.scaled(past, factor), fitted.step_s, NUM_PAST_STEPS)[None]
        rates[..., 3:] = np.clip(rates[..., 3:], -FASTEST_TURN_RAD_S, FASTEST_TURN_RAD_S)
        return outlook(fitted, rates, ahead_s, factor)


@dataclass(frozen=True)
class Outlook:
    """A centre path in metres and modes of smooth deviations from it, at T future times."""

    centre: FloatArray  # [T, 3]
    weights: FloatArray  # [K]
    means: FloatArray  # [K, D]
    deviations: FloatArray  # [K, D]
    bases: FloatArray  # [K, T, 3, D], off the path: (right, ahead, yaw)
    floor: FloatArray  # [T, 3]
    unit: FloatArray  # [3], metres per unit of the past

    def drawn(self, num_samples: int, rng: np.random.Generator) -> FloatArray:
        """Smooth paths [S, T, 3]; the floor's variance, which is not smooth, is left out."""
        which = rng.choice(len(self.weights), size=num_samples, p=self.weights)
        amounts = self.means[which] + self.deviations[which] * rng.standard_normal((num_samples, self.means.shape[1]))
        off = np.einsum("stid,sd->sti", self.bases[which], amounts)
        return self.centre + np.einsum("tij,stj->sti", self._turned(), off)

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Means [K, T, 3] and covariances [K, T, 3, 3] of (x, z, yaw)."""
        turned = self._turned()
        axes = np.einsum("tij,ktjd->ktid", turned, self.bases)
        means = self.centre + np.einsum("ktid,kd->kti", axes, self.means)
        wide = axes * self.deviations[:, None, None]
        floor = (turned * self.floor[:, None]) @ np.swapaxes(turned, 1, 2)
        return means, wide @ np.swapaxes(wide, -1, -2) + floor

    def _turned(self) -> FloatArray:
        """(x, z, yaw) from (right, ahead, yaw) at every time [T, 3, 3]."""
        yaw = self.centre[:, 2]
        zero, one, cos, sin = np.zeros_like(yaw), np.ones_like(yaw), np.cos(yaw), np.sin(yaw)
        return np.stack([cos, sin, zero, -sin, cos, zero, zero, zero, one], axis=-1).reshape(-1, 3, 3)


def outlook(
    fitted: Coefficients,
    rates: FloatArray,  # [1, P, 6]
    ahead_s: FloatArray,  # [T]
    metres_per_unit: float = 1.0,
) -> Outlook:
    """What the coefficients say about one history."""
    centre = motion_network.centres(fitted, rates)
    weights, means, deviations = motion_network.modes(fitted, rates, centre)
    half = len(weights) // 2
    bases = np.stack([fitted.basis] * half + [fitted.basis * MIRRORED_STATES[:, None]] * half)
    between = _between(ahead_s, fitted.step_s, fitted.num_steps)
    return Outlook(
        centre=_path_at(centre[0], ahead_s, fitted.step_s),
        weights=weights / weights.sum(),
        means=means,
        deviations=deviations,
        bases=np.einsum("tf,kfid->ktid", between, bases),
        floor=between**2 @ fitted.floor,
        unit=np.array([metres_per_unit, metres_per_unit, 1.0]),
    )


@functools.cache
def load(path: Path | None) -> Coefficients:
    """The coefficients of a file (None: the packaged one), read once; BadData when it does not hold them."""
    source = path or resources.files("geovp_classic.poses") / "motion_prior.npz"
    try:
        with source.open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
            table = {name: arrays[name] for name in arrays.files}
        return unpacked(table)
    except (OSError, ValueError, KeyError) as error:
        raise BadData(f"{source} holds no motion prior ({error}): write one with fit-prior") from error


def packed(coefficients: Coefficients) -> dict[str, FloatArray]:
    """The arrays of a file."""
    table: dict[str, FloatArray] = {
        "step_s": np.array(coefficients.step_s),
        "num_modes": np.array(coefficients.num_modes),
        "centre_scale": coefficients.centre_scale,
        "basis": coefficients.basis,
        "floor": coefficients.floor,
        "licence": np.array(LICENCE),
    }
    for name, network, standard in (
        ("centre", coefficients.centre, coefficients.centre_standard),
        ("spread", coefficients.spread, coefficients.spread_standard),
    ):
        table[f"{name}_mean"], table[f"{name}_deviation"] = standard.mean, standard.deviation
        for layer, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
            table[f"{name}_weight{layer}"], table[f"{name}_bias{layer}"] = weight, bias
    return table


def unpacked(table: dict[str, FloatArray]) -> Coefficients:
    """The inverse of `packed`."""
    return Coefficients(
        step_s=float(table["step_s"]),
        centre_standard=Standard(table["centre_mean"], table["centre_deviation"]),
        centre_scale=table["centre_scale"],
        centre=_network(table, "centre"),
        spread_standard=Standard(table["spread_mean"], table["spread_deviation"], motion_network.SPREAD_LIMIT),
        spread=_network(table, "spread"),
        basis=table["basis"],
        floor=table["floor"],
        num_modes=int(table["num_modes"]),
    )


def _network(table: dict[str, FloatArray], name: str) -> Network:
    layers = range(sum(key.startswith(f"{name}_weight") for key in table))
    weights = tuple(table[f"{name}_weight{layer}"] for layer in layers)
    return Network(weights, tuple(table[f"{name}_bias{layer}"] for layer in layers))


def _path_at(
    grid: FloatArray,  # [F, 3], states at 1..F steps
    ahead_s: FloatArray,  # [T]
    step_s: float,
) -> FloatArray:
    """States [T, 3]: a cubic spline through the grid; beyond it the last speed and turn rate go on."""
    nodes = np.concatenate([np.zeros((1, 3)), grid])
    inside_s = np.minimum(ahead_s, step_s * len(grid))
    states = CubicSpline(step_s * np.arange(len(nodes)), nodes)(inside_s)
    (right, ahead, turned), yaw = grid[-1] - grid[-2], grid[-1, 2]
    middle = yaw - turned / 2  # the direction in which the last step went, on average
    side, forward = (np.cos(middle) * right - np.sin(middle) * ahead, np.sin(middle) * right + np.cos(middle) * ahead)
    steps = (ahead_s - inside_s) / step_s
    heading, chord = yaw + turned * steps / 2, steps * np.sinc(turned * steps / (2 * np.pi))
    states[:, 0] += chord * (np.cos(heading) * side + np.sin(heading) * forward)
    states[:, 1] += chord * (np.cos(heading) * forward - np.sin(heading) * side)
    states[:, 2] += turned * steps
    return np.asarray(states)


def _between(ahead_s: FloatArray, step_s: float, num_steps: int) -> FloatArray:
    """Weights [T, F] that take a deviation from the grid to any time: linear between, and on as a line beyond."""
    position = ahead_s / step_s
    before = np.clip(np.floor(position).astype(int), 0, num_steps - 1)
    share = position - before
    weights = np.zeros((len(ahead_s), num_steps + 1))
    rows = np.arange(len(ahead_s))
    weights[rows, before], weights[rows, before + 1] = 1 - share, share
    return weights[:, 1:]  # the deviation is 0 at time 0
