"""Draw the film strips of the site on the synthetic street: python docs/film_strip.py."""

from pathlib import Path

import geovp
from geovp.drawing.page import Page
from geovp.drawing.strip import draw_strip

CLIP = 3  # brakes at a crossing
SIZE_PX = (192, 192)
IMAGES = Path(__file__).parent / "images"


def main() -> None:
    """Draw the real future and predictions of the landing page, and of the page on `field`."""
    clip = geovp.open_clip({"name": "synthetic", "num_clips": 8, "size_px": SIZE_PX}, CLIP)
    context, target = clip.split(10, ~geovp.PrivilegedInput.NONE)
    real = {"real": geovp.Prediction(target.frames[None])}
    copied = {"copied": geovp.build("predictors", "copy-last").predict(context)}
    _draw(
        "street",
        clip,
        {
            **real,
            "true poses": geovp.predict(context, "registered"),
            "no true pose": geovp.predict(context.only(geovp.PrivilegedInput.CAMERA_HEIGHT)),
            **copied,
        },
    )
    alone = context.only(geovp.PrivilegedInput.NONE)
    names = ("default", "flow-extrapolation")
    predictors = {name: geovp.build("predictors", name) for name in names}
    predictions = {name: each.predict(alone) for name, each in predictors.items()}
    _draw("field", clip, {**real, **predictions, **copied})


def _draw(name: str, clip: geovp.Clip, predictions: dict[str, geovp.Prediction]) -> None:
    strip = Page(name)
    rows = {label: prediction.frames[0] for label, prediction in predictions.items()}
    ahead_s = clip.times_s[10:] - clip.times_s[9]
    draw_strip(strip, rows, ahead_s, 6.0)
    strip.write(IMAGES / f"{name}.jpg")


if __name__ == "__main__":
    main()
