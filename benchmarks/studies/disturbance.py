"""How methods degrade: clips disturbed in twenty ways and four strengths, and what is left over copying the last frame.

A line a disturbance and strength, a column a pose source and renderer: mean PSNR over steps and clips, less that of the
disturbed last frame, copied. What lasts (noise, dimming, a hood) is in the real future as well; what passes (a black
frame, a swap) is not. `<` marks cells more than LIMIT_DB below copying, `-` those that could not be predicted.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from geovp_benchmarks.arguments import positive
from geovp_benchmarks.progress import Progress
from geovp_benchmarks.studies.ablation import NUM_FUTURE, NUM_PAST, SCORED, STRETCHES, dataset_specs, predict
from geovp_classic import registry
from geovp_classic.errors import BadData, GeovpError
from geovp_classic.types import ByteArray, Clip, Context, ExtraView, FloatArray, Intrinsics, Target

LIMIT_DB = 0.5
NUM_STRENGTHS = 4
NUM_STEPS = NUM_PAST + NUM_FUTURE
HEIGHT_PX = 256  # lengths in pixels are of an image of this height

Level = int  # 0 to NUM_STRENGTHS - 1
Image = Callable[[ByteArray, int, Level], ByteArray]  # the frame of a step (0 to NUM_STEPS - 1), disturbed


@dataclass(frozen=True)
class Disturbance:
    """What happens to a clip."""

    image: Image = lambda image, step, level: image
    order: Callable[[Level], list[int]] = lambda level: list(range(NUM_STEPS))  # which frame is shown at each step
    context: Callable[[Context, Level], Context] = lambda context, level: context
    poses_follow: bool = False  # whether the true poses take the frames' order


def _gain(*factors: float, steps: range = range(NUM_STEPS)) -> Image:
    return lambda image, step, level: _scaled(image, factors[level]) if step in steps else image


def _scaled(image: ByteArray, factor: float, offset: float = 0.0) -> ByteArray:
    return np.asarray(cv2.convertScaleAbs(image, alpha=factor, beta=offset))


def _flicker(image: ByteArray, step: int, level: Level) -> ByteArray:
    return _scaled(image, 1 - (0.1, 0.2, 0.4, 0.6)[level] * (step % 2)) if step < NUM_PAST else image


def _noise(image: ByteArray, step: int, level: Level) -> ByteArray:
    noise = np.random.default_rng([step, level]).normal(0, (5, 15, 30, 60)[level], image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def _blur(image: ByteArray, step: int, level: Level) -> ByteArray:
    if step != NUM_PAST - 3:
        return image
    length = max(2, round((5, 10, 20, 40)[level] * len(image) / HEIGHT_PX))
    return np.asarray(cv2.blur(image, (length, 1)))


def _hood(image: ByteArray, step: int, level: Level) -> ByteArray:
    hooded = image.copy()
    hooded[round(len(image) * (1 - (0.05, 0.1, 0.2, 0.3)[level])) :] = 40  # brighter than a bar
    return hooded


def _bars(image: ByteArray, step: int, level: Level) -> ByteArray:
    """Black bars above and below, as of a film."""
    barred, rows = image.copy(), round(len(image) * (0.04, 0.08, 0.12, 0.2)[level])
    barred[:rows] = barred[len(image) - rows :] = 0
    return barred


def _rain(image: ByteArray, step: int, level: Level) -> ByteArray:
    rng, wet = np.random.default_rng([step, level]), image.copy()
    height, width = image.shape[:2]
    for _ in range((40, 100, 250, 600)[level] * width // height):
        u, v = int(rng.integers(width)), int(rng.integers(height))
        cv2.line(wet, (u, v), (u + height // 80, v + height // 16), (200, 200, 200), 1, cv2.LINE_AA)
    return wet


def _tilt(image: ByteArray, step: int, level: Level) -> ByteArray:
    height, width = image.shape[:2]
    turn = cv2.getRotationMatrix2D((width / 2 - 0.5, height / 2 - 0.5), (2, 5, 10, 20)[level], 1)
    return np.asarray(cv2.warpAffine(image, turn, (width, height), borderMode=cv2.BORDER_REFLECT))


def _flat(value: int) -> Image:
    return lambda image, step, level: np.full_like(image, value) if 5 - level <= step <= 5 + level // 3 else image


def _shown(changes: Callable[[Level], Mapping[int, int]]) -> Callable[[Level], list[int]]:
    return lambda level: [changes(level).get(step, step) for step in range(NUM_STEPS)]


def _pattern(image: ByteArray, step: int, level: Level) -> ByteArray:
    side = max(1, round((4, 8, 16, 32)[level] * len(image) / HEIGHT_PX))
    v, u = np.indices(image.shape[:2]) // side
    tiles: ByteArray = np.asarray(40 + 160 * ((u + v) % 2), np.uint8)
    return np.repeat(tiles[:, :, None], 3, axis=2)


def _camera(change: Callable[[Intrinsics, Intrinsics, Level], Intrinsics]) -> Callable[[Context, Level], Context]:
    """Crop and whole frame seen by a camera that was calibrated wrongly."""

    def changed(context: Context, level: Level) -> Context:
        crop, wide = context.intrinsics, context.wide
        if wide is not None:
            wide = replace(wide, intrinsics=change(wide.intrinsics, crop, level))
        return replace(context, intrinsics=change(crop, crop, level), wide=wide)

    return changed


def _focal(camera: Intrinsics, crop: Intrinsics, level: Level) -> Intrinsics:
    factor = (1.05, 1.1, 1.2, 1.4)[level]
    return replace(camera, fx_px=camera.fx_px * factor, fy_px=camera.fy_px * factor)


def _centre(camera: Intrinsics, crop: Intrinsics, level: Level) -> Intrinsics:
    off = (0.05, 0.1, 0.2, 0.4)[level] * crop.cx_px / crop.fx_px  # the tangent of one angle for both
    return replace(camera, cx_px=camera.cx_px + off * camera.fx_px)


def _jittered_times(context: Context, level: Level) -> Context:
    step_s = float(np.diff(context.times_s).mean())
    shifts = np.random.default_rng(level).uniform(-0.5, 0.5, len(context.times_s)) * (0.1, 0.3, 0.6, 0.9)[level]
    return replace(context, times_s=context.times_s + shifts * step_s)


STANDING: Callable[[Level], list[int]] = lambda level: [NUM_PAST - 1] * NUM_STEPS  # noqa: E731
DISTURBANCES = {
    "none": Disturbance(),
    "black frames": Disturbance(_flat(0)),
    "white frames": Disturbance(_flat(255)),
    "repeated frames": Disturbance(
        order=_shown(lambda n: dict.fromkeys(range(6, 7 + (0, 0, 1, 2)[n]), 5) | ({9: 8} if n else {}))
    ),
    "swapped frames": Disturbance(
        order=_shown(lambda n: ({4: 5, 5: 4}, {7: 8, 8: 7}, {8: 9, 9: 8}, {2: 3, 3: 2, 8: 9, 9: 8})[n])
    ),
    "another scene before": Disturbance(lambda image, step, n: image[:, ::-1] if step < (3, 5, 7, 8)[n] else image),
    "one blurred frame": Disturbance(_blur),
    "noise": Disturbance(_noise),
    "rain": Disturbance(_rain),
    "dim": Disturbance(_gain(0.5, 0.25, 0.1, 0.05)),
    "low contrast": Disturbance(lambda image, step, n: _scaled(image, (0.5, 0.25, 0.1, 0.05)[n], 100)),
    "darker from frame 5 on": Disturbance(_gain(0.7, 0.5, 0.25, 0.1, steps=range(5, NUM_STEPS))),
    "darker from the last frame on": Disturbance(_gain(0.7, 0.5, 0.25, 0.1, steps=range(NUM_PAST - 1, NUM_STEPS))),
    "flicker": Disturbance(_flicker),
    "tilt": Disturbance(_tilt),
    "hood": Disturbance(_hood),
    "black bars": Disturbance(_bars),
    "wrong focal length": Disturbance(context=_camera(_focal)),
    "wrong principal point": Disturbance(context=_camera(_centre)),
    "jittered times": Disturbance(context=_jittered_times),
    "standing": Disturbance(order=STANDING, poses_follow=True),
    "standing with noise": Disturbance(_noise, STANDING, poses_follow=True),
    "standing before a pattern": Disturbance(_pattern, STANDING, poses_follow=True),
}


def columns() -> dict[str, tuple[Any, Any]]:
    """Pose source and renderer of each column."""
    sources = {"true": {"name": "ground-truth"}, "vo": {"name": "chained"}}
    renderers: dict[str, dict[str, Any]] = {
        "crop": {"name": "depth-fusion"},
        "wide": {"name": "depth-fusion", "frames": "wide"},
        "plane": {"name": "ground-far-plane"},
    }
    return {
        f"{source} {renderer}": (
            registry.build("pose_sources", {"name": "refined", "source": spec}),
            registry.build("renderers", renderers[renderer]),
        )
        for source, spec in sources.items()
        for renderer in renderers
    }


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Where the data is, and what of it."""
    parser.add_argument("root", type=Path, metavar="ROOT", help="a folder laid out as KITTI odometry")
    parser.add_argument("frames", nargs="*", default=STRETCHES[:2], metavar="FRAMES", help="stretches of sequences")
    parser.add_argument("--stride", type=positive, default=60, metavar="N", help="frames between clips' starts (60)")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="only these disturbances, by the words of the table")


