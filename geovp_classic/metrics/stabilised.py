"""Frame metrics without the rotation error of the predicted camera."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.interfaces import FrameMetric
from geovp_classic.metrics.image import Psnr
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    FloatArray,
    Intrinsics,
    Trajectory,
)


@dataclass(frozen=True)
class Stabilised:
    """Another metric, of predictions rotated into the true camera's orientation.

    The rotation of a camera moves the image by the homography K R K^-1, whatever the depth (Hartley
    & Zisserman 2004, eq. 13.2 with t = 0). Callers rotate predictions with `turned` first.
    """

    metric: FrameMetric = Psnr()

    @property
    def unit(self) -> str:
        """Return the unit of the metric."""
        return self.metric.unit

    @property
    def higher_is_better(self) -> bool:
        """Return whether larger scores are better."""
        return self.metric.higher_is_better

    @property
    def bounds(self) -> tuple[float, float]:
        """Return the bounds of the metric."""
        return getattr(self.metric, "bounds", (-math.inf, math.inf))

    @property
    def protocol(self) -> str:
        """Return the definition in words."""
        definition = getattr(self.metric, "protocol", "")
        return (
            f"{definition}{', ' * bool(definition)}after the rotation between predicted and true "
            "camera, each relative to the last observed one, is taken out of the prediction; over "
            "the pixels that both see; - where a method predicts no camera"
        )

    def __call__(
        self,
        predicted: ByteArray,
        target: ByteArray,
        mask: BoolArray | None = None,
    ) -> FloatArray:
        """Return the scores [F] of rotated frames over the pixels that both cameras see."""
        return self.metric(predicted, target, mask)


def turned(
    frames: ByteArray,  # [F, H, W, 3], seen by the predicted cameras
    camera: Intrinsics,
    predicted: Trajectory,  # [F]
    target: Trajectory,  # [F], in the same world frame
) -> tuple[ByteArray, BoolArray]:
    """Return the frames in the true orientations, and the mask of pixels that both cameras see.

    Frames with the true orientation are not resampled; others by bicubic interpolation.
    """
    views = frames.copy()
    masks = np.empty(frames.shape[:3], dtype=bool)
    predicted_from_true = se3.inverse(predicted.world_from_cam) @ target.world_from_cam
    last_px = np.array([camera.width_px - 1, camera.height_px - 1])
    for step, rotation in enumerate(predicted_from_true[:, :3, :3]):
        pixels, _ = pinhole.project(pinhole.rays(camera) @ rotation.T, camera)
        is_inside = (pixels >= -1e-6) & (pixels <= last_px + 1e-6)
        masks[step] = is_inside.all(axis=-1)
        if not np.allclose(rotation, np.eye(3), atol=1e-9):
            # NaN behind the camera
            at = np.nan_to_num(pixels, nan=-1.0).astype(np.float32)
            border = cv2.BORDER_REPLICATE
            views[step] = cv2.remap(frames[step], at, None, cv2.INTER_CUBIC, borderMode=border)
    return views, masks
