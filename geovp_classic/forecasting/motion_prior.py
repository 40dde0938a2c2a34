"""Motion prior fitted to recorded drives, with a calibrated distribution.

Two small networks see the camera's twists over the last 0.93 s. The first gives the central path as
a correction of a damped turn; it minimises the distance in metres and the absolute yaw error. The
second gives a mixture of Gaussians over smooth deviations from this path (turning, braking), fitted
to the errors of the first on held-out roads. Finally, the size of the predictive regions is
calibrated step by step.

The coefficients are fitted to ground-truth poses of KITTI odometry 00, 02, 08 and 09, and the size
of the regions to 01 and 04 as well (Geiger et al. 2012), by `benchmarks/studies/fitting`. The poses
are CC BY-NC-SA 3.0 and not included.
"""

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline, make_interp_spline
from scipy.spatial.transform import Rotation

from geovp_classic import files
from geovp_classic.errors import BadData
from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.motion_network import MIRRORED_STATE, Network, PriorCoefficients
from geovp_classic.forecasting.planar_forecaster import Modes, PlanarForecaster
from geovp_classic.geometry import planar, se3
from geovp_classic.types import FloatArray, Trajectory


@dataclass(frozen=True)
class MotionPrior(PlanarForecaster):
    """Networks fitted to how drivers move: a central path, or samples around it.

    The past is resampled to steps of 0.1037 s; a shorter past is continued backwards. A stationary
    camera stays where it is, unless several samples are asked for. Beyond the fitted 2.2 s the path
    keeps its last speed and turn rate.
    """

    coefficients: Path | None = None  # a file; None: the packaged one
    num_past_steps: int = 9  # those of the fit: ten poses of the protocol
    # Faster turns are not in the training poses, and are clipped: a full lock at 7 m/s.
    max_turn_rad_s: float = 1.5

    def paths(
        self,
        past: Trajectory,
        ahead_s: FloatArray,  # [F]
        num_samples: int,
    ) -> FloatArray:
        """Return the central path [1, F, 3], or smooth samples [S, F, 3] around it."""
        is_stationary = (past.world_from_cam == past.world_from_cam[-1]).all()
        if len(past) == 1 or (is_stationary and num_samples == 1):
            return np.zeros((num_samples, len(ahead_s), 3))
        fitted, twists = self._features(past)
        if num_samples == 1:
            grid = fitted.central_paths(twists)
            return _path_at(grid[0], ahead_s / fitted.step_s)[None]
        return path_mixture(fitted, twists, ahead_s).sample(num_samples, self.seed)

    def modes(
        self,
        past: Trajectory,
        ahead_s: FloatArray,  # [F]
    ) -> Modes:
        """Return the mixture; raise BadData for a single past pose."""
        if len(past) == 1:
            raise BadData("a single past pose has no predictive distribution: give at least two")
        mixture = path_mixture(*self._features(past), ahead_s)
        return mixture.weights, mixture.means, mixture.covariances

    def _features(self, past: Trajectory) -> tuple[PriorCoefficients, FloatArray]:
        """Return what was fitted, and the twists [1, P, 6] on its grid, within its range."""
        fitted = load(self.coefficients)
        twists = past_motion.twists_per_s(past, fitted.step_s, self.num_past_steps)
        limit = self.max_turn_rad_s
        twists[:, 3:] = np.clip(twists[:, 3:], -limit, limit)
        return fitted, twists[None]


@dataclass(frozen=True)
class PathMixture:
    """K modes of smooth paths (x, z, yaw) in metres, at T future times."""

    weights: FloatArray  # [K]
    means: FloatArray  # [K, T, 3]
    roots: FloatArray  # [K, T, 3, D], effect of D independent unit Gaussians
    residual_covariance: FloatArray  # [T, 3, 3]

    def sample(
        self,
        num_samples: int,
        seed: int,
    ) -> FloatArray:
        """Draw smooth paths [S, T, 3], without the residual, which is not smooth."""
        rng = np.random.default_rng(seed)
        modes = rng.choice(len(self.weights), size=num_samples, p=self.weights)
        white = rng.standard_normal((num_samples, self.roots.shape[-1]))
        deviations = np.einsum("stid,sd->sti", self.roots[modes], white)
        return self.means[modes] + deviations

    @property
    def covariances(self) -> FloatArray:
        """Covariances [K, T, 3, 3] of (x, z, yaw)."""
        smooth = self.roots @ np.swapaxes(self.roots, -1, -2)
        return smooth + self.residual_covariance


