"""Prediction of one clip from a folder of images, a video or a bag."""

import dataclasses
import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from geovp.prediction.camera import Camera, find_camera
from geovp.prediction.request import PredictionRequest, output_size
from geovp.progress import announce
from geovp.provenance import code_hash, versions
from geovp_classic import registry
from geovp_classic.api import SHOWN_BY, evaluate
from geovp_classic.data.findings import Findings
from geovp_classic.data.formats import bags
from geovp_classic.data.frames.image_names import image_files
from geovp_classic.data.frames.undistortion import DistortedCamera
from geovp_classic.data.frames.video_frames import is_video
from geovp_classic.data.layouts import detection
from geovp_classic.data.layouts.folder import Folder
from geovp_classic.data.layouts.rosbag import RosBag
from geovp_classic.data.recordings import windows
from geovp_classic.data.recordings.windows import Recording
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.interfaces import FramePredictor
from geovp_classic.predictors.geometric import GeometricPredictor, show
from geovp_classic.predictors.hindcast import ShownScene
from geovp_classic.types import (
    ByteArray,
    Context,
    FloatArray,
    IntArray,
    Motion,
    Prediction,
    PrivilegedInput,
    ShownBy,
    Target,
)
from geovp_classic.types.speed_prior import MIN_SPREAD


@dataclass(frozen=True)
class Predicted:
    """A predicted clip with its scores and plausibility."""

    request: PredictionRequest
    predictor: FramePredictor
    camera: Camera
    context: Context
    numbers: IntArray  # [P + F] of the frames in the recording, beyond its end as before it
    prediction: Prediction
    scene: ShownScene | None  # of a geometric predictor
    actual: ByteArray  # [F' <= F, H, W, 3], recorded future frames

    @property
    def shown(self) -> dict[str, ByteArray]:
        """Return the frames [F, H, W, 3] of the first sample, and copies of the last frame."""
        copies = self.context.frames[[-1] * self.context.num_future]
        return {"predicted": self.prediction.frames[0], "copy-last": copies}

    @cached_property
    def scores(self) -> dict[str, dict[str, FloatArray]]:
        """Return each metric [1, F'] of the shown frames; empty without recorded frames."""
        if not len(self.actual):
            return {}
        return {
            name: evaluate(Prediction(frames[None, : len(self.actual)]), Target(self.actual))
            for name, frames in self.shown.items()
        }

    @property
    def shown_by(self) -> ShownBy | None:
        """Return by what the frames are shown: those of a stationary camera, by the last frame."""
        return "last-frame" if self.prediction.is_copy.all() else self.prediction.shown_by

    @property
    def mask_fraction(self) -> float:
        """Return the fraction of the image that does not show the scene."""
        return 0.0 if self.scene is None else float(self.scene.mask.mean())

    def warnings(
        self,
        min_tracked_fraction: float = 0.7,
        max_off_axis_deg: float = 6.0,
        max_mask_fraction: float = 0.1,
        min_turn_deg: float = 0.1,
        max_pause_s: float = 1.0,  # as no clip of a data set has
    ) -> Iterator[str]:
        """Yield a sentence for each sign that the prediction is wrong."""
        # The camera.
        yield from self.camera.warnings()
        steps_s = np.diff(self.context.past_s)
        pause_s = float(steps_s.max(initial=0))
        if pause_s > max(max_pause_s, 2 * float(np.median(steps_s))):
            yield (
                f"the observed frames have a pause of {pause_s:.1f} s: give another --first or a "
                "smaller --past"
            )
        # What is shown.
        if not self.prediction.is_trusted:
            yield (
                "the scene predicts the last observed frames worse than "
                f"{SHOWN_BY[self.prediction.shown_by]}, which replaces it: check the intrinsics "
                "and the times, or give --no-fallback"
            )
        if self.mask_fraction > max_mask_fraction:
            yield (
                f"{self.mask_fraction:.0%} of the image do not show the scene and are repeated "
                "from the last frame, see strip.png: if they do show it, give --no-mask or --mask"
            )
        if len(self.prediction.frames) < self.request.num_samples:
            yield "all samples are equal, so that there is one: this forecaster has a single future"
        # The motion.
        motion = self.prediction.motion
        if motion is None:
            return
        if motion.tracked.mean() < min_tracked_fraction:
            yield "few frames were tracked: give sharper frames or a larger --size"
        angle_deg = off_axis_deg(motion) or 0.0
        if angle_deg > max_off_axis_deg:
            yield (
                f"the camera travels {angle_deg:.0f} degrees off its optical axis: unless it is "
                "mounted like that, the principal point is wrong"
            )
        if (motion.past.scale_uncertainty or 0.0) >= MIN_SPREAD:
            yield "no road was found: the scale is that of typical driving speeds"
        if not se3.step_lengths(motion.past.world_from_cam).any():
            poses = motion.past.world_from_cam
            turn_rad = se3.rotation_angle_rad(se3.inverse(poses[-1]) @ poses).max()
            if turn_rad < np.radians(min_turn_deg):
                yield "the camera is stationary, or most that it sees is too far away to tell"
            else:
                yield (
                    "the camera turns without moving, or most that it sees is too far away to "
                    "tell, so all depths are unknown"
                )

    def about(self) -> dict[str, Any]:
        """Return the contents of predict.json."""
        motion, scene, context = self.prediction.motion, self.scene, self.context
        about = {
            "settings": dataclasses.asdict(self.request),
            "predictor": registry.describe(self.predictor),
            "versions": versions(),
            "code": code_hash([self.predictor]),
            "camera": dataclasses.asdict(self.camera),
            "first": self.numbers[0],
            "observed": context.num_past,
            "predicted": context.num_future,
            "confidence": self.prediction.confidence,
            "warnings": [*self.warnings()],
            "scores": self.scores,
        }
        if motion is not None:
            about |= {
                "tracked_frames": motion.tracked.sum(),
                "is_metric": motion.past.is_metric,
                "scale_uncertainty": motion.past.scale_uncertainty,
                "off_axis_deg": off_axis_deg(motion),
                "forecaster": motion.forecaster and registry.describe(motion.forecaster),
            }
        if scene is not None:
            about["shown_by"] = self.shown_by
            about["hindcast_errors"] = dict(scene.verdict.errors)
            about["scene_mask_fraction"] = self.mask_fraction
        return about

    def summary(self) -> list[str]:
        """Return lines on camera, horizon, forecast and what is shown, metrics and warnings."""
        camera = self.camera
        interval = ""
        if camera.interval_px is not None:
            interval = " (90 %: {:.0f} to {:.0f})".format(*camera.interval_px)
        lines = [
            f"camera ({camera.source}): focal length {camera.intrinsics.fx_px:.1f} px{interval}, "
            f"{camera.fov_deg:.0f} degrees wide"
        ]
        if self.mask_fraction > 0:
            lines.append(f"mask: {self.mask_fraction:.1%} of the image does not show the scene")
        context = self.context
        ahead_s = context.future_s[-1] - context.past_s[-1]
        rate_hz = context.num_future / ahead_s
        lines.append(
            f"{context.num_future} frames, {rate_hz:.3g} per second: {ahead_s:.2f} s ahead"
        )
        motion = self.prediction.motion
        if motion is not None and motion.forecaster is not None:
            lines.append(f"forecast by {registry.name_of(motion.forecaster)}")
        if self.scene is not None:
            shown_by = SHOWN_BY.get(self.shown_by, "geometry")
            covered = self.prediction.covered
            if covered is not None and self.shown_by != "last-frame":
                shown_by += f", {covered.mean():.0%} of the pixels were seen"
            lines.append(f"shown by {shown_by}")
        for metric in self.scores.get("predicted", ()):
            means = (f"{name} {each[metric].mean():.3f}" for name, each in self.scores.items())
            lines.append(f"{metric}: {', '.join(means)}")
        return [*lines, *(f"warning: {message}" for message in self.warnings())]


