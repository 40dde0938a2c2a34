"""Random walk through noisy measurements, among outliers."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class RandomWalk:
    """Smoothing with noise and steps that are estimated from the measurements.

    Measurements have Student-t noise. Its size, and that of the steps, are estimated by
    expectation maximisation (Shumway & Stoffer 1982), with their defaults as prior.
    """

    # default standard deviation of a step: a height that drifts by 2 % in 100 frames
    step: float = 0.002
    # measurements that the defaults count for: two seconds at 10 Hz
    prior_weight: float = 20.0
    # of Student's distribution; 4 is the usual choice for outliers (Lange et al. 1989)
    degrees_of_freedom: float = 4.0
    # of the first round's step to the default; EM shrinks a step that is too large, but hardly
    # enlarges one that is too small
    start_ratio: float = 10.0
    num_rounds: int = 15  # a further one changes a logarithm of height by about .001
    # variance of the first value, and of one after an infinite step: of logarithms, unknown
    initial_variance: float = 1e6

    def smooth(
        self,
        measured: FloatArray,  # [N]; NaN: not measured
        deviation: FloatArray,  # [N], default standard deviations
        step_ratio: FloatArray,  # [N], steps to each value, relative; inf: unrelated values
    ) -> tuple[FloatArray, FloatArray]:
        """Return the values [N] of the walk and their standard deviations [N]."""
        is_measured = np.isfinite(measured)
        measured = np.nan_to_num(measured)
        precision = np.where(is_measured, 1 / deviation**2, 0.0)
        step_ratio2 = step_ratio[1:] ** 2
        is_related = np.isfinite(step_ratio2)
        weight = np.ones(len(measured))
        noise2 = 1.0
        step2 = (self.start_ratio * self.step) ** 2
        for _ in range(self.num_rounds):
            # E-step: the walk given the noise and the steps.
            steps2 = np.where(is_related, step2 * step_ratio2, self.initial_variance)
            mean, variance, lag_covariance = rauch_tung_striebel(
                measured, weight * precision / noise2, steps2, self.initial_variance
            )
            # M-step of the noise: expected squared errors, then Student's weights for them.
            error2 = ((measured - mean) ** 2 + variance) * precision
            noise2 = max(1.0, self._update(1.0, (weight * error2)[is_measured]))
            weight = (self.degrees_of_freedom + 1) / (self.degrees_of_freedom + error2 / noise2)
            # M-step of the steps: expected squares of the walk's differences.
            moved2 = np.diff(mean) ** 2 + variance[1:] + variance[:-1] - 2 * lag_covariance
            step2 = self._update(self.step**2, (moved2 / step_ratio2)[is_related])
        return mean, np.sqrt(variance)

    def _update(self, default: float, squares: FloatArray) -> float:
        """Return the mean of squares [M], and of the default with its weight."""
        total = self.prior_weight * default + squares.sum()
        return float(total / (self.prior_weight + len(squares)))


def rauch_tung_striebel(
    measured: FloatArray,  # [N]
    information: FloatArray,  # [N], inverse variances of the measurements; 0: not measured
    steps2: FloatArray,  # [N - 1], variances of the steps
    initial_variance: float,  # of the first value, around 0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return means [N], variances [N] and covariances of neighbours [N - 1] of a random walk.

    Scalar form of Rauch, Tung & Striebel 1965. On Python's floats it takes a twentieth of the
    time of filterpy's `batch_filter` and `rts_smoother`, which handle matrices.
    """
    # Forward: Kalman filter. A value is predicted to stay where it is.
    mean = 0.0
    variance = initial_variance
    filtered = []
    for value, value_information, step2 in zip(
        measured.tolist(), information.tolist(), [0.0, *steps2.tolist()], strict=True
    ):
        variance += step2
        gain = variance * value_information / (1.0 + variance * value_information)
        mean += gain * (value - mean)
        variance *= 1.0 - gain
        filtered.append((mean, variance))
    # Backward: what the later values say about each one.
    smoothed = [filtered[-1]]
    lag_covariances = []
    for (mean, variance), step2 in zip(filtered[-2::-1], steps2[::-1].tolist(), strict=True):
        later_mean, later_variance = smoothed[-1]
        predicted_variance = variance + step2
        gain = variance / predicted_variance
        lag_covariances.append(gain * later_variance)
        mean += gain * (later_mean - mean)
        variance += gain**2 * (later_variance - predicted_variance)
        smoothed.append((mean, variance))
    means, variances = np.array(smoothed[::-1]).T
    return means, variances, np.array(lag_covariances[::-1])
