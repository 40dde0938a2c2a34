"""Camera model, trajectory and motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.types.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    ShortRepr,
    store_checked,
    store_rigid,
    store_times,
)


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole camera without distortion; (0, 0) is the centre of the top-left pixel."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    width_px: int
    height_px: int

    def __post_init__(self) -> None:
        is_finite = np.isfinite(self.matrix).all()
        if not is_finite or min(self.fx_px, self.fy_px, self.width_px, self.height_px) <= 0:
            raise BadData(f"{self} must be finite, with positive focal lengths and sizes")
        if not all(isinstance(size, (int, np.integer)) for size in self.size_px):
            raise BadData(f"{self} must have a whole number of pixels: give sizes as int")

    @property
    def matrix(self) -> FloatArray:
        """Return the 3x3 calibration matrix K."""
        rows = [
            [self.fx_px, 0, self.cx_px],
            [0, self.fy_px, self.cy_px],
            [0, 0, 1],
        ]
        return np.array(rows, dtype=np.float64)

    @property
    def size_px(self) -> tuple[int, int]:
        """Return (width, height)."""
        return self.width_px, self.height_px

    def cropped(self, left_px: int, top_px: int, width_px: int, height_px: int) -> Intrinsics:
        """Return the camera of image[top : top + height, left : left + width]."""
        return replace(
            self,
            cx_px=self.cx_px - left_px,
            cy_px=self.cy_px - top_px,
            width_px=width_px,
            height_px=height_px,
        )

    def resized(self, width_px: int, height_px: int) -> Intrinsics:
        """Return the camera of the resized image; image edges stay on image edges."""
        sx = width_px / self.width_px
        sy = height_px / self.height_px
        cx_px = (self.cx_px + 0.5) * sx - 0.5
        cy_px = (self.cy_px + 0.5) * sy - 0.5
        return Intrinsics(self.fx_px * sx, self.fy_px * sy, cx_px, cy_px, width_px, height_px)


@dataclass(frozen=True, repr=False)
class Trajectory(ShortRepr):
    """Poses of one camera over time."""

    world_from_cam: FloatArray  # [T, 4, 4]
    times_s: FloatArray  # [T], increasing
    # True: lengths are metres; False: an unknown but constant unit
    is_metric: bool
    # relative standard deviation of estimated metres
    scale_uncertainty: float | None = None

    def __post_init__(self) -> None:
        store_rigid(self, "world_from_cam", 3)
        store_times(self, len(self.world_from_cam))
        uncertainty = self.scale_uncertainty
        if uncertainty is not None and not (self.is_metric and 0 <= uncertainty < np.inf):
            raise BadData(
                f"scale_uncertainty is {uncertainty}, expected 0 or more of a metric trajectory, "
                "else None"
            )

    def __len__(self) -> int:
        """Return T, the number of steps."""
        return len(self.world_from_cam)

    def __getitem__(self, steps: slice | BoolArray | IntArray) -> Trajectory:
        """Return the steps of a slice, a mask [T] or numbers, in the same world frame."""
        poses = self.world_from_cam[steps].copy()
        return replace(self, world_from_cam=poses, times_s=self.times_s[steps].copy())


@dataclass(frozen=True, repr=False)
class Motion(ShortRepr):
    """Past and future poses of the camera, in the world frame of `past`."""

    past: Trajectory  # [P]
    futures: FloatArray  # [S, F, 4, 4]; S = 1 when deterministic
    # [P]; False for a pose that was bridged instead of measured
    tracked: BoolArray
    # Component that forecast the futures; None: not known, or they were not forecast
    forecaster: Any = None
    # By an operator: what was observed says nothing about the futures
    is_commanded: bool = False

    def __post_init__(self) -> None:
        store_rigid(self, "futures", 4)
        store_checked(self, "tracked", bool, (len(self.past),))
