"""One clip in; predicted frames, poses, cloud, film strip and video out."""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path

from benchmarks.arguments import positive
from benchmarks.progress import progress_bar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which frames, which camera, and how many frames are predicted."""
    parser.add_argument("path", type=Path, metavar="VIDEO|FOLDER", help="a video, or a folder of images")
    of_images = "in pixels of the images as they are stored, (0, 0) the centre of the top-left one"
    parser.add_argument("--intrinsics", type=float, nargs=4, metavar=("FX", "FY", "CX", "CY"), help=of_images)
    parser.add_argument("--fov", dest="fov_deg", type=float, metavar="DEG", help="horizontal angle of view instead")
    known = "a file of the intrinsics: KITTI's calib.txt, COLMAP's cameras.txt, a ROS or Kalibr yaml"
    parser.add_argument("--calibration", type=Path, metavar="FILE", help=known)
    parser.add_argument("--fps", dest="rate_hz", type=float, metavar="HZ", help="frames a second; needed for a folder")
    parser.add_argument(
        "--camera-height",
        dest="camera_height_m",
        type=float,
        metavar="M",
        help="above the road: poses and cloud in metres",
    )
    parser.add_argument("--first", type=int, metavar="N", help="first observed frame (default: the latest possible)")
    parser.add_argument("--past", dest="num_past", type=positive, default=10, metavar="N", help="observed frames (10)")
    parser.add_argument(
        "--future", dest="num_future", type=positive, default=20, metavar="N", help="predicted frames (20)"
    )
    parser.add_argument(
        "--size", dest="size_px", type=positive, default=256, metavar="PX", help="side of the square middle (256)"
    )
    parser.add_argument(
        "--wide", dest="with_wide", action="store_true", help="use the whole images, not only their middle"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="a new folder (default: results/predict/NAME-FIRST)")


def run(chosen: argparse.Namespace) -> int:
    """Predict, write everything and print the paths."""
    from benchmarks import prediction

    if chosen.out is not None:
        prediction.check_free(chosen.out)
    fields = {field.name: getattr(chosen, field.name) for field in dataclasses.fields(prediction.PredictionRequest)}
    request = prediction.PredictionRequest(**{**fields, "intrinsics": chosen.intrinsics and tuple(chosen.intrinsics)})
    with progress_bar("predict", "stages") as progress:
        predicted = prediction.predict(request, progress)
        name = f"{chosen.path.resolve().stem}-{predicted.first:06d}"
        written = prediction.write(predicted, chosen.out or Path("results/predict") / name)
        progress(prediction.NUM_STAGES, prediction.NUM_STAGES)
    print(*prediction.summary(predicted), sep="\n", file=sys.stderr)
    print(*written, sep="\n")
    return 0
