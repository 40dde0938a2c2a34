"""Models of the motion prior: a central path, and a mixture of smooth deviations from it.

The past is twists per second [N, P, 6] of the camera over P steps of an even grid. A past and its
future are as likely as their mirror images.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import expit, softmax

from geovp_classic.forecasting.past_motion import Axis
from geovp_classic.types import FloatArray

MIRRORED_TWIST = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0])
MIRRORED_STATE = np.array([-1.0, 1.0, -1.0])


@dataclass(frozen=True)
class Network:
    """Ensemble of M multilayer perceptrons with SiLU activations on standardised features."""

    mean: FloatArray  # [in]
    deviation: FloatArray  # [in]
    limit: float  # deviations at which features are clipped
    weights: list[FloatArray]  # each [M, in, out]
    biases: list[FloatArray]  # each [M, 1, out]

    def __call__(self, features: FloatArray) -> FloatArray:
        """Return outputs [M, N, out] of features [N, in]."""
        hidden = self.standardised(features).astype(np.float32)
        *inner, last = zip(self.weights, self.biases, strict=True)
        for weight, bias in inner:
            linear = hidden @ weight + bias
            hidden = linear * expit(linear)
        return hidden @ last[0] + last[1]

    def standardised(self, features: FloatArray) -> FloatArray:
        """Return features [N, in] of mean 0 and deviation 1, clipped."""
        standardised = (features - self.mean) / self.deviation
        return np.clip(standardised, -self.limit, self.limit)


@dataclass(frozen=True)
class PriorCoefficients:
    """Fitted models of the motion prior: F future steps, K modes of D smooth deviations."""

    step_s: float
    centre_scale: FloatArray  # [F, 3], of the corrections of a damped turn
    centre: Network
    spread: Network
    basis: FloatArray  # [F, 3, D], the deviations as (right, ahead, yaw) of the path
    residual_variance: FloatArray  # [F, 3], outside the basis

    def central_paths(
        self,
        twists: FloatArray,  # [N, P, 6], per second
    ) -> FloatArray:
        """Return states [N, F, 3], averaged over the ensemble and the mirror image."""
        # Predict the past and its mirror image, so that left and right are treated alike.
        both = with_mirrored(twists)
        corrections = self.centre(past_features(both)).mean(axis=0)
        shape = self.centre_scale.shape
        paths = damped_turn(both, self.step_s, len(self.centre_scale))
        # The networks' mean is a correction of a damped turn.
        paths += corrections.reshape(-1, *shape) * self.centre_scale
        # Mirror the second half back, and average.
        ahead, mirrored = np.split(paths, 2)
        return 0.5 * (ahead + mirrored * MIRRORED_STATE)

    def modes(
        self,
        twists: FloatArray,  # [1, P, 6], per second
        centre: FloatArray,  # [1, F, 3], the central path
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return weights [2K], means [2K, D] and deviations [2K, D] of Gaussians (Bishop 1994).

        The second half is of the mirrored past and belongs to the mirrored basis.
        """
        features = spread_features(with_mirrored(twists), with_mirrored(centre))
        outputs = np.swapaxes(self.spread(features), 0, 1).astype(np.float64)
        # Split the outputs: K logits, K x D means, K x D log deviations of each member.
        depth = self.basis.shape[-1]
        num_modes = outputs.shape[-1] // (1 + 2 * depth)
        borders = [num_modes, num_modes * (1 + depth)]
        logits, means, log_deviations = np.split(outputs, borders, axis=-1)
        # The members' mixtures, and those of the mirror image, are one mixture with equal parts.
        weights = softmax(logits, axis=-1).reshape(-1)
        # The bounds are those of the fit.
        deviations = np.exp(np.clip(log_deviations, -4.0, 3.0))
        return (
            weights / weights.sum(),
            means.reshape(-1, depth),
            deviations.reshape(-1, depth),
        )


