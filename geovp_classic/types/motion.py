"""A camera: its pinhole model, where it was, and where it will be."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.types.arrays import (
    BoolArray,
    FloatArray,
    ShortRepr,
    array_of,
    rigid,
    store,
    times,
)


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera without distortion; (0, 0) is the centre of the top-left pixel."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    width_px: int
    height_px: int

    def __post_init__(self) -> None:
        numbers = (self.fx_px, self.fy_px, self.cx_px, self.cy_px)
        if (
            not np.isfinite(numbers).all()
            or min(self.fx_px, self.fy_px, self.width_px, self.height_px) <= 0
        ):
            raise BadData(
                f"intrinsics {self} must be finite, with positive focal lengths and sizes"
            )

    @property
    def matrix(self) -> FloatArray:
        """The 3x3 calibration matrix K."""
        return np.array(
            [[self.fx_px, 0, self.cx_px], [0, self.fy_px, self.cy_px], [0, 0, 1]], dtype=np.float64
        )

    def cropped(self, left_px: int, top_px: int, width_px: int, height_px: int) -> Intrinsics:
        """The camera of image[top : top + height, left : left + width]."""
        return replace(
            self,
            cx_px=self.cx_px - left_px,
            cy_px=self.cy_px - top_px,
            width_px=width_px,
            height_px=height_px,
        )

    def resized(self, width_px: int, height_px: int) -> Intrinsics:
        """The camera of the image resized to width x height, edges kept on edges."""
        sx, sy = width_px / self.width_px, height_px / self.height_px
        cx_px, cy_px = (self.cx_px + 0.5) * sx - 0.5, (self.cy_px + 0.5) * sy - 0.5
        return Intrinsics(self.fx_px * sx, self.fy_px * sy, cx_px, cy_px, width_px, height_px)


@dataclass(frozen=True, repr=False)
class Trajectory(ShortRepr):
    """Where one camera was, step by step."""

    world_from_cam: FloatArray  # [T, 4, 4]
    times_s: FloatArray  # [T], increasing
    is_metric: bool  # True: lengths are metres; False: an unknown but constant unit
    scale_uncertainty: float | None = (
        None  # relative standard deviation of these metres, where they were estimated
    )

    def __post_init__(self) -> None:
        store(self, world_from_cam=rigid("world_from_cam", self.world_from_cam))
        store(self, times_s=times("times_s", self.times_s, self.world_from_cam.shape[0]))
        uncertainty = self.scale_uncertainty
        if uncertainty is not None and not (self.is_metric and 0 <= uncertainty < np.inf):
            raise BadData(
                f"scale_uncertainty is {uncertainty}, expected 0 or more of a metric "
                "trajectory, else None"
            )

    def __len__(self) -> int:
        """T, the number of steps."""
        return self.world_from_cam.shape[0]

    def __getitem__(self, steps: slice | BoolArray) -> Trajectory:
        """The steps of a slice or a mask [T], in the same world frame."""
        return replace(
            self,
            world_from_cam=self.world_from_cam[steps].copy(),
            times_s=self.times_s[steps].copy(),
        )

    def then(self, later: Trajectory) -> Trajectory:
        """These steps followed by later ones of the same world frame and unit."""
        if self.is_metric != later.is_metric:
            raise BadData(
                "a metric and a scale-free trajectory cannot be joined: give both the same unit"
            )
        poses = np.concatenate([self.world_from_cam, later.world_from_cam])
        return replace(
            self, world_from_cam=poses, times_s=np.concatenate([self.times_s, later.times_s])
        )


@dataclass(frozen=True, repr=False)
class Motion(ShortRepr):
    """Where the camera was and will be, from a pose source; all poses share the world frame of
    `past`.
    """

    past: Trajectory  # [P]
    futures: FloatArray  # [S, F, 4, 4]; S = 1 when deterministic
    tracked: BoolArray  # [P]; False where a pose was bridged instead of measured
    unrefined: Motion | None = (
        None  # the pose source's own, where refinements have corrected it since
    )

    def __post_init__(self) -> None:
        futures = np.asarray(self.futures, dtype=np.float64)
        if futures.ndim != 4:
            raise BadData(f"futures have shape {futures.shape}, expected [S, F, 4, 4]")
        store(self, futures=rigid("futures", futures))
        store(self, tracked=array_of("tracked", self.tracked, bool, (len(self.past),)))

    def refined(self, past: Trajectory, futures: FloatArray) -> Motion:
        """The same motion with better poses; the pose source's own are kept in `unrefined`."""
        return Motion(past, futures, self.tracked, self.unrefined or self)
