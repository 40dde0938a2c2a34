"""Predict one clip.

Write frames, poses, a point cloud, a film strip and a video.

Examples:
  geovp predict drive.mp4 --fov 80
  geovp predict images/ --fps 10 --calibration calib.txt --camera-height 1.65
  geovp predict drive.mp4 --first 0 --future 15 --samples 3 --out predicted
"""

import argparse
import dataclasses
import sys
from pathlib import Path

from geovp_benchmarks.cli.messages import logger
from geovp_benchmarks.cli.options import Lines, add, add_flag, add_group, add_shared, at_least
from geovp_benchmarks.progress import Progress, announce


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the input, the camera, the prediction and the output."""
    add(parser, "path", "INPUT", "Video, folder of images, or ROS bag.", type=Path)
    group = add_group(parser, "input")
    text = "Image topic of a bag. Default: the only one."
    add(group, "--topic", "NAME", text)
    text = "Frame rate; required for a folder. Default: that of the video or bag."
    add(group, "--fps", "X", text, dest="rate_hz")
    text = "Number of the first observed frame. Default: the latest possible."
    add(group, "--first", "NUMBER", text, type=int)
    text = "Number of observed frames. Default: 10."
    add(group, "--past", "N", text, 10, dest="num_past", type=at_least(2))
    text = "Image that is nonzero where no scene is shown. Default: detected."
    add(group, "--mask", "FILE", text)
    add_flag(group, "--full", "Use uncropped frames. Default: their middle.", dest="with_full")
    add_camera(parser)
    group = add_group(parser, "prediction")
    text = "Number of predicted frames. Default: 20."
    add(group, "--future", "N", text, 20, dest="num_future")
    text = "Number of sampled futures. Default: 1."
    add(group, "--samples", "N", text, 1, dest="num_samples")
    defaults = {"pose-source": "refined", "renderer": "depth-fusion", "predictor": "geometric"}
    for role, name in defaults.items():
        text = f"Name or TOML table of a {role}, see `geovp list`. Default: {name}."
        add(group, f"--{role}", "SPEC", text)
    add(group, "--matrix", "MATRIX", "Matrix of --method. Default: use the components above.")
    add_shared(group, "--method", "--device")
    group = add_group(parser, "output")
    text = "WIDTHxHEIGHT, or side of a square. Default: aspect of the video, at most 640 px."
    add(group, "--size", "SIZE", text, dest="size_px")
    add(group, "--out", "DIR", "Folder for the results. Default: results/predict/NAME-FIRST.")


def add_camera(parser: argparse.ArgumentParser) -> None:
    """Add the intrinsics and the height of the camera."""
    text = "Give at most one of --intrinsics, --fov and --calibration."
    group = parser.add_argument_group("camera", text)
    source = group.add_mutually_exclusive_group()
    text = "FX FY CX CY in pixels of the stored images. Default: estimated from the motion."
    add(source, "--intrinsics", "X", text, nargs=4)
    text = "Horizontal field of view in degrees. Default: estimated from the motion."
    add(source, "--fov", "X", text, dest="fov_deg", type=at_least(1, float))
    text = "KITTI calib.txt, COLMAP cameras.txt, or a ROS or Kalibr yaml file."
    add(source, "--calibration", "FILE", text)
    text = "OpenCV coefficients k1 k2 [p1 p2 [k3 [k4 k5 k6]]]. Default: no distortion."
    add(group, "--distortion", "X", text, nargs="+")
    text = "Height above the road in metres, for metric results. Default: unknown."
    add(group, "--camera-height", "X", text, dest="camera_height_m")


def run(args: argparse.Namespace, progress: Progress) -> Lines:
    """Predict, write all files and print their paths."""
    from geovp_benchmarks.predict import exports, prediction
    from geovp_benchmarks.predict.request import PredictionRequest
    from geovp_classic import registry

    if args.out is not None:
        exports.check_free(args.out)
    names = [field.name for field in dataclasses.fields(PredictionRequest)]
    request = PredictionRequest(**{name: getattr(args, name) for name in names})
    progress(0, 6)
    predicted = prediction.predict(request)
    announce("writing files", 1)
    name = f"{args.path.resolve().stem}-{predicted.first:06d}"
    folder = args.out or Path("results/predict", name)
    number = 1
    while args.out is None and folder.exists():
        number += 1
        folder = folder.with_name(f"{name}-{number}")
    files = exports.write(predicted, folder)
    if not args.quiet:
        print(*predicted.summary(), sep="\n", file=sys.stderr)
    if not any(path.suffix == ".mp4" for path in files):
        logger.warning(f"the film is a gif; for H.264: {registry.install_command('video')}")
    yield from map(str, files)
