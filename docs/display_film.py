"""Draw the film of the predictive display on the synthetic street: python docs/display_film.py."""

from pathlib import Path

import cv2
import numpy as np
from PIL import Image

import geovp
from geovp.display import drawing
from geovp.drawing.video import labelled
from geovp_classic.streaming import LivePredictor
from geovp_classic.types import ByteArray

CLIP = 13  # accelerates behind a car; the second round of `accelerate`
NUM_FRAMES = 50
DELAY = 5  # frames of 0.1 s
FIRST = 8  # observed frames before the film starts
SIZE_PX = (256, 256)
SHOWN_PX = (210, 210)
FILM = Path(__file__).parent / "images" / "display.webp"


def main() -> None:
    """Write late, predicted and true images of each instant side by side."""
    street = {"name": "synthetic", "num_clips": CLIP + 1, "num_frames": NUM_FRAMES}
    clip = geovp.open_clip({**street, "size_px": SIZE_PX}, CLIP)
    live = LivePredictor(clip.intrinsics, clip.camera_height_m)
    images = []
    for step, now_s in enumerate(clip.times_s[DELAY:]):
        live.push(clip.frames[step], clip.times_s[step])
        if step < FIRST:
            continue
        view = live.view(now_s)
        predicted = drawing.draw_view(view, is_dimming=False, is_marking=True)
        if view.warning is not None:
            predicted = drawing.draw_warning(view.frame, view.warning)
        panels = {
            f"late ({DELAY / 10:g} s)": clip.frames[step],
            "predicted": predicted,
            "true": clip.frames[step + DELAY],
        }
        images.append(np.concatenate([_panel(*panel) for panel in panels.items()], axis=1))
    first, *others = [Image.fromarray(image) for image in images]
    first.save(FILM, save_all=True, append_images=others, duration=100, loop=0, quality=60)


def _panel(name: str, frame: ByteArray) -> ByteArray:
    return labelled(cv2.resize(frame, SHOWN_PX, interpolation=cv2.INTER_AREA), name)


if __name__ == "__main__":
    main()
