"""Prediction of one clip: from a folder of images, a video or a webcam to frames, poses and a
scene.
"""

import numpy as np

from geovp_benchmarks.predict import webcam
from geovp_benchmarks.predict.camera import find_camera
from geovp_benchmarks.predict.predicted import Geometry, Predicted
from geovp_benchmarks.predict.prediction_request import PredictionRequest, check_memory, output_size
from geovp_benchmarks.progress import Progress, announce
from geovp_classic import registry
from geovp_classic.data import windows
from geovp_classic.data.windows import Recording
from geovp_classic.errors import BadData
from geovp_classic.interfaces import FramePredictor
from geovp_classic.predictors.geometric import GeometricPredictor, show
from geovp_classic.types import ByteArray, Clip, Context, Prediction, PrivilegedInput

NUM_STAGES = 5
OFFERED = (
    PrivilegedInput.CAMERA_HEIGHT | PrivilegedInput.FULL_FRAMES
)  # what a video of the user can provide


def predict(request: PredictionRequest, progress: Progress) -> Predicted:
    """Read, track, forecast, reconstruct and render; BadData names the missing input."""
    predictor = request.build()
    if lacking := predictor.needs & ~OFFERED:
        raise BadData(
            f"{registry.name_of(predictor)} needs {lacking.name}, which a video does not have"
        )
    announce("reading frames")
    recording = _recording(request)
    first = _first(request, len(recording.frames))
    size_px = output_size(
        request.size_px, recording.intrinsics.width_px, recording.intrinsics.height_px
    )
    check_memory(size_px, request.num_past, request.num_future * request.num_samples)
    announce("calibrating")
    camera, recording = find_camera(recording, first + request.num_past, request)
    context = _context(
        request, recording, first, size_px, with_full=PrivilegedInput.FULL_FRAMES in predictor.needs
    )
    progress(1, NUM_STAGES)
    prediction, geometry = _run(predictor, context, request.num_samples, progress)
    actual = _actual(request, recording, first, size_px)
    return Predicted(request, predictor, context, prediction, geometry, first, camera, actual)


def _run(
    predictor: FramePredictor, context: Context, num_samples: int, progress: Progress
) -> tuple[Prediction, Geometry | None]:
    """Return the prediction, and the views of its scene if it has one."""
    if not isinstance(predictor, GeometricPredictor):
        announce("predicting")
        prediction = predictor.predict(context.only(predictor.needs), num_samples)
        progress(4, NUM_STAGES)
        return prediction, None
    announce("tracking the camera")
    observed = predictor.observe(context)
    motion = predictor.estimate(observed, num_samples)
    progress(2, NUM_STAGES)
    announce("reconstructing")
    scene = predictor.reconstruct(observed, motion.past)
    progress(3, NUM_STAGES)
    announce("rendering")
    past_s, future_s = np.split(context.times_s, [context.num_past])
    prediction = show(scene, motion, context)
    views = scene.view(motion.futures[0], future_s, context.intrinsics)
    # A cloud shows one instant, so that dynamic objects leave no trails.
    at_once_s = np.full(len(past_s), past_s[-1])
    rerendered = scene.scene.view(motion.past.world_from_cam, at_once_s, context.intrinsics)
    progress(4, NUM_STAGES)
    return prediction, Geometry(views, rerendered, scene)


def _recording(request: PredictionRequest) -> Recording:
    if request.path.name.isdecimal() and not request.path.exists():
        return webcam.record(
            int(request.path.name), max(request.num_past, 45)
        )  # enough to estimate the focal length
    if request.path.is_dir() and request.rate_hz is None:
        raise BadData(
            f"{request.path} is a folder of images, which do not say when they were taken: give "
            "--fps"
        )
    spec = {
        "name": "folder",
        "path": request.path,
        "intrinsics": request.intrinsics
        or (1000.0, 1000.0, 0.0, 0.0),  # found later, from the frames
        "frame_rate_hz": request.rate_hz,
        "camera_height_m": request.camera_height_m,
        "num_frames": 2,
    }
    dataset = registry.build(
        "datasets", {key: value for key, value in spec.items() if value is not None}
    )
    recording: Recording = dataset.recording
    return recording


def _first(request: PredictionRequest, count: int) -> int:
    if request.num_past < 2:
        raise BadData(
            "--past 1 shows no motion: give 2 or more, 10 is what the forecast was made for"
        )
    last_possible = count - request.num_past
    if last_possible < 0:
        raise BadData(
            f"{request.path} has {count} frames, but {request.num_past} must be seen: give "
            "fewer with --past"
        )
    first = last_possible if request.first is None else request.first
    if not 0 <= first <= last_possible:
        raise BadData(
            f"--first {first} and {request.num_past} frames from there: the last possible is "
            f"{last_possible}"
        )
    return first


def _context(
    request: PredictionRequest,
    recording: Recording,
    first: int,
    size_px: tuple[int, int],
    *,
    with_full: bool,
) -> Context:
    """Return the observed frames, with future times at their mean rate."""
    clip: Clip = windows.cut(recording, first, request.num_past, size_px, with_full=with_full)
    step_s = float(np.mean(np.diff(clip.times_s)))
    ahead_s = clip.times_s[-1] + step_s * np.arange(1, request.num_future + 1)
    return Context(
        frames=clip.frames,
        times_s=np.concatenate([clip.times_s, ahead_s]),
        intrinsics=clip.intrinsics,
        camera_height_m=clip.camera_height_m,
        full=clip.full,
        name=clip.name,
    )


def _actual(
    request: PredictionRequest, recording: Recording, first: int, size_px: tuple[int, int]
) -> ByteArray | None:
    begin = first + request.num_past
    count = min(request.num_future, len(recording.frames) - begin)
    return windows.cut(recording, begin, count, size_px).frames if count > 0 else None
