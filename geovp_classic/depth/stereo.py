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
    ByteArray,
    Context,
    ExtraView,
    FloatArray,
    Intrinsics,
    PrivilegedInput,
    Trajectory,
)


@dataclass(frozen=True)
class Stereo:
    """Semi-global block matching (Hirschmueller 2008, OpenCV's) of frames with the right images of
    their instants.
    """

    # Nearer surfaces are not searched for. KITTI's lowest row shows the road at 5.8 m.
    nearest_m: float = 4.0
    block_px: int = 5  # OpenCV suggests 3 to 11
    max_difference_px: int = 1  # of the disparities from left and right: rounding
    # By which the best match must win; OpenCV suggests 5 to 15.
    uniqueness_percent: int = 5
    max_speckle_px: int = 60  # area; OpenCV suggests 50 to 200
    max_speckle_step_px: int = 2  # OpenCV suggests 1 or 2
    # In radians, and relative to the baseline. Set by hand: rounded calibrations pass.
    max_rectification_error: float = 0.01

    needs = PrivilegedInput.RIGHT_FRAMES

    def __post_init__(self) -> None:
        if not self.nearest_m > 0:
            raise BadData(f"stereo: nearest_m is {self.nearest_m}, expected a distance")

    def inverse_depths(self, context: Context, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        """Return inverse depth [P, H, W] per metre and confidence [P, H, W] of the last frame.

        The confidence is 1 where it matched, 0 where it was filled, and in all other frames.

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
        camera = context.intrinsics
        baseline_m = self._baseline_m(context.right)
        num_disparities = 16 * int(np.ceil(baseline_m * camera.fx_px / self.nearest_m / 16))
        inverse_depths = np.zeros(context.frames.shape[:3], np.float32)
        confidence = np.zeros_like(inverse_depths)
        right = right_at_scale(context.right, camera, num_disparities)
        disparity_px = self._disparity_px(context.frames[-1], right, num_disparities)
        is_matched = disparity_px >= 0
        inverse_depth = np.maximum(disparity_px, 0) / (baseline_m * camera.fx_px)
        inverse_depths[-1] = fill_from_background(inverse_depth, is_matched)
        confidence[-1] = is_matched
        return inverse_depths, confidence

    def _disparity_px(self, frame: ByteArray, right: ByteArray, num_disparities: int) -> FloatArray:
        """Return the disparity [H, W] in pixels of the frame, negative where nothing matched."""
        left = np.pad(frame, ((0, 0), (num_disparities, 0), (0, 0)), mode="edge")
        block_size = self.block_px**2
        # OpenCV's documentation recommends these values of P1 and P2.
        matcher = cv2.StereoSGBM.create(
            numDisparities=num_disparities,
            blockSize=self.block_px,
            P1=8 * block_size,
            P2=32 * block_size,
            disp12MaxDiff=self.max_difference_px,
            uniquenessRatio=self.uniqueness_percent,
            speckleWindowSize=self.max_speckle_px,
            speckleRange=self.max_speckle_step_px,
            mode=cv2.STEREO_SGBM_MODE_HH,
        )
        sixteenths = matcher.compute(pinhole.grey8(left), pinhole.grey8(right))
        return sixteenths[:, num_disparities:].astype(np.float32) / 16

    def _baseline_m(self, right: ExtraView) -> float:
        """Return the distance of the two cameras.

        Incompatible unless the right one is only shifted along x.
        """
        rotation = right.view_from_cam[:3, :3]
        shift = right.view_from_cam[:3, 3]
        baseline_m = float(-shift[0])
        tolerance = self.max_rectification_error
        is_turned = np.abs(rotation - np.eye(3)).max() > tolerance
        is_shifted_aside = np.abs(shift[1:]).max() > tolerance * abs(baseline_m)
        if baseline_m <= 0 or is_turned or is_shifted_aside:
            raise Incompatible(
                "stereo needs rectified images with the second camera to the right: rectify them "
                "first"
            )
        return baseline_m


def right_at_scale(right: ExtraView, camera: Intrinsics, left_px: int) -> ByteArray:
    """Render the last right image [H, left_px + W, 3] as `camera` would see it from there.

    Columns are added on its left.

    Rows then match those of the camera's own image, and columns differ by the disparity alone.
    """
    native = right.intrinsics
    width_px = max(1, round(native.width_px * camera.fx_px / native.fx_px))
    height_px = max(1, round(native.height_px * camera.fy_px / native.fy_px))
    small = cv2.resize(right.frames[-1], (width_px, height_px), interpolation=cv2.INTER_AREA)
    resized = native.resized(width_px, height_px)
    scale_u = camera.fx_px / resized.fx_px  # next to 1
    scale_v = camera.fy_px / resized.fy_px
    shift_u = camera.cx_px + left_px - scale_u * resized.cx_px
    shift_v = camera.cy_px - scale_v * resized.cy_px
    affine = np.array([[scale_u, 0, shift_u], [0, scale_v, shift_v]])
    size_px = (camera.width_px + left_px, camera.height_px)
    border = cv2.BORDER_REPLICATE
    return cv2.warpAffine(small, affine, size_px, flags=cv2.INTER_CUBIC, borderMode=border)