def path_mixture(
    fitted: PriorCoefficients,
    twists: FloatArray,  # [1, P, 6]
    ahead_s: FloatArray,  # [T]
) -> PathMixture:
    """Return the distribution of paths after one past."""
    # 1. The networks: a central path on the grid, and a mixture of deviations from it.
    grid = fitted.central_paths(twists)
    weights, means, deviations = fitted.modes(twists, grid)

    # 2. The central path at the times asked for.
    steps = ahead_s / fitted.step_s
    centre = _path_at(grid[0], steps)

    # 3. The deviations at these times. They are 0 at time 0, linear between the steps of the grid,
    # and continue beyond it. `hats` is the effect of each node on a time.
    nodes = np.arange(grid.shape[1] + 1)
    hats = make_interp_spline(nodes, np.eye(len(nodes)), k=1)
    interpolation = hats(steps)[:, 1:]  # [T, F]
    basis = np.einsum("tf,fid->tid", interpolation, fitted.basis)
    # The second half of the modes is mirrored.
    both = np.stack([basis, basis * MIRRORED_STATE[:, None]])
    variance = interpolation**2 @ fitted.residual_variance

    # 4. Rotate deviations from (right, ahead, yaw) along the path into (x, z, yaw).
    rotations = Rotation.from_euler("z", -centre[:, 2:]).as_matrix()
    covariance = (rotations * variance[:, None]) @ np.swapaxes(rotations, 1, 2)
    bases = np.repeat(rotations @ both, len(weights) // 2, axis=0)

    # 5. Mode k is centre + basis (mean_k + deviation_k * white noise) + residual.
    return PathMixture(
        weights=weights,
        means=centre + np.einsum("ktid,kd->kti", bases, means),
        roots=bases * deviations[:, None, None],
        residual_covariance=covariance,
    )


@functools.cache
def load(path: Path | None) -> PriorCoefficients:
    """Read the coefficients of a file (None: the packaged one); raise BadData for another file."""
    source = path or files.PACKAGED / "motion_prior.npz"
    arrays = files.read_npz(source)

    def network(name: str, limit: float) -> Network:
        return Network(
            mean=arrays[f"{name}_mean"],
            deviation=arrays[f"{name}_deviation"],
            limit=limit,
            weights=[arrays[f"{name}_weight{layer}"] for layer in range(3)],
            biases=[arrays[f"{name}_bias{layer}"] for layer in range(3)],
        )

    advice = "fit one with `benchmarks/studies fitting`"
    with files.checked(f"{source} holds no motion prior", advice):
        return PriorCoefficients(
            step_s=float(arrays["step_s"]),
            centre_scale=arrays["centre_scale"],
            centre=network("centre", limit=8.0),  # as in the fit
            # Faster driving than in training has the spread of the fastest.
            spread=network("spread", limit=3.0),
            basis=arrays["basis"],
            residual_variance=arrays["floor"],
        )


def _path_at(
    grid: FloatArray,  # [F, 3], states at 1..F steps
    steps: FloatArray,  # [T]
) -> FloatArray:
    """Return states [T, 3]: a cubic spline, and beyond the grid its last screw motion."""
    # Within the grid: a smooth path from the last pose, at which all states are 0.
    nodes = np.concatenate([np.zeros((1, 3)), grid])
    spline = CubicSpline(np.arange(len(nodes)), nodes)
    states = spline(np.minimum(steps, len(grid)))
    # Beyond it: the motion of the last step of the grid, as rigid motions.
    is_beyond = steps > len(grid)
    ends = planar.lift(nodes[-2:], np.eye(4), np.eye(4))
    times = np.array([len(grid) - 1.0, len(grid)])
    continued = se3.interpolate(ends, times, steps[is_beyond])
    states[is_beyond] = planar.reduce(continued, np.eye(4), np.eye(4))
    return states
