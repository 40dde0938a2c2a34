"""The scale of an odometry without metres."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.interfaces import ScaleEstimator
from geovp_classic.types import ByteArray, FloatArray, Intrinsics, PrivilegedInput


@dataclass(frozen=True)
class UnitSpeed:
    """No metres: lengths are in mean steps, and the trajectory says so."""

    needs = PrivilegedInput.NONE
    is_metric = False

    def estimator(
        self, intrinsics: Intrinsics, camera_height_m: float | None, pitch_rad: float = 0.0
    ) -> ScaleEstimator:
        """An estimator that measures nothing."""
        return UnitScale()


@dataclass
class UnitScale:
    """One unit is one unit."""

    unit: float = 1.0
    confidence: float = 0.0
    uncertainty: float = np.inf

    def finalize(self, length: float, duration_s: float) -> None:
        """Nothing to assume."""

    def update(
        self, before: ByteArray, now: ByteArray, before_from_now: FloatArray, radial: float = 0.0
    ) -> None:
        """Nothing to learn."""

    def restart(self) -> None:
        """Nothing to forget."""
