"""Scale of an odometry without metres."""

from dataclasses import dataclass, field

import numpy as np

from geovp_classic.interfaces import ScaleEstimator
from geovp_classic.types import ByteArray, FloatArray, Intrinsics, PrivilegedInput


@dataclass(frozen=True)
class UnitSpeed:
    """Lengths in mean steps, in a trajectory that is not metric."""

    needs = PrivilegedInput.NONE
    is_metric = False

    def estimator(
        self,
        intrinsics: Intrinsics,
        camera_height_m: float | None,
        pitch_rad: float = 0.0,
    ) -> ScaleEstimator:
        """Return an estimator without measurements."""
        return UnitScale()


@dataclass
class UnitScale:
    """Estimator of a unit that stays unknown.

    Its values are those that `ScaleEstimator` defines for a scale without measurements.
    """

    unit: float = 1.0  # metres, as if the odometry's unit were one
    units: FloatArray = field(default_factory=lambda: np.zeros(0))
    uncertainty: float = np.inf  # relative: nothing is known

    def finalize(self, length: float, duration_s: float) -> None:
        """Assume nothing."""

    def update(
        self,
        before: ByteArray,
        now: ByteArray,
        before_from_now: FloatArray,
    ) -> None:
        """Ignore the images."""

    def restart(self) -> None:
        """Change nothing."""