def damped_turn(
    twists: FloatArray,  # [N, P, 6], per second
    step_s: float,
    num_steps: int,
    # of the turn rate, per step; chosen on train, corrected by the network
    turn_decay: float = 0.95,
    # steps that give the turn rate and the acceleration; chosen on train
    num_recent: int = 3,
) -> FloatArray:
    """Return states [N, F, 3] at constant acceleration, with a decaying turn rate."""
    # Constant acceleration, until braking ends at rest.
    past = twists[..., Axis.FORWARD]
    last = past[:, -1:]
    change = (last - past[:, -1 - num_recent, None]) / num_recent  # per step
    speeds = last + change * np.arange(num_steps + 1)
    speeds[speeds * last < 0] = 0.0  # braking ends at rest
    chord = 0.5 * (speeds[:, 1:] + speeds[:, :-1]) * step_s
    # A turn that decays exponentially and ends with the motion. A camera that turns without any
    # speed goes on turning: it is not in a vehicle.
    turn_rate = twists[:, -num_recent:, Axis.YAW].mean(axis=1)
    decay = turn_decay ** np.arange(1, num_steps + 1)
    turns = turn_rate[:, None] * decay * step_s
    turns[(chord == 0) & (last != 0)] = 0.0
    # Each step is a chord of its arc.
    yaw = np.cumsum(turns, axis=1)
    chord_yaw = yaw - turns / 2
    x = np.cumsum(chord * np.sin(chord_yaw), axis=1)
    z = np.cumsum(chord * np.cos(chord_yaw), axis=1)
    return np.stack([x, z, yaw], axis=-1)


def past_features(
    twists: FloatArray,  # [N, P, 6], per second
) -> FloatArray:
    """Return the changes from step to step and the last twist [N, P * 6]."""
    steps = np.concatenate([np.diff(twists, axis=1), twists[:, -1:]], axis=1)
    return steps.reshape(len(twists), -1)


def spread_features(
    twists: FloatArray,  # [N, P, 6], per second
    centre: FloatArray,  # [N, F, 3], the central paths
    num_recent: int = 3,  # steps
    path_steps: tuple[int, ...] = (4, 9, 19),  # of the central path: .5, 1 and 2 s ahead
    # Added to changes, so that their logarithms are finite: errors of recorded poses
    velocity_floor: float = 1e-2,  # m/s
    turn_floor: float = 1e-3,  # rad/s
) -> FloatArray:
    """Return the past, the central path, and logarithms of how much both change [N, in].

    The fitted networks depend on all settings: change them together with a new fit.
    """
    noise_floor = np.repeat([velocity_floor, turn_floor], 3)
    jitter = np.sqrt((np.diff(twists, 2, axis=1) ** 2).mean(axis=1))
    changes = np.sqrt((np.diff(twists, axis=1) ** 2).mean(axis=1))
    recent_change = np.abs(twists[:, -1] - twists[:, -1 - num_recent])
    turn_rate = np.abs(twists[..., Axis.YAW])
    speed = twists[..., Axis.FORWARD]
    motion = [
        jitter + noise_floor,
        changes + noise_floor,
        turn_rate.mean(axis=1) + turn_floor,
        turn_rate[:, -num_recent:].mean(axis=1) + turn_floor,
        recent_change[:, Axis.YAW] + turn_floor,
        # Floors of the scales that matter: a crawl, three times the noise, half a degree of yaw.
        np.abs(speed).mean(axis=1) + 0.1,
        recent_change[:, Axis.FORWARD] + 0.03,
        np.abs(centre[:, -1, 2]) + 1e-2,
    ]
    return np.column_stack(
        [
            past_features(twists),
            speed.mean(axis=1),
            centre[:, path_steps].reshape(len(twists), -1),
            np.log(np.column_stack(motion)),
        ]
    )


def with_mirrored(values: FloatArray) -> FloatArray:
    """Return twists [N, P, 6] or states [N, F, 3], followed by their mirror images [2N, ...]."""
    sign = MIRRORED_TWIST if values.shape[-1] == 6 else MIRRORED_STATE
    return np.concatenate([values, values * sign])
