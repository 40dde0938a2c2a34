"""One clip in; predicted frames, poses, cloud, film strip and video out."""

import argparse
import dataclasses
import itertools
import sys
import tomllib
from pathlib import Path
from typing import Any

from geovp_benchmarks.cli.arguments import add_device, positive
from geovp_benchmarks.cli.messages import say
from geovp_benchmarks.progress import progress_bar

MIN_SIDE_PX, MAX_SIDE_PX = 16, 8192


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which frames, which camera, and how many frames are predicted."""
    parser.add_argument(
        "path", type=Path, metavar="VIDEO|FOLDER|WEBCAM", help="or 0, 1, ... of a webcam"
    )
    of_images = "in pixels of the images as they are stored, (0, 0) the centre of the top-left one"
    parser.add_argument(
        "--intrinsics", type=float, nargs=4, metavar=("FX", "FY", "CX", "CY"), help=of_images
    )
    parser.add_argument(
        "--fov", dest="fov_deg", type=float, metavar="DEG", help="horizontal angle of view instead"
    )
    known = (
        "a file of intrinsics and distortion: KITTI's calib.txt, COLMAP's cameras.txt, a ROS or "
        "Kalibr yaml"
    )
    parser.add_argument("--calibration", type=Path, metavar="FILE", help=known)
    lens = (
        "lens distortion beside --intrinsics or --fov, as OpenCV's k1 k2 [p1 p2 [k3 [k4 k5 "
        "k6]]]; it is taken out"
    )
    parser.add_argument("--distortion", type=float, nargs="+", metavar="K", help=lens)
    parser.add_argument(
        "--fps",
        dest="rate_hz",
        type=float,
        metavar="HZ",
        help="frames a second; needed for a folder",
    )
    parser.add_argument(
        "--camera-height",
        dest="camera_height_m",
        type=float,
        metavar="M",
        help="above the road: poses and cloud in metres",
    )
    parser.add_argument(
        "--first", type=int, metavar="N", help="first observed frame (default: the latest possible)"
    )
    parser.add_argument(
        "--past",
        dest="num_past",
        type=positive,
        default=10,
        metavar="N",
        help="observed frames (10)",
    )
    parser.add_argument(
        "--future",
        dest="num_future",
        type=positive,
        default=20,
        metavar="N",
        help="predicted frames (20)",
    )
    size = (
        "width and height, or the side of the square middle (default: the video's aspect, at "
        "most 640 long)"
    )
    parser.add_argument("--size", dest="size_px", type=_size, metavar="WxH|PX", help=size)
    parser.add_argument(
        "--full",
        dest="with_full",
        action="store_true",
        help="use the whole images, not only their middle",
    )
    parser.add_argument(
        "--mask",
        type=Path,
        metavar="FILE",
        help="image that is nonzero where the video shows no scene, such as the hood; in any size",
    )
    spec = "as in a matrix: a name, or a table '{ name = ..., ... }'"
    for name, role in (
        ("--pose-source", "pose_sources"),
        ("--renderer", "renderers"),
        ("--predictor", "predictors"),
    ):
        parser.add_argument(
            name, type=_spec, metavar="SPEC", help=f"{spec}; see `geovp list {role}`"
        )
    of_matrix = (
        "a method of a matrix in place of these: a file or a built-in one's name, and the "
        "method's name"
    )
    parser.add_argument("--method", nargs=2, metavar=("MATRIX", "METHOD"), help=of_matrix)
    parser.add_argument(
        "--samples", dest="num_samples", type=positive, default=1, metavar="N", help="futures (1)"
    )
    add_device(parser)
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="a new folder (default: results/predict/NAME-FIRST, with -2, ... where that is taken)",
    )


def _size(text: str) -> int | tuple[int, int]:
    """One side of a square, or a width and a height."""
    sides = [positive(side) for side in text.lower().split("x")]
    if len(sides) > 2 or not MIN_SIDE_PX <= min(sides) <= max(sides) <= MAX_SIDE_PX:
        raise argparse.ArgumentTypeError(
            f"{text} is not a size such as 640x360 or 256, of {MIN_SIDE_PX} to {MAX_SIDE_PX}"
        )
    return sides[0] if len(sides) == 1 else (sides[0], sides[1])


def _spec(text: str) -> dict[str, Any] | str:
    """A component's name, or its table."""
    if not text.lstrip().startswith("{"):
        return text
    try:
        table: dict[str, Any] = tomllib.loads(f"spec = {text}")["spec"]
    except (ValueError, RecursionError) as error:
        raise argparse.ArgumentTypeError(f"{text} is not a table as in TOML ({error})") from error
    return table


def _new_folder(wanted: Path) -> Path:
    """The folder, or with -2, -3, ... behind its name where that is taken."""
    names = itertools.chain(
        [wanted], (wanted.with_name(f"{wanted.name}-{n}") for n in itertools.count(2))
    )
    return next(path for path in names if not path.exists())


def run(chosen: argparse.Namespace) -> int:
    """Predict, write everything and print the paths."""
    from geovp_benchmarks.predict import prediction, prediction_files
    from geovp_benchmarks.predict.prediction_request import PredictionRequest
    from geovp_classic import registry

    if chosen.out is not None:
        prediction_files.check_free(chosen.out)
    fields = {
        field.name: getattr(chosen, field.name) for field in dataclasses.fields(PredictionRequest)
    }
    numbers = {
        name: fields[name] and tuple(fields[name])
        for name in ("intrinsics", "distortion", "method")
    }
    request = PredictionRequest(**{**fields, **numbers})
    with progress_bar("predict", "stages") as progress:
        predicted = prediction.predict(request, progress)
        name = f"{chosen.path.resolve().stem}-{predicted.first:06d}"
        written = prediction_files.write(
            predicted, chosen.out or _new_folder(Path("results/predict") / name)
        )
        progress(prediction.NUM_STAGES, prediction.NUM_STAGES)
    if chosen.amount != "quiet":
        print(*predicted.summary(), sep="\n", file=sys.stderr)
    if not any(path.suffix == ".mp4" for path in written):
        say.warning(f"the film is a gif alone; for H.264: {registry.install_command('video')}")
    print(*written, sep="\n")
    return 0