def predict(request: PredictionRequest) -> Predicted:
    """Read, track, forecast, reconstruct and render; BadData names a missing input."""
    # A video has frames, and at most the height of its camera.
    predictor = request.build()
    missing = predictor.needs & ~(PrivilegedInput.CAMERA_HEIGHT | PrivilegedInput.FULL_FRAMES)
    if missing:
        raise BadData(
            f"{registry.name_of(predictor)} needs {missing.name}, which a video does not have"
        )
    # The frames in use: by default the latest, so that the future is unknown.
    announce("reading frames")
    recording, lens = read_recording(request)
    numbers = request.frame_numbers(recording.times_s)
    num_past, num_frames = request.num_past, len(numbers)
    latest = num_frames - num_past
    first = latest if request.first is None else int(np.searchsorted(numbers, request.first))
    if not 0 <= first <= latest:
        advice = "give a smaller --past"
        usable = dataclasses.replace(request, first=None).frame_numbers(recording.times_s)
        if len(usable) >= num_past:
            advice = f"the last possible --first is {usable[-num_past]}; or {advice}"
        if request.frame_step > 1:
            advice += " or a smaller --every"
        elif num_frames < len(recording.frames):
            advice += " or a larger --rate"
        raise BadData(
            f"{request.path} has {len(recording.frames)} frames, of which {num_frames} are in use "
            f"and {num_past} must be seen: {advice}"
        )
    recording = recording.selected(numbers)
    # The camera, and the clip at the output size. Frames after the past are kept for comparison.
    announce("calibrating", 1)
    camera, recording = find_camera(recording, lens, first + num_past, request)
    size_px = request.size_px or output_size(recording.intrinsics)
    num_recorded = min(num_past + request.num_future, num_frames - first)
    clip = windows.cut(recording, first, num_recorded, size_px, with_full=request.with_full)
    context = Context(
        frames=clip.frames[:num_past],
        times_s=times_of_clip(clip.times_s, num_past, request.num_future),
        intrinsics=clip.intrinsics,
        camera_height_m=clip.camera_height_m,
        full=clip.full and clip.full[:num_past],
        name=clip.name,
    )
    prediction, scene = _run(predictor, context, request.num_samples)
    actual = clip.frames[num_past:]
    beyond = numbers[-1] + np.diff(numbers)[-1] * np.arange(1, request.num_future + 1)
    numbers = np.append(numbers, beyond)[first:][: len(context.times_s)]
    return Predicted(request, predictor, camera, context, numbers, prediction, scene, actual)


