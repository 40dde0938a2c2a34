"""Frame rate of the odometry with bundle adjustment and scale, compared with an ORB + findEssentialMat loop.

`python -m benchmarks.performance.odometry IMAGES CALIB [COUNT]`: a folder of images and KITTI's calib.txt (its
first line is used). Both loops process the same images from memory, alternately, so that other load slows both.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks.arguments import positive
from geovp_classic.data import kitti_layout
from geovp_classic.data.findings import raise_first
from geovp_classic.data.frames import read_image
from geovp_classic.errors import BadData, GeovpError
from geovp_classic.odometry.monocular import Monocular
from geovp_classic.types import ByteArray, FloatArray, Intrinsics


@dataclass(frozen=True)
class Timing:
    """Processing times of one run over the images."""

    odometry_s: FloatArray  # [T], per image
    plain_s: FloatArray  # [T - 1], per pair
    growth_mb: float  # of peak memory in the second half

    def lines(self) -> list[str]:
        """The result as lines of text."""
        odometry_hz, plain_hz = 1 / self.odometry_s.mean(), 1 / self.plain_s.mean()
        median_ms, late_ms = 1e3 * np.percentile(self.odometry_s, [50, 95])
        return [
            f"odometry with bundle adjustment and scale: {odometry_hz:.1f} frames/s "
            f"(median {median_ms:.1f} ms, 95 % {late_ms:.1f} ms)",
            f"plain ORB + findEssentialMat: {plain_hz:.1f} frames/s (median {1e3 * np.median(self.plain_s):.1f} ms)",
            f"ratio: {odometry_hz / plain_hz:.2f}; memory grew by {self.growth_mb:.1f} MB in the second half",
        ]


def measure(frames: Sequence[ByteArray], camera: Intrinsics, camera_height_m: float = 1.65) -> Timing:
    """Time both loops, alternating image by image."""
    stream = Monocular().stream(camera, camera_height_m)
    odometry_s, plain_s, peaks_mb = [], [], []
    for i, frame in enumerate(frames):
        start = time.perf_counter()
        stream.push(frame, 0.1 * i)
        stream.take_final()
        odometry_s.append(time.perf_counter() - start)
        if i:
            start = time.perf_counter()
            plain_step(frames[i - 1], frame, camera)
            plain_s.append(time.perf_counter() - start)
        peaks_mb.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    return Timing(np.array(odometry_s), np.array(plain_s), peaks_mb[-1] - peaks_mb[len(peaks_mb) // 2])


def plain_step(before: ByteArray, now: ByteArray, camera: Intrinsics) -> FloatArray:
    """Relative pose [3, 4] by the textbook method: 2000 ORB features, cross-checked matches, five-point RANSAC."""
    orb, matcher = cv2.ORB.create(2000), cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True)
    points_a, described_a = orb.detectAndCompute(before, None)
    points_b, described_b = orb.detectAndCompute(now, None)
    matches = matcher.match(described_a, described_b)
    a = np.array([points_a[match.queryIdx].pt for match in matches])
    b = np.array([points_b[match.trainIdx].pt for match in matches])
    essential, mask = cv2.findEssentialMat(a, b, camera.matrix, cv2.RANSAC, 0.999, 1.0)
    _, rotation, direction, _ = cv2.recoverPose(essential, a, b, camera.matrix, mask=mask)
    return np.concatenate([np.asarray(rotation, dtype=np.float64), np.asarray(direction, dtype=np.float64)], axis=1)


def read(folder: Path, calib: Path, count: int) -> tuple[list[ByteArray], Intrinsics]:
    """The first images of a folder, grey, and the first camera of a calib.txt; BadData names the wrong file."""
    projections, findings = kitti_layout.scan_calibration(calib)
    raise_first(findings)
    paths = sorted(folder.iterdir())[:count] if folder.is_dir() else []
    if len(paths) < 2 or not projections:
        raise BadData(f"{folder} and {calib}: expected a folder of two or more images, and a line such as 'P0:'")
    images = [cv2.cvtColor(read_image(path), cv2.COLOR_RGB2GRAY) for path in paths]
    frames = [np.asarray(image, dtype=np.uint8) for image in images]
    height_px, width_px = frames[0].shape
    return frames, projections[min(projections)].intrinsics(width_px, height_px)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the timing."""
    parser = argparse.ArgumentParser(description="Frame rate of the odometry, and of ORB + findEssentialMat.")
    parser.add_argument("images", type=Path, metavar="IMAGES")
    parser.add_argument("calib", type=Path, metavar="CALIB")
    parser.add_argument("count", nargs="?", type=positive, default=200, metavar="COUNT")
    chosen = parser.parse_args(arguments)
    try:
        frames, camera = read(chosen.images, chosen.calib, chosen.count)
    except GeovpError as error:
        parser.error(str(error))
    print(*measure(frames, camera).lines(), sep="\n")


if __name__ == "__main__":
    main()
