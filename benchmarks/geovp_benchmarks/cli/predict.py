"""Predict one clip.

Write frames, poses, a point cloud, a film strip and a video.

Examples:
  geovp predict drive.mp4 --fov 80
  geovp predict images/ --fps 10 --calibration calib.txt --camera-height 1.65
  geovp predict drive.mp4 --first 0 --future 15 --samples 3 --out predicted
"""

import argparse
from pathlib import Path

from geovp.progress import announce, report
from geovp_benchmarks.cli.messages import print_notes
from geovp_benchmarks.cli.options import Lines, number, option, shared

CAMERA = {
    "camera, at most one of": {
        "--intrinsics X": option(
            "FX FY CX CY in pixels of the upright images. Default: estimated from the motion.",
            nargs=4,
            metavar=("FX", "FY", "CX", "CY"),
        ),
        "--fov X": option(
            "Horizontal field of view in degrees. Default: estimated from the motion.",
            dest="fov_deg",
            type=number(1, 179, float),
        ),
        "--calibration FILE": "KITTI calib.txt, COLMAP cameras.txt, or a ROS or Kalibr yaml file.",
    },
    "camera": {
        "--distortion X...": (
            "OpenCV coefficients k1 k2 [p1 p2 [k3 [k4 k5 k6]]]. Default: no distortion."
        ),
        "--camera-height X": option(
            "Height above the road in metres, for metric results. Default: unknown.",
            dest="camera_height_m",
        ),
    },
}
FRAMES = {
    "--topic NAME": option("Image topic of a bag. Default: the only one.", dest="image_topic"),
    "--pattern TEXT": option(
        "Names of the images of a folder, such as 'frame*.png'. Default: all images.",
        dest="name_pattern",
    ),
    "--bits N": option(
        "Number of bits in use, of images with 16. Default: images have 8.",
        dest="image_bits",
        type=number(8, 16),
    ),
    "--fps X": option(
        "Frame rate of a folder of images, which needs it, or of a raw stream. Default: the times "
        "that the video or bag states.",
        dest="frame_rate_hz",
    ),
    **shared("--rate", "--every"),
}
ARGUMENTS = {
    "": {"path INPUT": "Video, folder of images, or ROS bag."},
    "input": {
        **FRAMES,
        "--first NUMBER": (
            "Number of the first observed frame, counted among all. Default: the latest possible."
        ),
        "--past N = 10": option("Number of observed frames.", dest="num_past", type=number(2)),
        "--mask FILE": "Image that is nonzero where no scene is shown. Default: detected.",
        "--mask-mode MODE = add": option(
            "Whether --mask adds to the detected camera-fixed pixels or replaces them.",
            choices=("add", "replace"),
        ),
        "--no-mask": option("Take no pixels for camera-fixed. Default: detect them."),
        "--full": option("Use uncropped frames. Default: their middle.", dest="with_full"),
    },
    **CAMERA,
    "prediction": {
        "--future N = 20": option(
            "Number of predicted frames.", dest="num_future", type=number(1, 1000)
        ),
        "--samples N = 1": option("Number of sampled futures.", dest="num_samples"),
        "--pose-source SPEC": (
            "Name or TOML table of a pose-source, see `geovp list`. Default: refined."
        ),
        "--renderer SPEC": (
            "Name or TOML table of a renderer, see `geovp list`. Default: depth-fusion."
        ),
        "--predictor SPEC": (
            "Name or TOML table of a predictor, see `geovp list`. Default: geometric."
        ),
        "--no-fallback": option(
            "Show geometry even where image motion or the last frame predict the observed frames "
            "better. Default: the better one, with a warning.",
            dest="has_fallback",
            action="store_false",
        ),
        "--matrix MATRIX": "Matrix of --method. Default: use the components above.",
        **shared("--method", "--device"),
    },
    "output": {
        "--size SIZE": option(
            "WIDTHxHEIGHT, or side of a square. Default: aspect of the video, at most 640 px.",
            dest="size_px",
        ),
        "--out DIR": "Folder for the results. Default: results/predict/NAME-FIRST.",
    },
}


def run(args: argparse.Namespace) -> Lines:
    """Predict, write all files and print their paths."""
    from geovp.prediction import exports, prediction
    from geovp.prediction.request import PredictionRequest
    from geovp_benchmarks.matrix import schema
    from geovp_classic.errors import BadData

    if (args.matrix is None) != (args.method is None):
        raise BadData("--matrix and --method belong together: give both or neither")
    if args.method is not None:
        if args.predictor is not None:
            raise BadData("--method and --predictor exclude each other: keep one of them")
        args.predictor = schema.read(args.matrix).predictor_spec(args.method)
    if args.out is not None:
        exports.check_free(args.out)
    report(0, 6)
    predicted = prediction.predict(PredictionRequest(**vars(args)))
    announce("writing files", 1)
    name = f"{args.path.resolve().stem}-{predicted.numbers[0]:06d}"
    folder = args.out or Path("results/predict", name)
    number = 1
    while args.out is None and folder.exists():
        number += 1
        folder = folder.with_name(f"{name}-{number}")
    files = exports.write(predicted, folder)
    if not args.quiet:
        print_notes(predicted.summary())
    yield from map(str, files)
