"""Frame metrics after the error of the predicted camera's rotation is taken out of the prediction."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.interfaces import FrameMetric
from geovp_classic.metrics.image import Psnr
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics, Trajectory

ROUNDING_PX = 1e-6  # of the homography; so far outside the frame still is its border


@dataclass(frozen=True)
class Stabilised:
    """Another metric, of predictions turned into the true camera's orientation: wrong content without the shake.

    A camera that only turns moves the image by the homography K R K^-1, whatever the depth (Hartley & Zisserman 2004,
    eq. 13.2 with t = 0). Whoever scores turns the prediction with `turned` first; the metric itself compares frames
    that are stabilised already.
    """

    metric: FrameMetric = field(default_factory=Psnr)

    @property
    def unit(self) -> str:
        """The metric's own."""
        return self.metric.unit

    @property
    def higher_is_better(self) -> bool:
        """As for the metric itself."""
        return self.metric.higher_is_better

    @property
    def protocol(self) -> str:
        """The definition in words."""
        own = getattr(self.metric, "protocol", "")
        return (
            f"{own}{', ' * bool(own)}after the rotation between predicted and true camera, each relative to the last "
            "observed one, is taken out of the prediction; over the pixels that both see; - where a method predicts no "
            "camera"
        )

    def __call__(self, predicted: ByteArray, target: ByteArray, mask: BoolArray | None = None) -> FloatArray:
        """The metric [F] of frames that are turned already, over pixels that both see."""
        return self.metric(predicted, target, mask)


def turned(
    frames: ByteArray,  # [F, H, W, 3], seen by the predicted cameras
    camera: Intrinsics,
    predicted: Trajectory,  # [F]
    target: Trajectory,  # [F], in the same world frame
) -> tuple[ByteArray, BoolArray]:
    """The frames as the predicted cameras would have seen them with the true orientations, and which pixels they saw.

    Resampled by bicubic interpolation, unless the orientations are equal.
    """
    predicted_from_true = (se3.inverse(predicted.world_from_cam) @ target.world_from_cam)[:, :3, :3]
    matrix = camera.matrix
    homographies = matrix @ predicted_from_true @ np.linalg.inv(matrix)  # true pixels into predicted ones
    views = [_turned_one(frame, homography) for frame, homography in zip(frames, homographies, strict=True)]
    return np.stack([view for view, _ in views]), np.stack([seen for _, seen in views])


def _turned_one(
    frame: ByteArray,  # [H, W, 3]
    homography: FloatArray,  # [3, 3], pixels of the result into those of the frame
) -> tuple[ByteArray, BoolArray]:
    height_px, width_px = frame.shape[:2]
    v, u = np.mgrid[:height_px, :width_px].astype(np.float64)
    source = np.einsum("ij,jhw->ihw", homography, np.stack([u, v, np.ones_like(u)]))
    in_front = source[2] > 0
    u, v = source[:2] / np.where(in_front, source[2], np.nan)
    seen = in_front & _within(u, width_px - 1) & _within(v, height_px - 1)
    if np.allclose(homography, np.eye(3), atol=ROUNDING_PX):
        return frame, seen
    map_u, map_v = np.nan_to_num(np.stack([u, v]), nan=-1.0).astype(np.float32)
    view = cv2.remap(frame, map_u, map_v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(view), seen


def _within(pixels: FloatArray, last_px: int) -> BoolArray:
    """Which coordinates lie between the first and the last pixel's centre; NaN does not."""
    within: BoolArray = (pixels >= -ROUNDING_PX) & (pixels <= last_px + ROUNDING_PX)
    return within
