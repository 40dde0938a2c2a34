"""Draw the film strip of the landing page: python docs/film_strip.py."""

from pathlib import Path

import geovp
from geovp.drawing.page import Page
from geovp.drawing.strip import draw_strip

CLIP = 3  # brakes at a crossing
SIZE_PX = (192, 192)
OUT = Path(__file__).parent / "images" / "street.jpg"


def main() -> None:
    """Draw the real future and predictions with true poses, without poses, and by copying."""
    clip = geovp.open_clip({"name": "synthetic", "num_clips": 8, "size_px": SIZE_PX}, CLIP)
    context, target = clip.split(10, ~geovp.PrivilegedInput.NONE)
    predictions = {
        "real": geovp.Prediction(target.frames[None]),
        "true poses": geovp.predict(context, "registered"),
        "no true pose": geovp.predict(context.only(geovp.PrivilegedInput.CAMERA_HEIGHT)),
        "copied": geovp.build("predictors", "copy-last").predict(context),
    }
    strip = Page("street")
    rows = {name: prediction.frames[0] for name, prediction in predictions.items()}
    ahead_s = context.times_s[10:] - context.times_s[9]
    draw_strip(strip, rows, ahead_s, 6.0)
    strip.write(OUT)


if __name__ == "__main__":
    main()
