"""Camera of a video: given, from a file, from EXIF data, or estimated from the motion."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from geovp.prediction.request import PredictionRequest, output_size
from geovp_classic.data.formats.calibration_files import exif_focal_px, read_camera
from geovp_classic.data.frames.image_frames import FrameFiles
from geovp_classic.data.frames.undistortion import (
    DistortedCamera,
    UndistortedFrames,
    common_pinhole,
)
from geovp_classic.data.recordings.windows import Recording, SelectedFrames
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.odometry.focal_length import FocalLengthEstimator
from geovp_classic.types import ByteArray, Intrinsics


@dataclass(frozen=True)
class Camera:
    """Pinhole camera of the undistorted images at their stored size."""

    intrinsics: Intrinsics
    source: str
    removed_distortion: tuple[float, ...]  # coefficients
    interval_px: tuple[float, float] | None  # 90 % interval of an estimated focal length

    @property
    def fov_deg(self) -> float:
        """Return the horizontal field of view in degrees."""
        ratio = self.intrinsics.width_px / self.intrinsics.fx_px
        return float(np.degrees(2 * np.arctan(ratio / 2)))

    def warnings(
        self,
        max_pinhole_fov_deg: float = 110.0,  # rectilinear lenses above that are rare
    ) -> Iterator[str]:
        """Yield a sentence for each sign that the camera is not this one."""
        if self.source == "assumed":
            yield (
                "the motion does not determine the focal length: "
                f"{self.fov_deg:.0f} degrees are assumed; give --fov, --calibration or --intrinsics"
            )
        if self.source == "field of view" and self.fov_deg > max_pinhole_fov_deg:
            yield (
                f"a pinhole camera of {self.fov_deg:.0f} degrees is assumed, but such "
                "lenses are mostly fisheyes: give --calibration with a fisheye model"
            )


def find_camera(
    recording: Recording,
    recorded: DistortedCamera | None,  # next to the images
    num_observed: int,  # frames up to the last observed one; later ones are not read
    request: PredictionRequest,
) -> tuple[Camera, Recording]:
    """Return the camera from the best available source, and the images without distortion."""
    if request.distortion and not (request.intrinsics or request.fov_deg):
        raise BadData("--distortion belongs to --intrinsics or --fov: give one of them")
    width_px, height_px = recording.intrinsics.size_px
    source, interval_px = "given", None
    if request.calibration is not None:
        source = "calibration file"
        lens = read_camera(request.calibration, request.path, (width_px, height_px))
    elif recorded is not None and not request.has_camera:
        source, lens = "CameraInfo", recorded
    else:
        numbers = request.intrinsics
        if numbers is None:
            focal_px, source, interval_px = _focal_length(recording, num_observed, request.fov_deg)
            numbers = (focal_px, focal_px, (width_px - 1) / 2, (height_px - 1) / 2)
        intrinsics = Intrinsics(*numbers, width_px, height_px)
        lens = DistortedCamera(intrinsics, "FULL_OPENCV", request.distortion)
    view = common_pinhole([lens], request.calibration or request.path)
    frames = UndistortedFrames(recording.frames, (lens,) * len(recording.frames), view)
    camera = Camera(view, source, lens.distortion, interval_px)
    return camera, replace(recording, frames=frames, intrinsics=view)


def _focal_length(
    recording: Recording,
    num_observed: int,
    fov_deg: float | None,
    assumed_fov_deg: float = 70.0,  # roughly that of a phone or a dashboard camera
) -> tuple[float, str, tuple[float, float] | None]:
    """Return the focal length in pixels, its source, and its 90 % interval if it is estimated."""
    width_px, source = recording.intrinsics.width_px, "field of view"
    if fov_deg is None:
        frames = recording.frames
        while isinstance(frames, SelectedFrames):
            frames = frames.frames
        if isinstance(frames, FrameFiles):
            focal_px = exif_focal_px(frames.paths[0])
            if focal_px is not None:
                return focal_px, "EXIF data", None
        size_px = output_size(recording.intrinsics, max_side_px=1280)
        estimate = FocalLengthEstimator().estimate(_windows(recording, num_observed, size_px))
        if estimate is not None and estimate.is_sure:
            scale = width_px / size_px[0]
            interval_px = (estimate.low_px * scale, estimate.high_px * scale)
            return estimate.focal_px * scale, "motion", interval_px
        fov_deg, source = assumed_fov_deg, "assumed"
    return width_px / 2 / np.tan(np.radians(fov_deg) / 2).item(), source, None


def _windows(
    recording: Recording,
    num_observed: int,
    size_px: tuple[int, int],
    max_windows: int = 4,
    max_rate_hz: float = 10.0,
) -> Iterator[list[ByteArray]]:
    """Yield windows of grey images, evenly spaced over the observed frames."""
    step_s = float(np.median(np.diff(recording.times_s)))
    stride = max(1, round(1 / step_s / max_rate_hz))
    span = min(FocalLengthEstimator.window * stride, num_observed)
    num_windows = max(1, min(max_windows, 2 * num_observed // span - 1))
    for first in np.linspace(0, num_observed - span, num_windows).astype(int):
        frames = map(recording.frames.read, range(first, first + span, stride))
        yield [pinhole.grey8(pinhole.resize(frame, size_px)) for frame in frames]
