"""The kept clips as films side by side: one image of all frames a row, which the page's script
shows one by one.
"""

import io
from collections.abc import Iterator, Mapping, Sequence

import cv2
import numpy as np
from PIL import Image

from geovp_benchmarks.plots import kept_clips
from geovp_benchmarks.plots.material import Material
from geovp_benchmarks.plots.strips import INPAINTED
from geovp_benchmarks.plots.video import HORIZONS
from geovp_benchmarks.report.markup import Html, data_url, joined, tag
from geovp_classic.types import BoolArray, ByteArray, Clip

TRUTH = "ground truth"
MEANS = "The numbers under a film are means over all predicted frames of the clip."
WIDTH_PX, QUALITY = 144, 60  # of a frame in the page
FIRST_SHOWN = 10  # step; all films show the same image at step 0


def browser(material: Material, figures: Mapping[str, Sequence[Html]]) -> Html:
    """A choice of clips and, for each, the films of all rows from the last observed frame on,
    strips, and paths.
    """
    kept = [name for name, _ in material.results.clips()]
    selection = material.protocol.get("kept") or {"by": "", "clips": []}
    chosen = [name for name in selection["clips"] if name in kept]
    names = [*chosen, *(name for name in kept if name not in chosen)]
    clips = [(name, _films(material, material.results.clip(name))) for name in names]
    if not any(films for _, films in clips):
        return Html("")
    shown = [_clip(material, name, films, figures.get(name, ())) for name, films in clips]
    return joined(
        (
            _controls(material, names, chosen, selection["by"]),
            tag("p", MEANS, class_="notes"),
            *shown,
        )
    )


def film(frames: ByteArray) -> bytes:
    """The frames [K, H, W, 3] from left to right as WebP."""
    return _encoded(
        Image.fromarray(np.concatenate([_small(frame) for frame in frames], axis=1)), "WEBP"
    )


def mask(covered: BoolArray) -> bytes:
    """The pixels [K, H, W] that are not covered, from left to right, as PNG that is transparent
    elsewhere.
    """
    inpainted = [
        cv2.threshold(_small(np.uint8(255) * ~one), 127, 1, cv2.THRESH_BINARY)[1] for one in covered
    ]
    image = Image.fromarray(np.concatenate(inpainted, axis=1), "P")
    image.putpalette([0, 0, 0, *(int(one) for one in INPAINTED)])
    return _encoded(image, "PNG")


def _films(material: Material, clip: Clip) -> list[Html]:
    past = material.protocol["num_past"]
    last, films = clip.frames[past - 1 : past], []
    for cell in material.cells:
        if clip.name not in dict(material.results.predictions(cell.name)):
            continue
        prediction = material.results.prediction(cell.name, clip.name)
        covered = None
        if prediction.covered is not None and not prediction.covered[0].all():
            covered = np.concatenate(
                [np.ones((1, *prediction.covered.shape[2:]), bool), prediction.covered[0]]
            )
        notes = kept_clips.notes(material, cell, clip.name, len(prediction.frames))
        films.append(
            _figure(cell.label, notes, np.concatenate([last, prediction.frames[0]]), covered)
        )
    return [_figure(TRUTH, [], clip.frames[past - 1 :], None), *films] if films else []


def _figure(label: str, notes: Sequence[str], frames: ByteArray, covered: BoolArray | None) -> Html:
    images = [
        tag(
            "img",
            src=data_url(film(frames), "webp"),
            alt=f"{label}: all frames, from left to right",
        )
    ]
    if covered is not None:
        images.append(tag("img", src=data_url(mask(covered), "png"), alt="", class_="mask"))
    height_px, width_px = frames.shape[1:3]
    frame = tag("div", *images, class_="frame", style=f"aspect-ratio:{width_px}/{height_px}")
    caption = tag("figcaption", label, *(tag("small", note) for note in notes))
    row = {} if label == TRUTH else {"data_row": label}
    return tag(
        "figure",
        frame,
        caption,
        class_="film",
        data_name=label,
        data_frames=str(len(frames)),
        **row,
    )


def _clip(material: Material, name: str, films: Sequence[Html], figures: Sequence[Html]) -> Html:
    steps = [k for k in HORIZONS if k <= material.protocol["num_future"]]
    strips = tag("div", class_="strips", data_steps=" ".join(map(str, steps)))
    folded = tag("details", tag("summary", "Film strips"), strips, class_="script")
    below = tag("details", tag("summary", "Paths"), *figures) if figures else ""
    return tag(
        "div", tag("h3", name), tag("div", *films, class_="films"), folded, below, class_="clip"
    )


def _controls(material: Material, names: Sequence[str], chosen: Sequence[str], by: str) -> Html:
    """What the script listens to; without it, all clips are shown, and films as their
    first frames.
    """
    options = [tag("option", name) for name in names]
    groups: Iterator[Html] = iter(options)
    if chosen:
        groups = (
            tag("optgroup", *part, label=label)
            for label, part in ((by, options[: len(chosen)]), ("others", options[len(chosen) :]))
            if part
        )
    last = str(material.protocol["num_future"])
    first = str(min(FIRST_SHOWN, material.protocol["num_future"]))
    step_s = "" if material.step_s is None else str(material.step_s)
    return tag(
        "div",
        tag("label", "clip ", tag("select", *groups, id="clip")),
        tag("button", "play", id="play", type="button"),
        tag(
            "label", "frame ", tag("input", type="range", id="step", min="0", max=last, value=first)
        ),
        tag("output", "", id="when", data_step_s=step_s),
        tag("label", tag("input", type="checkbox", id="inpainted"), " mark inpainted pixels"),
        class_="bar script",
    )


def _small(image: ByteArray) -> ByteArray:
    """At most WIDTH_PX wide."""
    scale = min(1.0, WIDTH_PX / image.shape[1])
    size_px = round(image.shape[1] * scale), max(1, round(image.shape[0] * scale))
    return np.asarray(cv2.resize(image, size_px, interpolation=cv2.INTER_AREA), np.uint8)


def _encoded(image: Image.Image, kind: str) -> bytes:
    buffer = io.BytesIO()
    options = (
        {"quality": QUALITY, "method": 4}
        if kind == "WEBP"
        else {"transparency": 0, "bits": 1, "optimize": True}
    )
    image.save(buffer, kind, **options)
    return buffer.getvalue()
