"""Show the predicted present of a delayed video.

Replay a recording or capture a camera, delay its images, and show the late image, the predicted
present and the true present on a local page, or write them to a video.

Examples:
  geovp display drive.mp4 --fov 80 --camera-height 1.4 --latency 0.5
  geovp display path/to/kitti --sequence '03[0:300)' --jitter 0.1 --loss 0.05 --out display.mp4
  geovp display 0 --fov 70 --camera-height 1.2 --drive
"""

import argparse
import contextlib
import threading

from geovp_benchmarks.cli.options import Lines, option
from geovp_benchmarks.cli.predict import CAMERA, FRAMES

ARGUMENTS = {
    "": {"path INPUT": "Video, folder of images, data set, bag, or the number of a camera."},
    "input": {
        **FRAMES,
        "--sequence NAME": (
            "Sequence of a data set or a part of it, such as 03[0:360). Default: the first."
        ),
        "--size SIZE": option(
            "WIDTHxHEIGHT, or side of a square. Default: aspect of the images, at most 480 px.",
            dest="size_px",
        ),
    },
    **CAMERA,
    "simulated channel": {
        "--latency S = 0.5": option("Delay of each image, 0 to 10 s.", dest="latency_s"),
        "--jitter S = 0": option(
            "Largest additional delay, 0 to 10 s, uniformly distributed.", dest="jitter_s"
        ),
        "--loss P = 0": "Probability that an image is lost.",
    },
    "motion, at most one of": {
        "--commands FILE": (
            "CSV file with the columns time_s,speed_m_s,yaw_rate_rad_s. Default: forecast."
        ),
        "--drive": "Set speed and yaw rate on the page. Default: forecast the motion.",
    },
    "page": {
        "--host ADDRESS = 127.0.0.1": (
            "Address of this computer to listen at, such as 0.0.0.0 for all."
        ),
        "--port NUMBER = 8765": "Port; 0: any free one.",
        "--token TEXT": (
            "Secret part of the page's address, to keep it over restarts. Default: random."
        ),
    },
    "output": {
        "--dim": "Dim inpainted pixels; the page can change it.",
        "--mark-moving": "Outline what is shown as moving on its own; the page can change it.",
        "--out FILE": "Write an mp4 file, and serve no page.",
    },
}


def run(args: argparse.Namespace) -> Lines:
    """Print the address of the page and serve it until interrupted, or write a video."""
    import secrets

    from geovp.display.channel import Channel
    from geovp.display.commands import Driver, read_commands
    from geovp.display.server import Server
    from geovp.display.session import Session, write_video
    from geovp.display.source import Source
    from geovp.prediction.request import PredictionRequest
    from geovp_classic.errors import BadData

    if args.out is not None and args.drive:
        raise BadData("--out writes a video without a page to drive at: remove --drive")
    source = Source.open(PredictionRequest(**vars(args)), args.sequence)
    channel = Channel(args.latency_s, args.jitter_s, args.loss)
    planned = [] if args.commands is None else read_commands(args.commands)
    session = Session(source, channel, planned, Driver() if args.drive else None)
    session.is_dimming = args.dim
    session.is_marking = args.mark_moving
    if args.out is not None:
        write_video(session, args.out)
        yield str(args.out)
        return
    with Server(session, args.host, args.port, args.token or secrets.token_urlsafe()) as server:
        yield server.url
        with contextlib.suppress(KeyboardInterrupt):
            server.play(threading.Event())
