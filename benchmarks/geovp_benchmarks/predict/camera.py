"""The camera of one's own video: given, read from a file, from photos' EXIF data, or estimated from
the motion.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from geovp_benchmarks.predict.prediction_request import PredictionRequest
from geovp_classic.data.calibration_files import exif_focal_px, read_camera
from geovp_classic.data.frames import FrameFiles
from geovp_classic.data.undistortion import DistortedCamera, UndistortedFrames, common_pinhole
from geovp_classic.data.windows import Recording
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.odometry.focal_length import FocalLengthEstimator
from geovp_classic.types import ByteArray, Intrinsics


@dataclass(frozen=True)
class Camera:
    """Intrinsics of the images, at their stored size and without distortion, and where they came
    from.
    """

    intrinsics: Intrinsics
    source: str  # "given", "fov", "calibration", "exif", "motion" or "assumed"
    removed_distortion: tuple[float, ...] = ()  # coefficients of the distortion that was taken out
    interval_px: tuple[float, float] | None = None  # 90 % interval of an estimated focal length
    warnings: tuple[str, ...] = ()


def find_camera(
    recording: Recording,
    num_seen: int,  # frames up to the last observed one; later ones are not looked at
    asked: PredictionRequest,
) -> tuple[Camera, Recording]:
    """Return the camera by the best available source, and its images without distortion."""
    width_px, height_px = recording.intrinsics.width_px, recording.intrinsics.height_px
    given, fov_deg, calibration, path = (
        asked.intrinsics,
        asked.fov_deg,
        asked.calibration,
        asked.path,
    )
    if given is not None:
        lens = _distorted(Intrinsics(*given, width_px, height_px), asked)
        return _undistorted(recording, lens, path, "given")
    if fov_deg is not None:
        if not 0 < fov_deg < 170:
            raise BadData(
                f"--fov {fov_deg:g} is not the angle of a pinhole camera: give degrees between "
                "0 and 170"
            )
        middle = centred(focal_of_fov(fov_deg, width_px), width_px, height_px)
        return _undistorted(recording, _distorted(middle, asked), path, "fov")
    if calibration is not None:
        lens = read_camera(calibration, path, (width_px, height_px))
        return _undistorted(recording, lens, calibration, "calibration")
    focal_px = (
        exif_focal_px(recording.frames.paths[0])
        if isinstance(recording.frames, FrameFiles)
        else None
    )
    exif = None if focal_px is None else Camera(centred(focal_px, width_px, height_px), "exif")
    camera = exif or _by_motion(recording, num_seen)
    return camera, replace(recording, intrinsics=camera.intrinsics)


def _distorted(view: Intrinsics, asked: PredictionRequest) -> DistortedCamera:
    """Return a camera with the coefficients of `--distortion`."""
    return DistortedCamera(view, "FULL_OPENCV", asked.distortion or ())


def _undistorted(
    recording: Recording, lens: DistortedCamera, file: Path, source: str
) -> tuple[Camera, Recording]:
    """Undistort the images into a pinhole camera of the same focal length, without empty pixels."""
    if not any(lens.distortion):
        return Camera(lens.pinhole, source), replace(recording, intrinsics=lens.pinhole)
    view = common_pinhole([lens], file)
    frames = UndistortedFrames(recording.frames, (lens,) * len(recording.frames), view)
    return Camera(view, source, lens.distortion), replace(recording, frames=frames, intrinsics=view)


def centred(focal_px: float, width_px: int, height_px: int) -> Intrinsics:
    """Return a camera with square pixels and a central principal point."""
    return Intrinsics(
        focal_px, focal_px, (width_px - 1) / 2, (height_px - 1) / 2, width_px, height_px
    )


def focal_of_fov(fov_deg: float, width_px: int) -> float:
    """Return the focal length in pixels of a horizontal field of view."""
    return float(width_px / 2 / np.tan(np.radians(fov_deg) / 2))


def fov_of_focal(focal_px: float, width_px: int) -> float:
    """Return the horizontal field of view in degrees of a focal length in pixels."""
    return float(np.degrees(2 * np.arctan(width_px / 2 / focal_px)))


def _by_motion(
    recording: Recording,
    num_seen: int,
    assumed_fov_deg: float = 70.0,  # of a phone or a dashboard camera, roughly
    num_windows: int = 4,
    max_rate_hz: float = 10.0,
    max_width_px: int = 1280,
) -> Camera:
    """Estimate the focal length, or assume a field of view with a warning."""
    width_px, height_px = recording.intrinsics.width_px, recording.intrinsics.height_px
    rate_hz = 1 / float(np.median(np.diff(recording.times_s)))
    stride = max(1, round(rate_hz / max_rate_hz))
    estimator = FocalLengthEstimator()
    span = min(estimator.window * stride, num_seen)
    starts = np.unique(
        np.linspace(0, num_seen - span, max(1, min(num_windows, 2 * num_seen // span - 1))).astype(
            int
        )
    )
    shrink = min(1.0, max_width_px / width_px)
    windows = (
        [_grey(recording, step, shrink) for step in range(first, first + span, stride)]
        for first in starts
    )
    estimate = estimator.estimate(windows)
    if estimate is not None and estimate.is_sure:
        low, focal, high = (
            each / shrink for each in (estimate.low_px, estimate.focal_px, estimate.high_px)
        )
        return Camera(centred(focal, width_px, height_px), "motion", interval_px=(low, high))
    why = (
        "too few frames, or hardly any turn"
        if estimate is None
        else "the motion leaves too much room"
    )
    words = (
        f"the focal length cannot be told from the motion ({why}): {assumed_fov_deg:g} degrees "
        "are assumed; give --fov, --calibration or --intrinsics if you know better"
    )
    focal_px = focal_of_fov(assumed_fov_deg, width_px)
    return Camera(centred(focal_px, width_px, height_px), "assumed", warnings=(words,))


def _grey(recording: Recording, step: int, shrink: float) -> ByteArray:
    frame = recording.frames.read(step)
    height_px, width_px = frame.shape[:2]
    return pinhole.grey8(
        pinhole.resize(frame, (round(width_px * shrink), round(height_px * shrink)))
    )
