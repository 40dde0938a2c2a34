"""Draw the gallery of the site: python docs/gallery.py."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import geovp
from geovp.drawing.page import Page
from geovp.drawing.strip import draw_strip
from geovp_classic import registry

NUM_CLIPS = 17  # two of them of a stationary camera, which are left out; 15 have a median
NUM_PAST = 10
SIZE_PX = (192, 192)
METRICS = ("psnr", "lpips")  # the first ranks the clips
FOLDER = Path(__file__).parent / "images" / "gallery"


@dataclass(frozen=True)
class Shown:
    """A method of the gallery."""

    name: str  # of the file
    spec: Mapping[str, Any]  # as in a matrix file


def geometric(renderer: Mapping[str, Any], **pose_source: Any) -> Mapping[str, Any]:
    """Return the settings of a pose source with a renderer."""
    return {"name": "geometric", "pose_source": pose_source, "renderer": renderer}


FUSION = {"name": "depth-fusion"}
METHODS = (
    Shown("default", geometric(FUSION, name="refined", source={"name": "chained"})),
    Shown("recorded-poses", geometric(FUSION, name="ground-truth")),
    Shown("plane", geometric(FUSION, name="planar", source={"name": "ground-truth"})),
    Shown("volume-fusion", geometric({"name": "volume-fusion"}, name="ground-truth")),
    Shown("ground-far-plane", geometric({"name": "ground-far-plane"}, name="ground-truth")),
    Shown("synsin-small", geometric({"name": "synsin-small"}, name="ground-truth")),
    Shown("deepvo-small", geometric(FUSION, name="deepvo-small")),
    Shown("flow-extrapolation", {"name": "flow-extrapolation"}),
    Shown("homography-extrapolation", {"name": "homography-extrapolation"}),
    Shown("copy-last", {"name": "copy-last"}),
    Shown("mean-frame", {"name": "mean-frame"}),
)


def draw(shown: Shown, street: Sequence[geovp.Clip]) -> None:
    """Predict all clips, and draw those with the worst, median and best score."""
    method = registry.build("predictors", shown.spec)
    scores = []
    for clip in street:
        context, target = clip.split(NUM_PAST, method.needs)
        values = geovp.evaluate(method.predict(context), target, METRICS)
        scores.append([values[name].mean() for name in METRICS])
    order = np.argsort([score[0] for score in scores])
    shown_clips = order[[0, len(order) // 2, -1]]
    rows = {}
    for rank, number in zip(("worst", "median", "best"), shown_clips, strict=True):
        clip = street[number]
        context, target = clip.split(NUM_PAST, method.needs)
        psnr_db, lpips = scores[number]
        rows[f"{rank}: {clip.name}, true"] = target.frames
        label = f"{rank}: predicted, PSNR {psnr_db:.1f} dB, LPIPS {lpips:.2f}"
        rows[label] = method.predict(context).frames[0]
    ahead_s = context.times_s[NUM_PAST:] - context.times_s[NUM_PAST - 1]
    strip = Page(shown.name)
    draw_strip(strip, rows, ahead_s, 6.0)
    drawn = io.BytesIO()
    strip.figure.savefig(drawn, format="png", dpi=140)
    Image.open(drawn).convert("RGB").save(FOLDER / f"{shown.name}.webp", quality=70, method=6)
    numbers = " | ".join(f"{scores[number][0]:.1f}" for number in shown_clips)
    print(f"| {shown.name} | {numbers} |", flush=True)


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    data = {"name": "synthetic", "num_clips": NUM_CLIPS, "size_px": SIZE_PX}
    dataset = registry.build("datasets", data)
    clip_names = dataset.clip_names
    street = [dataset[k] for k in range(NUM_CLIPS) if "-stand/" not in clip_names[k]]
    for shown in METHODS:
        draw(shown, street)
