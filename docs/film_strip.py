"""Draw the film strip of the README: python docs/film_strip.py."""

from pathlib import Path

import cv2
import numpy as np

import geovp_classic as geovp
from geovp_benchmarks.plots import video

CLIP = 3  # brakes at a crossing
SIZE_PX = (192, 192)
OUT = Path(__file__).parent / "images" / "street.jpg"


def main() -> None:
    """The real future beside what is predicted with true poses, with none, and by copying the last
    frame.
    """
    clip = geovp.open_clip({"name": "synthetic", "num_clips": 8, "size_px": SIZE_PX}, CLIP)
    context, target = clip.split(10, ~geovp.PrivilegedInput.NONE)
    predictions = {
        "real": geovp.Prediction(target.frames[None]),
        "true poses": geovp.predict(context, "registered"),
        "no true pose": geovp.predict(context.only(geovp.PrivilegedInput.CAMERA_HEIGHT)),
        "copied": geovp.build("predictors", "copy-last").predict(context),
    }
    shown = [horizon - 1 for horizon in video.HORIZONS]
    rows = [
        (name, [context.frames[-1], *one.frames[0][shown]]) for name, one in predictions.items()
    ]
    labels = ["(last seen)", *(f"+{horizon / 10:.1f} s" for horizon in video.HORIZONS)]
    sheet = video.strip(rows, labels)
    OUT.write_bytes(
        cv2.imencode(
            ".jpg", np.ascontiguousarray(sheet[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 88]
        )[1]
    )


if __name__ == "__main__":
    main()
