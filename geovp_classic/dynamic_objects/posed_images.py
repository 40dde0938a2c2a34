"""The observed frames with their geometry, and their comparison under a hypothesis of motion."""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.geometry.epipolar import Epipolar
from geovp_classic.geometry.ground_plane import GroundPlane
from geovp_classic.types import FloatArray, Intrinsics, Trajectory

Box = tuple[slice, slice]  # rows and columns of an image


@dataclass(frozen=True)
class PosedImages:
    """Grey images with poses, and the geometry of the last one."""

    images: FloatArray  # [P, H, W] float32 grey 0..255, at equal exposure
    camera: Intrinsics
    past: Trajectory  # [P]
    inverse_depth: (
        FloatArray  # [H, W] of the last frame, estimated as if all were static
    )
    road: GroundPlane
    steps: tuple[int, ...] = ()  # how many frames back the compared frames are

    def seconds(self, step: int) -> float:
        """Return the time from an earlier frame to the last one."""
        times_s = self.past.times_s
        return float(times_s[-1] - times_s[-1 - step])

    def cam_from_last(self, step: int) -> FloatArray:
        """Return the motion [4, 4] from the last camera's frame to that of an earlier one."""
        poses = self.past.world_from_cam
        return np.asarray(se3.inverse(poses[-1 - step]) @ poses[-1])

    def motion_difference(
        self,
        step: int,
        box: Box,
        inverse_depth: FloatArray,  # [h, w] in the box
        velocity: FloatArray,  # [3] in the last camera's frame
        window_px: int,
    ) -> FloatArray:
        """Return the grey difference [h, w] to an earlier frame for a body at a velocity."""
        rows, columns = box
        height_px, width_px = inverse_depth.shape
        part = self.camera.cropped(
            columns.start, rows.start, width_px, height_px
        )
        shift = -self.seconds(step) * velocity
        moved_back = se3.compose(np.eye(3), shift)
        cam_from_last = self.cam_from_last(step) @ moved_back
        pixels, _ = Epipolar.of(part, cam_from_last, self.camera).project(
            inverse_depth
        )
        last = self.images[-1][box]
        return grey_difference(last, self.images[-1 - step], pixels, window_px)


def grey_difference(
    last: FloatArray,  # [h, w]
    earlier: FloatArray,  # [H, W]
    pixels: FloatArray,  # [h, w, 2] float32, of the earlier image
    window_px: int,
) -> FloatArray:
    """Return the absolute difference [h, w] of the grey values, averaged over a window."""
    u, v = cv2.split(pixels)
    warped = cv2.remap(
        earlier, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    difference = np.abs(warped - last)
    return np.asarray(cv2.blur(difference, (window_px, window_px)))
