"""Stereo depth from the right images of the last frames: the upper bound for depth
from one camera.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.depth.completion import fill_from_background
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.geometry import pinhole
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Context,
    ExtraView,
    FloatArray,
    Intrinsics,
    PrivilegedInput,
    Trajectory,
)

BLOCK_PX = 5
# how far from a pure shift to the right the second camera may be: radians, and shares of the
# baseline
LEVEL = 0.01
UNIT_PX = 1 / 16  # OpenCV's disparities count sixteenths


@dataclass(frozen=True)
class Stereo:
    """Semi-global block matching (Hirschmueller 2008, OpenCV's) of frames with the right images of
    their instants.
    """

    frames: tuple[int, ...] = (
        -1,
    )  # steps whose depth is wanted, counted from the end when negative
    nearest_m: float = 4.0  # nearer surfaces are not searched for

    def __post_init__(self) -> None:
        if not self.frames or not self.nearest_m > 0:
            raise BadData(
                f"stereo: frames {self.frames}, nearest_m {self.nearest_m}: expected a frame "
                "and a distance"
            )

    needs = PrivilegedInput.RIGHT_FRAMES  # the right images

    def inverse_depths(self, context: Context, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        """Inverse depth [P, H, W] per metre and confidence [P, H, W]: 1 where matched, 0 where
        filled or not wanted.

        Incompatible without right images, with unrectified ones, or when the poses are not in
        metres.
        """
        if context.right is None:
            raise Incompatible(
                "stereo needs right images, the clip has none: choose depth from one camera"
            )
        if not past.is_metric:
            raise Incompatible(
                "stereo depth is in metres, the poses are not: give the odometry a scale"
            )
        baseline_m, num_past = _baseline_m(context.right), context.num_past
        if not all(-num_past <= frame < num_past for frame in self.frames):
            raise BadData(
                f"stereo: frames {self.frames} of {num_past} observed ones: choose from "
                f"-{num_past} to -1"
            )
        inverse_depths, confidence = np.zeros((2, *context.frames.shape[:3]), np.float32)
        camera = context.intrinsics
        for step in {frame % num_past for frame in self.frames}:
            disparity_px, matched = self._disparity_px(
                context.frames[step], context.right, step, camera, baseline_m
            )
            found = np.maximum(disparity_px, 0) / (baseline_m * camera.fx_px)
            inverse_depths[step], confidence[step] = fill_from_background(found, matched), matched
        return inverse_depths, confidence

    def _disparity_px(
        self, frame: ByteArray, right: ExtraView, step: int, camera: Intrinsics, baseline_m: float
    ) -> tuple[FloatArray, BoolArray]:
        """Disparity [H, W] in pixels of the frame, and where it was found."""
        num = int(np.ceil(baseline_m * camera.fx_px / self.nearest_m / 16)) * 16
        left = np.pad(frame, ((0, 0), (num, 0), (0, 0)), mode="edge")
        matcher = cv2.StereoSGBM.create(
            numDisparities=num,
            blockSize=BLOCK_PX,
            P1=8 * BLOCK_PX**2,
            P2=32 * BLOCK_PX**2,
            disp12MaxDiff=1,
            uniquenessRatio=5,
            speckleWindowSize=60,
            speckleRange=2,
            mode=cv2.STEREO_SGBM_MODE_HH,
        )
        other = right_at_scale(right, step, camera, num)
        found = matcher.compute(
            pinhole.grey(left).astype(np.uint8), pinhole.grey(other).astype(np.uint8)
        )[:, num:]
        return found.astype(np.float32) * np.float32(UNIT_PX), np.asarray(found >= 0)


def right_at_scale(
    right: ExtraView,
    step: int,
    camera: Intrinsics,
    left_px: int,
) -> ByteArray:
    """The right image [H, left_px + W, 3] as `camera` would see it from there, with columns added
    on its left.

    Rows then match those of the camera's own image, and columns differ by the disparity alone.
    """
    own = right.intrinsics
    width_px = max(1, round(own.width_px * camera.fx_px / own.fx_px))
    height_px = max(1, round(own.height_px * camera.fy_px / own.fy_px))
    small = cv2.resize(right.frames[step], (width_px, height_px), interpolation=cv2.INTER_AREA)
    own = own.resized(width_px, height_px)
    su, sv = camera.fx_px / own.fx_px, camera.fy_px / own.fy_px  # next to 1
    shift_u, shift_v = camera.cx_px + left_px - su * own.cx_px, camera.cy_px - sv * own.cy_px
    size_px = (camera.width_px + left_px, camera.height_px)
    affine = np.array([[su, 0, shift_u], [0, sv, shift_v]])
    moved = cv2.warpAffine(
        small, affine, size_px, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(moved, np.uint8)


def _baseline_m(right: ExtraView) -> float:
    """The distance of the two cameras; Incompatible unless the right one is shifted along x and no
    more.
    """
    rotation, shift = right.view_from_cam[:3, :3], right.view_from_cam[:3, 3]
    baseline_m = float(-shift[0])
    tilted = np.abs(rotation - np.eye(3)).max() > LEVEL or np.abs(shift[1:]).max() > LEVEL * abs(
        baseline_m
    )
    if baseline_m <= 0 or tilted:
        raise Incompatible(
            "stereo needs rectified images with the second camera to the right: rectify them first"
        )
    return baseline_m