def times_of_clip(
    recorded_s: FloatArray,  # [P + F' <= P + F]
    num_past: int,
    num_future: int,
    max_jitter: float = 0.25,  # of a step; also counts up the error of the past rate
) -> FloatArray:
    """Return the times [P + F] of a clip, of which the future has the frame rate of the past.

    It has the recorded times where these are far from that, at a varying rate: predicted and
    recorded frames are compared.
    """
    past_s, actual_s = np.split(recorded_s, [num_past])
    step_s = np.diff(past_s).mean()
    future_s = past_s[-1] + step_s * np.arange(1, num_future + 1)
    if np.abs(actual_s - future_s[: len(actual_s)]).max(initial=0) > max_jitter * step_s:
        future_s += actual_s[-1] - future_s[len(actual_s) - 1]
        future_s[: len(actual_s)] = actual_s
    return np.concatenate([past_s, future_s])


class _AnyLength(Folder):
    """The images of a folder or the frames of a video, of which no clips are cut."""

    def _check_files(self) -> None: ...


def read_recording(request: PredictionRequest) -> tuple[Recording, DistortedCamera | None]:
    """Return the stored frames with a placeholder for the camera, and that of a bag if known."""
    path = request.path
    is_bag = bags.is_bag(path)
    if path.is_dir() and not is_bag:
        request.refuse("a folder of images", "image_topic")
        _check_folder(path, request.frame_rate_hz)
    elif is_bag:
        request.refuse("a bag, which states its times", "frame_rate_hz", "name_pattern")
    elif path.is_file():
        request.refuse("a video", "image_topic")
    settings: dict[str, Any] = {
        "num_frames": 2,
        "image_bits": request.image_bits,
        "rate_hz": "native",
        "intrinsics": (1000.0, 1000.0, 0.0, 0.0),
        "camera_height_m": request.camera_height_m,
    }
    if not is_bag:
        settings["name_pattern"] = request.name_pattern
        folder = _AnyLength(path=path, frame_rate_hz=request.frame_rate_hz, **settings)
        return next(iter(folder.recordings.values())), None
    dataset = RosBag(path, image_topic=request.image_topic, pose_topic="", **settings)
    (recording,) = dataset.recordings.values()
    bag = bags.Bag(path)
    return recording, bag.camera(
        bag.choose("image", request.image_topic), recording.intrinsics.size_px
    )


def _check_folder(path: Path, rate_hz: float | None) -> None:
    """Raise BadData unless a folder has images of one recording, and their rate is given.

    The message names what to give in place of a data set or of a folder of several recordings.
    """
    inside = [folder for folder in sorted(path.glob("*/")) if os.access(folder, os.R_OK)]
    folders = [folder for folder in (path, *inside) if image_files(folder)]
    if path in folders or len(folders) == 1:
        if rate_hz is None:
            raise BadData(f"{path} is a folder of images, which have no times: give --fps")
        return
    content = "videos or bags"
    inputs = [each for each in sorted(path.iterdir()) if is_video(each) or bags.is_bag(each)]
    if not inputs:
        layout, dataset = detection.detect(path)
        content, inputs = "several folders of images", [*dataset.folders().values()]
        if layout != "folder":
            images = dataset.scan(inputs[0], Findings()).images
            content = f"a data set ({layout})"
            inputs = [image.parent for image in images[:1]] or inputs
    raise BadData(
        f"{path} holds {content}: give one recording, such as {', '.join(map(str, inputs)):.300}"
    )


def off_axis_deg(motion: Motion, max_turn_deg_s: float = 2.0) -> float | None:
    """Return the angle between the optical axis and the direction of travel where it is straight.

    A wrong principal point turns the path by the angle of its offset. In turns, a camera in front
    of the rear axle also moves sideways. None if the camera never moved straight.
    """
    steps = se3.steps(motion.past.world_from_cam)
    turn_rates = se3.rotation_angle_rad(steps) / np.diff(motion.past.times_s)
    is_straight = motion.tracked[1:] & (turn_rates < np.radians(max_turn_deg_s))
    right, down, ahead = steps[is_straight, :3, 3].sum(axis=0)
    if not (right or down or ahead):
        return None
    return float(np.degrees(np.arctan2(np.hypot(right, down), abs(ahead))))


def _run(
    predictor: FramePredictor, context: Context, num_samples: int
) -> tuple[Prediction, ShownScene | None]:
    """Return the prediction, and the scene of a geometric predictor."""
    if not isinstance(predictor, GeometricPredictor):
        announce("predicting", 1)
        return predictor.predict(context.only(predictor.needs), num_samples), None
    announce("tracking the camera", 1)
    observed = predictor.observe(context)
    motion = predictor.estimate(observed, num_samples)
    announce("reconstructing", 1)
    scene = predictor.judge(predictor.reconstruct(observed, motion.past), motion)
    announce("rendering", 1)
    return show(scene, motion, context), scene
