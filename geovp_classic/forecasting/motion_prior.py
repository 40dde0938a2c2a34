"""Forecast as drivers drive: a motion prior fitted to recorded poses, with a calibrated
distribution.

Two small networks see the camera's twists over the last 0.93 s. One gives the centre path as a
correction of a damped turn, fitted to the distance in metres and the absolute yaw error, so it is a
median and not a mean. The other gives a mixture of Gaussians over smooth deviations from it (turn
or not, brake or not), fitted to the errors of the first one on roads that it was not fitted to. The
size of the regions is set last, step by step, so that they hold their nominal share on roads
unknown to both. Recorded poses that no car could drive are left out of all of it.

The coefficients are fitted by `geovp forecast fit-prior` to ground-truth poses of KITTI odometry
00, 02, 08 and 09, the regions' size to 01 and 04 as well (Geiger et al. 2012); they are CC BY-NC-SA
3.0 and not included.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline, make_interp_spline
from scipy.spatial.transform import Rotation

from geovp_classic import files
from geovp_classic.errors import BadData
from geovp_classic.forecasting import motion_network, past_motion
from geovp_classic.forecasting.body_motion import BodyMotion
from geovp_classic.forecasting.motion_network import (
    CentreModel,
    Coefficients,
    Network,
    SpreadModel,
    Standardisation,
)
from geovp_classic.forecasting.sampling import PlanarForecast
from geovp_classic.geometry import planar
from geovp_classic.types import FloatArray, Trajectory

NUM_PAST_STEPS = 9
FASTEST_TURN_RAD_S = (
    1.5  # nothing in the train poses turns faster; turn rates of the past are clipped to it
)


@dataclass(frozen=True)
class MotionPrior:
    """The centre path, or draws around it when more than one sample is asked for.

    Any number of past poses and any future times: the past is brought to an even grid of 0.1037 s,
    a shorter one continued backwards by its earliest step, a longer one cut; a single pose is held,
    and so are poses that are all the same, from which the centre would creep by two millimetres.
    Beyond the fitted 2.2 s the path goes on with its last speed and turn rate. A past without
    metres is taken as driven at `past_motion.SCALE_FREE_SPEED_M_S`. Height, pitch and roll over the
    plane that the past motion suggests are foretold by `body_motion`; without it they are those of
    the last pose.
    """

    seed: int = 0
    coefficients: Path | None = None  # another file of `fit-prior`; None: the packaged one
    body_motion: BodyMotion | None = field(default_factory=BodyMotion)

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        """Futures [S, F, 4, 4]; with one sample the centre path, otherwise all are draws."""
        ahead_s = past_motion.seconds_ahead(past, times_s)
        stands = num_samples == 1 and bool((past.world_from_cam == past.world_from_cam[-1]).all())
        if len(past) == 1 or stands:
            return np.tile(past.world_from_cam[-1], (num_samples, len(ahead_s), 1, 1))
        paths, unit = self._paths(past, ahead_s)
        states = paths.centre[None] if num_samples == 1 else paths.sample(num_samples, self.seed)
        poses = planar.lift(
            states * unit, past.world_from_cam[-1], past_motion.vehicle_from_cam(past)
        )
        return (
            poses if self.body_motion is None else self.body_motion.added_to(poses, past, times_s)
        )

    def distribution(self, past: Trajectory, times_s: FloatArray) -> PlanarForecast:
        """The predictive mixture of (x, z, yaw) at every future time; BadData for a single past
        pose.
        """
        ahead_s = past_motion.seconds_ahead(past, times_s)
        if len(past) == 1:
            raise BadData(
                "one past pose shows no motion, so there is no distribution to give: give at "
                "least two"
            )
        paths, unit = self._paths(past, ahead_s)
        means, covariances = paths.moments()
        plane = past_motion.vehicle_from_cam(past)
        scale = unit[:, None] * unit
        body = None if self.body_motion is None else self.body_motion.distribution(past, times_s)
        return PlanarForecast(
            paths.weights, means * unit, covariances * scale, past.world_from_cam[-1], plane, body
        )

    def _paths(self, past: Trajectory, ahead_s: FloatArray) -> tuple[PathMixture, FloatArray]:
        """The mixture in metres, and (x, z, yaw) [3] of the past's unit for its 1."""
        fitted = load(self.coefficients)
        metric, metres_per_unit = past_motion.in_metres(past)
        twists = past_motion.twists_per_s(metric, fitted.centre.step_s, NUM_PAST_STEPS)[None]
        twists[..., 3:] = np.clip(twists[..., 3:], -FASTEST_TURN_RAD_S, FASTEST_TURN_RAD_S)
        return path_mixture(fitted, twists, ahead_s), np.array(
            [1 / metres_per_unit, 1 / metres_per_unit, 1.0]
        )


