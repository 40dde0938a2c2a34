"""PSNR of moving pixels on the synthetic street, with and without layers.

Moving pixels are those of the stratum `moving` of tables: cars and their shadows, in the frame that
is predicted. A clip's value is the mean over its predicted frames. The table lists clips in which
something moves, for recorded poses and for those of odometry and a motion prior.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from geovp.progress import tracked
from geovp_benchmarks.cli.options import option
from geovp_benchmarks.tables.formats import grid
from geovp_classic import registry
from geovp_classic.metrics.image import Psnr
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.renderers.depth_fusion import DepthFusion
from geovp_classic.types import Clip, FloatArray

ARGUMENTS = {
    "": {
        "clips N = 15": option("Number of clips.", nargs="?"),
        "--size N = 256": "Side of the square frames in pixels.",
    }
}
POSE_SOURCES = ("ground-truth", "chained")


def run(args: argparse.Namespace) -> Iterator[str]:
    """Yield the values of each clip and their means, in dB."""
    street = {"name": "synthetic", "num_clips": args.clips, "size_px": [args.size, args.size]}
    dataset = registry.build("datasets", street)
    lines, values = [], []
    for number in tracked(range(len(dataset))):
        clip = dataset[number]
        if clip.moving is None or not clip.moving[10:].any():
            continue
        psnr_db = np.array([moving_psnr_db(clip, name) for name in POSE_SOURCES])
        values.append(psnr_db)
        lines.append([clip.name, *_texts(psnr_db)])
    heads = [f"{name}: {what}" for name in POSE_SOURCES for what in ("static", "layers", "gain")]
    mean = ["mean", *_texts(np.mean(values, axis=0))]
    yield from grid([["clip", *heads], *lines, mean])


def moving_psnr_db(clip: Clip, pose_source: str, num_past: int = 10) -> FloatArray:
    """Return the mean PSNR of moving pixels [2], without and with layers."""
    source = registry.build("pose_sources", pose_source)
    layered = DepthFusion()
    scores = []
    for renderer in (replace(layered, moving=None), layered):
        predictor = GeometricPredictor(source, renderer)
        context, target = clip.split(num_past, predictor.needs)
        prediction = predictor.predict(context)
        psnr_db = Psnr()(prediction.frames[0], target.frames, target.moving)
        scores.append(np.nanmean(psnr_db))  # frames without moving pixels have none
    return np.array(scores)


def _texts(psnr_db: FloatArray) -> list[str]:
    """Return values [pose source, renderer] and the gains of layers as text."""
    return [
        text
        for static, layers in psnr_db
        for text in (f"{static:.2f}", f"{layers:.2f}", f"{layers - static:+.2f}")
    ]
