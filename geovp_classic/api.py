"""The public functions: open a clip, predict its future frames, evaluate and show
the prediction.
"""

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from geovp_classic import registry
from geovp_classic.data import layouts
from geovp_classic.errors import BadData
from geovp_classic.interfaces import Dataset, FrameMetric, PoseSource, Renderer
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.types import Clip, Context, FloatArray, Prediction, Target

MOST_SAMPLES, GAP_PX, LABEL_PX = 5, 4, 14  # of a film strip
Spec = str | Mapping[str, Any]  # "name" or {"name": ..., **settings}, as in a matrix file


def open_clip(source: Spec | Path, index: int = 0) -> Clip:
    """Clip number `index` of a data set, ground truth included where there is any.

    `source` is a table {"name": ..., **settings} as in a matrix file, the name of a data set that
    needs no settings ("synthetic"), or a folder laid out as KITTI odometry or raw, TUM RGB-D, EuRoC
    or a COLMAP model with its images. BadData says what is wrong with it.
    """
    dataset: Dataset = registry.build("datasets", _dataset_spec(source))
    if not 0 <= index < len(dataset):
        raise BadData(
            f"index is {index}, but {dataset.name} has {len(dataset)} clips: give 0 to "
            f"{len(dataset) - 1}"
        )
    return dataset[index]


def predict(
    context: Context,
    pose_source: PoseSource | Spec | None = None,
    renderer: Renderer | Spec = "depth-fusion",
    num_samples: int = 1,
) -> Prediction:
    """Predicted frames [S, F, H, W, 3] for the future times of the context, with coverage and
    motion.

    Parts are components, or names and tables that `build` makes them of. Without a pose source the
    camera is tracked in the observed frames and its motion forecast and refined; in metres if the
    context has the camera's height. Incompatible says which grant a part lacks.
    """
    if pose_source is None:
        scale = "unit-speed" if context.camera_height_m is None else "ground-plane"
        odometry = {"name": "monocular", "scale": {"name": scale}}
        pose_source = {"name": "refined", "source": {"name": "chained", "odometry": odometry}}
    predictor = GeometricPredictor(
        _built("pose_sources", pose_source), _built("renderers", renderer)
    )
    return predictor.predict(context, num_samples)


def evaluate(
    prediction: Prediction, target: Target, metrics: Sequence[Spec] = ("psnr", "ssim")
) -> dict[str, FloatArray]:
    """Values [S, F] of each frame metric, by its name: one for every sample and future step, not
    averaged.
    """
    values = {}
    for spec in metrics:
        metric: FrameMetric = registry.build("frame_metrics", spec)
        if prediction.frames.shape[1:] != target.frames.shape:
            raise BadData(
                f"predicted frames have shape {prediction.frames.shape}, the real ones "
                f"{target.frames.shape}: give the "
                "target of the same split of the same clip"
            )
        name = spec if isinstance(spec, str) else str(spec["name"])
        values[name] = np.stack(
            [metric(frames, target.frames, None) for frames in prediction.frames]
        )
    return values


def show(shown: Clip | Prediction, num_frames: int = 6) -> Image.Image:
    """A film strip, which a notebook displays: frames evenly spread from the first to the last.

    A clip is one row, with seconds since its first frame; a prediction a row for each of its
    samples, up to MOST_SAMPLES of them, with the number of the future frame.
    """
    if num_frames < 1:
        raise BadData(f"num_frames is {num_frames}: give 1 or more")
    rows = shown.frames[None] if isinstance(shown, Clip) else shown.frames[:MOST_SAMPLES]
    steps = np.unique(np.linspace(0, rows.shape[1] - 1, num_frames).round().astype(int))
    times_s = shown.times_s - shown.times_s[0] if isinstance(shown, Clip) else None
    height_px, width_px = rows.shape[2] + GAP_PX, rows.shape[3] + GAP_PX
    strip = Image.new(
        "RGB", (len(steps) * width_px - GAP_PX, len(rows) * height_px + LABEL_PX - GAP_PX), "white"
    )
    pen = ImageDraw.Draw(strip)
    for column, step in enumerate(steps):
        words = f"+{step + 1}" if times_s is None else f"{times_s[step]:.1f} s"
        pen.text((column * width_px + 2, 1), words, fill="black")
        for row, frames in enumerate(rows):
            strip.paste(
                Image.fromarray(frames[step]), (column * width_px, LABEL_PX + row * height_px)
            )
    return strip


def _built(role: str, part: object) -> Any:
    return registry.build(role, part) if isinstance(part, (str, Mapping)) else part


def _dataset_spec(source: Spec | Path) -> Spec:
    if isinstance(source, Mapping) or source in registry.names("datasets"):
        return source
    root = Path(source).expanduser()
    with contextlib.suppress(BadData):
        if layouts.name_of(root) != "folder":
            return layouts.spec(root)
    raise BadData(
        f"{source} is neither a data set that `geovp list datasets` names nor a folder of KITTI "
        "odometry or raw, TUM "
        "RGB-D, EuRoC or COLMAP: give "
        'a table such as {"name": "folder", "path": "video.mp4", "intrinsics": [fx, fy, cx, cy]}'
    )
