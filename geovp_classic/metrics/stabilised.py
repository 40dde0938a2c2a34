"""Frame metrics after the error of the predicted camera's rotation is taken out of
the prediction.
"""

import math
from dataclasses import dataclass, field

import cv2
import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.interfaces import FrameMetric
from geovp_classic.metrics.image import Psnr
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics, Trajectory

ROUNDING_PX = 1e-6  # so far outside the frame still is its border
ROUNDING_RAD = 1e-9


@dataclass(frozen=True)
class Stabilised:
    """Another metric, of predictions turned into the true camera's orientation: wrong content
    without the shake.

    A camera that only turns moves the image by the homography K R K^-1, whatever the depth (Hartley
    & Zisserman 2004, eq. 13.2 with t = 0). Whoever scores turns the prediction with `turned` first;
    the metric itself compares frames that are stabilised already.
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
    def bounds(self) -> tuple[float, float]:
        """As for the metric itself."""
        return getattr(self.metric, "bounds", (-math.inf, math.inf))

    @property
    def protocol(self) -> str:
        """The definition in words."""
        own = getattr(self.metric, "protocol", "")
        return (
            f"{own}{', ' * bool(own)}after the rotation between predicted and true camera, each "
            "relative to the last "
            "observed one, is taken out of the prediction; over the pixels that both see; - "
            "where a method predicts no "
            "camera"
        )

    def __call__(
        self, predicted: ByteArray, target: ByteArray, mask: BoolArray | None = None
    ) -> FloatArray:
        """The metric [F] of frames that are turned already, over pixels that both see."""
        return self.metric(predicted, target, mask)


def turned(
    frames: ByteArray,  # [F, H, W, 3], seen by the predicted cameras
    camera: Intrinsics,
    predicted: Trajectory,  # [F]
    target: Trajectory,  # [F], in the same world frame
) -> tuple[ByteArray, BoolArray]:
    """The frames as the predicted cameras would have seen them with the true orientations, and
    which pixels they saw.

    Resampled by bicubic interpolation, but for frames whose orientation is the true one.
    """
    views, masks = np.array(frames), np.empty(frames.shape[:3], dtype=bool)
    predicted_from_true = se3.inverse(predicted.world_from_cam) @ target.world_from_cam
    last_px = np.array([camera.width_px - 1, camera.height_px - 1])
    for step, rotation in enumerate(predicted_from_true[:, :3, :3]):
        pixels, _ = pinhole.project(
            pinhole.rays(camera) @ rotation.T, camera
        )  # NaN behind the camera
        masks[step] = ((pixels >= -ROUNDING_PX) & (pixels <= last_px + ROUNDING_PX)).all(axis=-1)
        if not np.allclose(rotation, np.eye(3), atol=ROUNDING_RAD):
            u, v = np.moveaxis(np.nan_to_num(pixels, nan=-1.0).astype(np.float32), -1, 0)
            views[step] = cv2.remap(
                frames[step], u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
            )
    return views, masks