def run(chosen: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """The table."""
    names = chosen.only or list(DISTURBANCES)
    if unknown := [name for name in names if name not in DISTURBANCES]:
        raise BadData(f"no disturbance is called {unknown[0]!r}{registry.nearest(unknown[0], DISTURBANCES)}")
    specs = [{**spec, "with_wide": True} for spec in dataset_specs(chosen.root, chosen.frames, chosen.stride)]
    clips = [
        dataset[number] for dataset in (registry.build("datasets", s) for s in specs) for number in range(len(dataset))
    ]
    cells = columns()
    yield f"{len(clips)} clips of {', '.join(chosen.frames)}; dB over copying the last frame"
    yield f"{'disturbance':<32}" + "".join(f"{name:>12}" for name in cells)
    levels = [(name, level) for name in names for level in range(1 if name in ("none", "standing") else NUM_STRENGTHS)]
    for done, (name, level) in enumerate(levels, 1):
        gains = np.array([[gain_db(clip, name, level, *cell) for cell in cells.values()] for clip in clips])
        progress(done, len(levels))
        yield f"{name} {level + 1}".ljust(32) + "".join(map(_text, gains.T))


def gain_db(clip: Clip, name: str, level: Level, source: Any, renderer: Any) -> float:
    """Mean PSNR over SCORED steps, less that of the copied last frame; NaN where nothing could be predicted."""
    metric = registry.build("frame_metrics", "psnr")
    context, target = disturbed(clip, DISTURBANCES[name], level, source.needs | renderer.needs)
    try:
        predicted = predict(context, source, renderer)
    except GeovpError:
        return float("nan")
    actual, copied = target.frames[np.array(SCORED)], np.repeat(context.frames[-1:], len(SCORED), axis=0)
    return float((metric(predicted, actual, None) - metric(copied, actual, None)).mean())


def disturbed(clip: Clip, what: Disturbance, level: Level, needs: Any) -> tuple[Context, Target]:
    """Context and target of the disturbed clip."""
    order = what.order(level)

    def images(frames: ByteArray) -> ByteArray:
        return np.stack([what.image(frames[shown], step, level) for step, shown in enumerate(order)])

    wide = clip.wide and ExtraView(images(clip.wide.frames), clip.wide.intrinsics, clip.wide.view_from_cam)
    changes: dict[str, Any] = {"frames": images(clip.frames), "wide": wide}
    if what.poses_follow and clip.trajectory is not None:
        changes["trajectory"] = replace(clip.trajectory, world_from_cam=clip.trajectory.world_from_cam[order])
    context, target = replace(clip, **changes).split(NUM_PAST, needs)
    return what.context(context, level), target


def _text(gains: FloatArray) -> str:
    known = gains[np.isfinite(gains)]
    if not len(known):
        return f"{'-':>12}"
    return f"{known.mean():>11.1f}" + ("<" if known.mean() < -LIMIT_DB else " ")
