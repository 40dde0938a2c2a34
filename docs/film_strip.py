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
    """Draw the real future and predictions with true poses, without poses, and by copying."""
    clip = geovp.open_clip({"name": "synthetic", "num_clips": 8, "size_px": SIZE_PX}, CLIP)
    context, target = clip.split(10, ~geovp.PrivilegedInput.NONE)
    predictions = {
        "real": geovp.Prediction(target.frames[None]),
        "true poses": geovp.predict(context, "registered"),
        "no true pose": geovp.predict(context.only(geovp.PrivilegedInput.CAMERA_HEIGHT)),
        "copied": geovp.build("predictors", "copy-last").predict(context),
    }
    sheet = video.film_strip({name: each.frames[0] for name, each in predictions.items()})
    OUT.write_bytes(
        cv2.imencode(
            ".jpg", np.ascontiguousarray(sheet[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 88]
        )[1]
    )


if __name__ == "__main__":
    main()