@dataclass(frozen=True)
class PathMixture:
    """A centre path in metres and modes of smooth deviations from it, at T future times."""

    centre: FloatArray  # [T, 3]
    weights: FloatArray  # [K]
    means: FloatArray  # [K, D]
    deviations: FloatArray  # [K, D]
    bases: FloatArray  # [K, T, 3, D], deviations from the path as (x, z, yaw)
    residual_covariance: FloatArray  # [T, 3, 3], what the bases leave out

    def sample(self, num_samples: int, seed: int) -> FloatArray:
        """Smooth paths [S, T, 3]; the residual covariance, which is not smooth, is left out."""
        rng = np.random.default_rng(seed)
        modes = rng.choice(len(self.weights), size=num_samples, p=self.weights)
        amounts = self.means[modes] + self.deviations[modes] * rng.standard_normal(
            (num_samples, self.means.shape[1])
        )
        return self.centre + np.einsum("stid,sd->sti", self.bases[modes], amounts)

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Means [K, T, 3] and covariances [K, T, 3, 3] of (x, z, yaw)."""
        means = self.centre + np.einsum("ktid,kd->kti", self.bases, self.means)
        roots = self.bases * self.deviations[:, None, None]
        return means, roots @ np.swapaxes(roots, -1, -2) + self.residual_covariance


def path_mixture(
    fitted: Coefficients,
    twists: FloatArray,  # [1, P, 6]
    ahead_s: FloatArray,  # [T]
) -> PathMixture:
    """The prior's answer to one past."""
    grid = fitted.centre(twists)
    weights, means, deviations = fitted.spread(twists, grid)
    nodes_s = fitted.centre.step_s * np.arange(grid.shape[1] + 1)
    # Deviations are 0 at time 0, linear between the steps of the grid, and go on as a line beyond.
    interpolation = make_interp_spline(nodes_s, np.eye(len(nodes_s)), k=1)(ahead_s)[:, 1:]  # [T, F]
    centre = _path_at(grid[0], ahead_s, fitted.centre.step_s)
    mirrored_state = motion_network.MIRRORED_STATE[:, None]
    rotations = Rotation.from_euler(
        "z", -centre[:, 2:]
    ).as_matrix()  # (x, z, yaw) from (right, ahead, yaw)
    basis = rotations @ np.einsum("tf,fid->tid", interpolation, fitted.spread.basis)
    mirrored = rotations @ np.einsum(
        "tf,fid->tid", interpolation, fitted.spread.basis * mirrored_state
    )
    variance = interpolation**2 @ fitted.spread.residual_variance
    return PathMixture(
        centre=centre,
        weights=weights,
        means=means,
        deviations=deviations,
        bases=np.repeat(np.stack([basis, mirrored]), len(weights) // 2, axis=0),
        residual_covariance=(rotations * variance[:, None]) @ np.swapaxes(rotations, 1, 2),
    )


@functools.cache
def load(path: Path | None) -> Coefficients:
    """The coefficients of a file (None: the packaged one), read once; BadData when it does not hold
    them.
    """
    source = path or Path(str(resources.files("geovp_classic.poses") / "motion_prior.npz"))
    try:
        fitted = unpacked(files.finite_arrays(source))
        path_mixture(
            fitted, np.zeros((1, NUM_PAST_STEPS, 6)), np.ones(1)
        )  # shapes that do not fit show here
        return fitted
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise BadData(
            f"{source} holds no motion prior ({error}): write one with fit-prior"
        ) from error


def unpacked(table: dict[str, FloatArray]) -> Coefficients:
    """Coefficients from the arrays of a file, as `fitting.prior.packed` names them."""

    def part(name: str, limit: float) -> tuple[Standardisation, Network]:
        layers = range(sum(key.startswith(f"{name}_weight") for key in table))
        weights, biases = (
            tuple(table[f"{name}_{kind}{layer}"] for layer in layers) for kind in ("weight", "bias")
        )
        return Standardisation(table[f"{name}_mean"], table[f"{name}_deviation"], limit), Network(
            weights, biases
        )

    inputs, network = part("centre", Standardisation.limit)
    centre = CentreModel(float(table["step_s"]), inputs, table["centre_scale"], network)
    spread = SpreadModel(
        *part("spread", motion_network.SPREAD_LIMIT),
        table["basis"],
        table["floor"],
        int(table["num_modes"]),
    )
    return Coefficients(centre, spread)


def _path_at(
    grid: FloatArray,  # [F, 3], states at 1..F steps
    ahead_s: FloatArray,  # [T]
    step_s: float,
) -> FloatArray:
    """States [T, 3]: a cubic spline through the grid; beyond it the last speed and
    turn rate go on.
    """
    nodes = np.concatenate([np.zeros((1, 3)), grid])
    inside_s = np.minimum(ahead_s, step_s * len(grid))
    states = CubicSpline(step_s * np.arange(len(nodes)), nodes)(inside_s)
    x, z, turned = grid[-1] - grid[-2]
    steps = (ahead_s - inside_s) / step_s
    angle = (
        turned * (steps + 1) / 2
    )  # between the last step's chord and the one to the time asked for
    chord = steps * np.sinc(turned * steps / (2 * np.pi))  # in lengths of the last step
    states[:, 0] += chord * (np.cos(angle) * x + np.sin(angle) * z)
    states[:, 1] += chord * (np.cos(angle) * z - np.sin(angle) * x)
    states[:, 2] += turned * steps
    return np.asarray(states)
