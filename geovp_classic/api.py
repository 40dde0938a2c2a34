"""Public functions: open a clip, predict its future frames, evaluate and show the prediction."""

import logging
from collections.abc import Mapping, Sequence
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from geovp_classic import registry
from geovp_classic.data.layouts import detection
from geovp_classic.errors import BadData, check_kind
from geovp_classic.interfaces import Dataset, FrameMetric, PoseSource, Renderer
from geovp_classic.observation import Observer
from geovp_classic.predictors.default import default_pose_source
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.predictors.hindcast import Hindcast
from geovp_classic.types import Clip, Context, FloatArray, Prediction, ShownBy, Target

DEFAULT_HINDCAST = Hindcast()
SHOWN_BY: dict[ShownBy | None, str] = {
    "image-motion": "the motion of the image",
    "last-frame": "the last frame",
}

logger = logging.getLogger(__name__)

Spec = str | Mapping[str, Any]  # "name" or {"name": ..., **settings}, as in a matrix file


def open_clip(source: Spec | Path, index: int = 0) -> Clip:
    """Open clip number `index` of a data set, with ground truth if the data set has any.

    `source` is a table {"name": ..., **settings} as in a matrix file, the name of a data set
    without required settings ("synthetic"), or a folder in the layout of KITTI odometry or raw,
    TUM RGB-D, EuRoC, or a COLMAP model with its images, or a ROS bag. Raises BadData for any other
    source.
    """
    check_kind(
        "source", source, (str, Path, Mapping), "a folder, the name of a data set, or a table"
    )
    check_kind("index", index, Integral, "a whole number")
    if not isinstance(source, Mapping) and source not in registry.names("datasets"):
        source = detection.spec(Path(source).expanduser())
    dataset: Dataset = registry.build("datasets", source)
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
    mask: Path | str | None = None,
    hindcast: Hindcast | None = DEFAULT_HINDCAST,
) -> Prediction:
    """Predict frames [S, F, H, W, 3] for the future times of the context.

    Components are given as objects, names or tables. Without a pose source, the camera is tracked
    in the observed frames, and its motion is forecast and refined; lengths are metres if the
    context has the camera's height. `mask` is an image file that is nonzero where no scene is
    shown, such as the hood, in any size. Raises Incompatible if a privileged input is missing.

    Image motion or the last frame replaces a scene that predicts the last observed frames worse
    from the first ones: a warning is logged, and `is_trusted` of the prediction is False. With
    `hindcast=None`, each scene is shown.
    """
    check_kind("context", context, Context, "the first part of `clip.split(...)`")
    check_kind("num_samples", num_samples, Integral, "a whole number")
    check_kind("mask", mask, (str, Path, type(None)), "an image file or None")
    check_kind(
        "hindcast", hindcast, (Hindcast, type(None)), "a Hindcast, or None to show each scene"
    )
    if not num_samples >= 1:
        raise BadData(f"num_samples is {num_samples}: give 1 or more")
    # Track, forecast, refine and render, with a hindcast of the result
    if pose_source is None:
        pose_source = default_pose_source(context.camera_height_m is not None)
    predictor = GeometricPredictor(
        _build("pose_sources", pose_source),
        _build("renderers", renderer),
        Observer(mask=None if mask is None else Path(mask)),
        hindcast,
    )
    prediction = predictor.predict(context, num_samples)
    # Nothing is replaced silently
    if not prediction.is_trusted:
        logger.warning(
            "the scene predicts the last observed frames worse than %s, which replaces it: check "
            "the intrinsics and times, or give hindcast=None to see the scene",
            SHOWN_BY[prediction.shown_by],
        )
    return prediction


def evaluate(
    prediction: Prediction,
    target: Target,
    metrics: Sequence[Spec] = ("psnr", "ssim"),
) -> dict[str, FloatArray]:
    """Return the values [S, F] of each frame metric by name, for each sample and future step."""
    check_kind("prediction", prediction, Prediction, "a Prediction")
    check_kind("target", target, Target, "the second part of `clip.split(...)`")
    values: dict[str, FloatArray] = {}
    for spec in [metrics] if isinstance(metrics, str) else metrics:
        metric: FrameMetric = registry.build("frame_metrics", spec)
        name = spec if isinstance(spec, str) else spec["name"]
        if name in values:
            raise BadData(f"the metric {name!r} is given twice: evaluate each variant by itself")
        samples = [metric(frames, target.frames, None) for frames in prediction.frames]
        values[name] = np.stack(samples)
    return values


def show(
    shown: Clip | Context | Target | Prediction, num_frames: int = 6, max_samples: int = 5
) -> Image.Image:
    """Draw a film strip of frames evenly spaced from the first to the last, for a notebook.

    A clip or context is one row, labelled with seconds since its first frame; a target is one that
    is labelled with the number of the future frame. A prediction has such a row per sample.
    """
    check_kind("shown", shown, (Clip, Context, Target, Prediction), "a clip or a prediction")
    for name, number in (("num_frames", num_frames), ("max_samples", max_samples)):
        check_kind(name, number, Integral, "a whole number")
    if min(num_frames, max_samples) < 1:
        raise BadData(
            f"num_frames is {num_frames} and max_samples {max_samples}: give 1 or more of each"
        )
    rows = shown.frames[:max_samples] if isinstance(shown, Prediction) else shown.frames[None]
    if isinstance(shown, (Clip, Context)):
        times_s = shown.times_s - shown.times_s[0]
        digits = 1 if np.diff(times_s).min(initial=1.0) > 0.095 else 2  # as of film strips
        labels = [f"{time_s:.{digits}f} s" for time_s in times_s]
    else:
        labels = [f"+{step + 1}" for step in range(rows.shape[1])]
    steps = np.linspace(0, rows.shape[1] - 1, num_frames)
    steps = np.unique(steps.round().astype(int))
    height_px = rows.shape[2] + 14  # labels above
    width_px = rows.shape[3] + 4  # gaps between
    size_px = (len(steps) * width_px, len(rows) * height_px)
    strip = Image.new("RGB", size_px, "white")
    pen = ImageDraw.Draw(strip)
    for column, step in enumerate(steps):
        left_px = column * width_px + 2
        for row, frames in enumerate(rows):
            tile = Image.fromarray(frames[step])
            strip.paste(tile, (left_px, row * height_px + 14))
        pen.text((left_px, 1), labels[step], fill="black")
    return strip


def _build(role: str, component: object) -> Any:
    if isinstance(component, (str, Mapping)):
        return registry.build(role, component)
    protocol = registry.PROTOCOL_OF_ROLE[role]
    if isinstance(component, type) or not isinstance(component, protocol):
        raise BadData(
            f"{component!r} is none of the {role}: give a name, a table, or an object with the "
            f"attributes of interfaces.{protocol.__name__}"
        )
    return component
