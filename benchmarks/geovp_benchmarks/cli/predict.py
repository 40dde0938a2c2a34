"""Prediction of one clip: frames, poses, point cloud, film strip and video."""

import argparse
import dataclasses
import itertools
import sys
import tomllib
from pathlib import Path
from typing import Any

from geovp_benchmarks.arguments import add_device, positive
from geovp_benchmarks.cli.messages import say
from geovp_benchmarks.progress import progress_bar

EXAMPLES = """examples:
  geovp predict drive.mp4 --fov 80
  geovp predict images/ --fps 10 --calibration calib.txt --camera-height 1.65
  geovp predict drive.mp4 --first 0 --future 15 --samples 3 --out predicted
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options in groups, with examples."""
    parser.epilog = EXAMPLES
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    _add_input(parser.add_argument_group("input"))
    _add_camera(parser.add_argument_group("camera"))
    _add_prediction(parser.add_argument_group("prediction"))
    output = parser.add_argument_group("output")
    size = "Width and height, or one side of a square. Default: the video's aspect, at most 640 px."
    output.add_argument("--size", dest="size_px", type=_size, metavar="WxH|PX", help=size)
    folder = "New folder for the results. Default: results/predict/NAME-FIRST."
    output.add_argument("--out", type=Path, metavar="DIR", help=folder)


def _add_input(group: argparse._ArgumentGroup) -> None:
    path = "Video, folder of images, or number of a webcam."
    group.add_argument("path", type=Path, metavar="VIDEO|FOLDER|WEBCAM", help=path)
    rate = "Frame rate; required for a folder. Default: that of the video."
    group.add_argument("--fps", dest="rate_hz", type=float, metavar="HZ", help=rate)
    first = "Number of the first observed frame. Default: the latest possible."
    group.add_argument("--first", type=int, metavar="N", help=first)
    past = "Number of observed frames. Default: 10."
    group.add_argument("--past", dest="num_past", type=positive, default=10, metavar="N", help=past)
    mask = "Image of any size that is nonzero where no scene is shown. Default: detected."
    group.add_argument("--mask", type=Path, metavar="FILE", help=mask)
    full = "Use the whole images instead of their middle."
    group.add_argument("--full", dest="with_full", action="store_true", help=full)


def _add_camera(group: argparse._ArgumentGroup) -> None:
    group.description = "Give at most one of --intrinsics, --fov and --calibration."
    pixels = "Intrinsics in pixels of the stored images. Default: estimated from the motion."
    names = ("FX", "FY", "CX", "CY")
    group.add_argument("--intrinsics", type=float, nargs=4, metavar=names, help=pixels)
    fov = "Horizontal field of view in degrees."
    group.add_argument("--fov", dest="fov_deg", type=float, metavar="DEG", help=fov)
    file = "KITTI calib.txt, COLMAP cameras.txt, or a ROS or Kalibr yaml file."
    group.add_argument("--calibration", type=Path, metavar="FILE", help=file)
    lens = "OpenCV coefficients k1 k2 [p1 p2 [k3 [k4 k5 k6]]], with --intrinsics or --fov."
    group.add_argument("--distortion", type=float, nargs="+", metavar="K", help=lens)
    height = "Height above the road in metres, for metric results. Default: unknown."
    group.add_argument(
        "--camera-height", dest="camera_height_m", type=float, metavar="M", help=height
    )


def _add_prediction(group: argparse._ArgumentGroup) -> None:
    future = "Number of predicted frames. Default: 20."
    group.add_argument(
        "--future", dest="num_future", type=positive, default=20, metavar="N", help=future
    )
    samples = "Number of sampled futures. Default: 1."
    group.add_argument(
        "--samples", dest="num_samples", type=positive, default=1, metavar="N", help=samples
    )
    spec = "Name or TOML table of a component; see `geovp list"
    for role in ("pose-source", "renderer", "predictor"):
        text = f"{spec} {role.replace('-', '_')}s`."
        group.add_argument(f"--{role}", type=_spec, metavar="SPEC", help=text)
    method = "Matrix file or built-in matrix, and one of its methods, instead of components."
    group.add_argument("--method", nargs=2, metavar=("MATRIX", "METHOD"), help=method)
    add_device(group)


def _size(text: str) -> int | tuple[int, int]:
    """Parse one side of a square, or a width and a height."""
    min_side_px, max_side_px = 16, 8192
    sides = [positive(side) for side in text.lower().split("x")]
    if len(sides) > 2 or not min_side_px <= min(sides) <= max(sides) <= max_side_px:
        raise argparse.ArgumentTypeError(
            f"{text} is not a size such as 640x360 or 256, of {min_side_px} to {max_side_px}"
        )
    return sides[0] if len(sides) == 1 else (sides[0], sides[1])


def _spec(text: str) -> dict[str, Any] | str:
    """Parse the name or the table of a component."""
    if not text.lstrip().startswith("{"):
        return text
    try:
        table: dict[str, Any] = tomllib.loads(f"spec = {text}")["spec"]
    except (ValueError, RecursionError) as error:
        raise argparse.ArgumentTypeError(f"{text} is not a table as in TOML ({error})") from error
    return table


def _new_folder(wanted: Path) -> Path:
    """Return the folder, with -2, -3, ... appended if it exists."""
    names = itertools.chain(
        [wanted], (wanted.with_name(f"{wanted.name}-{n}") for n in itertools.count(2))
    )
    return next(path for path in names if not path.exists())


def run(args: argparse.Namespace) -> int:
    """Predict, write all files and print their paths."""
    from geovp_benchmarks.predict import exports, prediction
    from geovp_benchmarks.predict.request import PredictionRequest
    from geovp_benchmarks.progress import announce
    from geovp_classic import registry

    if args.out is not None:
        exports.check_free(args.out)
    fields = {
        field.name: getattr(args, field.name) for field in dataclasses.fields(PredictionRequest)
    }
    numbers = {
        name: fields[name] and tuple(fields[name])
        for name in ("intrinsics", "distortion", "method")
    }
    request = PredictionRequest(**{**fields, **numbers})
    with progress_bar("predict", "stages") as progress:
        progress(0, 6)
        predicted = prediction.predict(request)
        announce("writing files", 1)
        name = f"{args.path.resolve().stem}-{predicted.first:06d}"
        folder = args.out or _new_folder(Path("results/predict") / name)
        written = exports.write(predicted, folder)
    if args.amount != "quiet":
        print(*predicted.summary(), sep="\n", file=sys.stderr)
    if not any(path.suffix == ".mp4" for path in written):
        say.warning(f"the film is a gif alone; for H.264: {registry.install_command('video')}")
    print(*written, sep="\n")
    return 0
