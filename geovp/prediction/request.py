"""Request for the prediction of one clip."""

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from pydantic.dataclasses import dataclass

from geovp_classic import registry
from geovp_classic.data.recordings.windows import Rate, frames_at_rate
from geovp_classic.errors import BadData
from geovp_classic.interfaces import FramePredictor
from geovp_classic.predictors.default import default_pose_source
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.predictors.hindcast import Hindcast
from geovp_classic.types import FloatArray, IntArray, Intrinsics

Spec = dict[str, Any] | str


@dataclass(frozen=True)
class PredictionRequest:
    """Input of `predict` and `display`; other arguments are ignored."""

    path: Path  # a folder of images, a video or a bag
    intrinsics: tuple[float, float, float, float] | None = None  # fx, fy, cx, cy of stored images
    fov_deg: float | None = None  # horizontal
    calibration: Path | None = None
    distortion: tuple[float, ...] = ()  # OpenCV's k1, k2, p1, p2, k3, ...
    frame_rate_hz: float | None = None  # of a folder of images
    rate_hz: Rate | None = None  # frames in use per second; None: 10, for a data set all
    frame_step: int = 1  # of these, every Nth
    camera_height_m: float | None = None
    first: int | None = None  # first observed frame; None: as late as possible
    num_past: int = 10
    num_future: int = 20
    size_px: tuple[int, int] | None = None  # None: the video's aspect
    with_full: bool = False  # use the whole images, not only their middle
    pose_source: Spec | None = None
    renderer: Spec | None = None
    predictor: Spec | None = None
    num_samples: int = 1
    mask: Path | None = None
    mask_mode: Literal["add", "replace"] = "add"  # to the detected camera-fixed pixels
    no_mask: bool = False
    device: str | None = None
    image_topic: str | None = None  # if a bag has several
    name_pattern: str | None = None  # of images, if a folder has several series
    image_bits: int | None = None  # in use, of images with 16 bits
    has_fallback: bool = True  # by image motion or the last frame, where they predict better

    @property
    def has_camera(self) -> bool:
        """Return whether an option describes the camera."""
        return bool(self.intrinsics or self.fov_deg or self.calibration)

    def refuse(self, kind: str, *names: str) -> None:
        """Raise BadData if a setting is given that has no meaning for the kind of the input."""
        if given := [name for name in names if getattr(self, name) is not None]:
            raise BadData(f"{self.path} is {kind}: leave out {', '.join(given)}")

    def frame_numbers(self, times_s: FloatArray) -> IntArray:
        """Return the numbers of the frames in use; the first observed or the last is among them."""
        anchor = len(times_s) - 1 if self.first is None else min(self.first, len(times_s) - 1)
        return frames_at_rate(times_s, self.rate_hz or 10.0, self.frame_step, anchor)

    def build(self) -> FramePredictor:
        """Build the predictor; by default refined odometry with a forecast, and depth fusion.

        Raises BadData for options that exclude each other.
        """
        if self.predictor is not None and (self.pose_source or self.renderer) is not None:
            raise BadData(
                "--method, --predictor, and --pose-source with --renderer exclude each other: keep "
                "one of them"
            )
        fields = {"frames": "full"} if self.with_full else {}
        if self.device is not None:
            fields["device"] = self.device
        with registry.defaults(**fields):
            predictor = self._build()
        if self.mask is not None and self.no_mask:
            raise BadData("--mask and --no-mask exclude each other: keep one of them")
        if self.mask is None and self.mask_mode == "replace":
            raise BadData("--mask-mode replace needs the mask: give --mask")
        if not isinstance(predictor, GeometricPredictor):
            if self.mask is None and not self.no_mask and self.has_fallback:
                return predictor
            raise BadData(
                "--mask, --no-mask and --no-fallback need a pose source and a renderer, "
                f"{registry.name_of(predictor)} has none"
            )
        if not self.has_fallback:
            predictor = replace(predictor, hindcast=None)
        observer = predictor.observer
        if self.mask is not None:
            observer = replace(observer, mask=self.mask, mask_mode=self.mask_mode)
        if self.no_mask:
            observer = replace(observer, camera_fixed=None)
        return replace(predictor, observer=observer)

    def _build(self) -> FramePredictor:
        if self.predictor is not None:
            return registry.build("predictors", self.predictor, "--predictor")
        pose_source = self.pose_source or default_pose_source(self.camera_height_m is not None)
        return GeometricPredictor(
            registry.build("pose_sources", pose_source, "--pose-source"),
            registry.build("renderers", self.renderer or "depth-fusion", "--renderer"),
            hindcast=Hindcast(),
        )


def output_size(stored: Intrinsics, max_side_px: int = 640) -> tuple[int, int]:
    """Return an even width and height in a video's aspect, at most as large as the video."""
    scale = min(1.0, max_side_px / max(stored.width_px, stored.height_px))
    half_width, half_height = scale * stored.width_px / 2, scale * stored.height_px / 2
    return 2 * max(1, round(half_width)), 2 * max(1, round(half_height))
