"""Windows of pose files: what was driven before, and how the future leaves a constant turn, with
the record's noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import comb

import numpy as np
import numpy.typing as npt

from geovp_benchmarks.progress import Progress, no_progress
from geovp_classic.errors import BadData
from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.body_motion import over_plane
from geovp_classic.forecasting.constant import ConstantTurn, ConstantVelocity
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.geometry import planar, se3
from geovp_classic.parallel import single_threaded_blas
from geovp_classic.types import BoolArray, FloatArray, Trajectory
from studies.fitting.windows import STEP_S, along_path, drivable_steps

COMPONENTS = ("along", "across", "height", "pitch", "roll", "yaw")  # metres and radians
MIRRORED = np.array(
    [1.0, -1.0, 1.0, 1.0, -1.0, -1.0]
)  # of a deviation, when left and right are swapped
HORIZONS = np.array([1, 5, 10, 15, 20])
LONG_STEPS, SHORT_STEPS = 29, 9  # of the past: 3 s, and the 0.93 s that forecasters see
NOISE_ORDER = 6  # of the differences that show the noise of recorded poses


@dataclass(frozen=True)
class Windows:
    """N pasts; deviations are of H horizons from a constant turn that keeps height,
    pitch and roll.
    """

    sequences: npt.NDArray[np.str_]  # [N]
    twists: FloatArray  # [N, LONG_STEPS, 6], per second
    truth: FloatArray  # [N, H, 6]
    straight: FloatArray  # [N, H, 6], of constant velocity
    prior: FloatArray  # [N, H, 6], of the packaged motion prior
    # [N, H, 6], what another draw of the record's noise would have changed the truth by
    noise: FloatArray

    def __len__(self) -> int:
        return len(self.twists)

    def __getitem__(self, which: BoolArray) -> Windows:
        parts = (self.twists, self.truth, self.straight, self.prior, self.noise)
        return Windows(self.sequences[which], *(part[which] for part in parts))


@single_threaded_blas
def read(
    sequences: Mapping[str, Trajectory], stride: int, progress: Progress = no_progress
) -> Windows:
    """All windows that a car could have driven, in the order of time; BadData when
    there is none.
    """
    columns: list[list[FloatArray]] = [[] for _ in range(5)]
    names: list[str] = []
    for number, (name, recorded) in enumerate(sequences.items()):
        progress(number, len(sequences))
        usable, shaken = (
            drivable_steps(recorded),
            with_noise(recorded, pose_noise(recorded), number),
        )
        for last in range(LONG_STEPS + 1, len(recorded) - HORIZONS[-1], stride):
            first = last - LONG_STEPS - 1
            if usable[first : last + HORIZONS[-1]].all():
                for column, values in zip(
                    columns, _window(recorded, shaken, first, last), strict=True
                ):
                    column.append(values)
                names.append(name)
    progress(len(sequences), len(sequences))
    if not names:
        raise BadData(
            f"no window of 5 s that a car could have driven in {', '.join(sequences)}: give "
            "longer poses"
        )
    return Windows(np.array(names), *(np.stack(column) for column in columns))


def _window(
    recorded: Trajectory, shaken: FloatArray, first: int, last: int
) -> tuple[FloatArray, ...]:
    """Twists, and the four kinds of deviations, of the window whose last observed pose
    is `last`.
    """
    past, ahead = recorded[first : last + 1], last + HORIZONS
    times_s, future = recorded.times_s[ahead], recorded.world_from_cam[ahead]
    base = states(ConstantTurn().forecast(past, times_s)[0], past)
    redrawn = past.world_from_cam[-1] @ se3.inverse(shaken[last]) @ shaken[ahead]
    truth = deviations(future, past, base)
    straight = deviations(ConstantVelocity().forecast(past, times_s)[0], past, base)
    straight[:, 2:5] = (
        0.0  # like the baseline's, its height, pitch and roll are those of the last pose
    )
    observed = past[-10:]
    return (
        past_motion.twists_per_s(past, STEP_S, LONG_STEPS),
        truth,
        straight,
        deviations(MotionPrior().forecast(observed, times_s)[0], past, base),
        deviations(redrawn, past, base) - truth,
    )


def states(world_from_cam: FloatArray, past: Trajectory) -> FloatArray:
    """(x, z, yaw) [H, 3] on the plane that the last second suggests."""
    plane = past_motion.vehicle_from_cam(past[-10:])
    return planar.reduce(world_from_cam, past.world_from_cam[-1], plane)


def deviations(world_from_cam: FloatArray, past: Trajectory, base: FloatArray) -> FloatArray:
    """COMPONENTS [H, 6] of cameras [H, 4, 4] against planar states [H, 3] and the last height,
    pitch and roll.
    """
    off = states(world_from_cam, past) - base
    off[:, 2] = (off[:, 2] + np.pi) % (2 * np.pi) - np.pi
    across, along, yaw = along_path(off, base).T
    return np.stack([along, across, *over_plane(world_from_cam, past[-10:]).T, yaw], axis=1)


def pose_noise(recorded: Trajectory) -> FloatArray:
    """Standard deviations [6] (metres, radians) of independent noise of the poses, in the camera's
    frame.

    From the median of sixth differences, in which a motion slower than 2 Hz leaves less than a
    tenth of itself, and white noise sqrt(12! / 6!^2) times its own deviation. Noise that lasts
    longer than some frames is not seen, and a real jolt of more than 3 Hz counts as noise.
    """
    poses, step_s = recorded.world_from_cam, np.diff(recorded.times_s)
    steps = se3.log(se3.inverse(poses[:-1]) @ poses[1:]) * (step_s.mean() / step_s)[:, None]
    rough = np.abs(np.diff(steps, NOISE_ORDER - 1, axis=0))
    return np.asarray(
        np.median(rough, axis=0) / 0.6745 / np.sqrt(comb(2 * NOISE_ORDER, NOISE_ORDER))
    )


def with_noise(recorded: Trajectory, deviation: FloatArray, seed: int) -> FloatArray:
    """Poses [T, 4, 4] with more independent noise of so much."""
    drawn = np.random.default_rng(seed).standard_normal((len(recorded), 6)) * deviation
    return recorded.world_from_cam @ se3.exp(drawn)
