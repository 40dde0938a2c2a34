"""What is asked of `geovp predict`, and whether it can be done: components, size, memory."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from geovp_benchmarks.matrix import schema
from geovp_benchmarks.matrix.components import on_device
from geovp_benchmarks.predict import plausibility
from geovp_classic import registry
from geovp_classic.errors import BadData, UnknownComponent
from geovp_classic.interfaces import FramePredictor
from geovp_classic.predictors.geometric import GeometricPredictor

Spec = dict[str, Any] | str


@dataclass(frozen=True)
class PredictionRequest:
    """The input of `predict`."""

    path: Path  # a folder of images, a video, or the number of a webcam
    intrinsics: tuple[float, float, float, float] | None = (
        None  # fx, fy, cx, cy of the images as they are stored
    )
    fov_deg: float | None = None  # horizontal, in place of intrinsics
    calibration: Path | None = (
        None  # a file with the intrinsics, and the distortion if there is any
    )
    distortion: tuple[float, ...] | None = (
        None  # k1, k2, p1, p2, k3, ... as OpenCV's, beside intrinsics or fov_deg
    )
    rate_hz: float | None = None
    camera_height_m: float | None = None
    first: int | None = None  # the first observed frame; None: as late as possible
    num_past: int = 10
    num_future: int = 20
    size_px: tuple[int, int] | int | None = (
        None  # width and height, or a square's side; None: the video's aspect
    )
    with_full: bool = False  # use the whole images, not their middle only
    pose_source: Spec | None = None  # in place of the best we have, as in a matrix
    renderer: Spec | None = None
    predictor: Spec | None = None  # in place of both
    method: tuple[str, str] | None = (
        None  # a matrix file or a built-in one's name, and a method of it, in place of all three
    )
    num_samples: int = 1
    mask: Path | None = None  # of `Observer`
    device: str | None = None  # of networks that do not name one

    def __post_init__(self) -> None:
        cameras = {
            "--intrinsics": self.intrinsics,
            "--fov": self.fov_deg,
            "--calibration": self.calibration,
        }
        given = [option for option, value in cameras.items() if value is not None]
        if len(given) > 1:
            raise BadData(
                f"{' and '.join(given)} are given, expected at most one: keep one of them"
            )
        if self.distortion is not None and given not in (["--intrinsics"], ["--fov"]):
            raise BadData(
                "--distortion belongs to --intrinsics or --fov: give one of them, or --calibration "
                "alone"
            )

    def build(self) -> FramePredictor:
        """Build the predictor; by default refined odometry and forecast, and depth fusion."""
        with on_device(self.device):
            predictor = self._build()
        if self.mask is None:
            return predictor
        if not isinstance(predictor, GeometricPredictor):
            raise BadData(
                f"--mask {self.mask} is given, but {registry.name_of(predictor)} has no scene: "
                "give it with a pose source and a renderer"
            )
        return replace(predictor, observer=replace(predictor.observer, mask=self.mask))

    def _build(self) -> FramePredictor:
        if self.method is not None:
            if (self.predictor, self.pose_source, self.renderer) != (None, None, None):
                raise BadData(
                    "--method takes the place of --predictor, --pose-source and --renderer: give "
                    "it alone"
                )
            return _of_method(*self.method)
        if self.predictor is not None:
            if self.pose_source is not None or self.renderer is not None:
                raise BadData(
                    "--predictor takes the place of --pose-source and --renderer: give it alone"
                )
            built: FramePredictor = registry.build("predictors", self.predictor, "--predictor")
            return built
        frames = "full" if self.with_full else "crop"
        renderer = self.renderer or {"name": "depth-fusion", "frames": frames}
        pose_source = registry.build(
            "pose_sources", self.pose_source or self._best(frames), "--pose-source"
        )
        return GeometricPredictor(pose_source, registry.build("renderers", renderer, "--renderer"))

    def _best(self, frames: str) -> Spec:
        """Return the default pose source, in metres if the camera height is given."""
        scale = "unit-speed" if self.camera_height_m is None else "ground-plane"
        odometry = {"name": "monocular", "frames": frames, "scale": {"name": scale}}
        return {
            "name": "refined",
            "source": {"name": "chained", "odometry": odometry},
            "refinements": [{"name": "registration", "frames": frames}],
        }


def _of_method(file: str, label: str) -> FramePredictor:
    """Return the predictor of a method of a matrix; UnknownComponent names the nearest method."""
    read = schema.read(Path(file))
    plans = {plan.label: plan for plan in read.methods}
    if label not in plans:
        raise UnknownComponent(f"{file} has no method {label!r}{registry.nearest(label, plans)}")
    chosen = plans[label].components.values()
    parts = [
        registry.build(role, read.specs[role, name], f"{file}: {name}") for role, name in chosen
    ]
    return GeometricPredictor(*parts) if len(parts) > 1 else parts[0]


def output_size(
    asked: tuple[int, int] | int | None, width_px: int, height_px: int, max_side_px: int = 640
) -> tuple[int, int]:
    """Return width and height of predicted frames; by default even, in the video's aspect."""
    if isinstance(asked, int):
        return asked, asked
    if asked is not None:
        return asked
    scale = min(1.0, max_side_px / max(width_px, height_px))
    return max(2, 2 * round(width_px * scale / 2)), max(2, 2 * round(height_px * scale / 2))


def check_memory(size_px: tuple[int, int], num_past: int, num_future: int) -> None:
    """Raise BadData if frames of that size and number do not fit into the free memory."""
    # Measured with 10 + 20 frames: 1.1 GiB at 640x640, 2.3 GiB at 1280x720.
    width_px, height_px = size_px
    sweep_bytes = 6 * 96 * max(1, height_px / 320)  # a pixel; taller images have more planes
    needed = 4e8 + width_px * height_px * (sweep_bytes + 40 * (num_past + num_future))
    free = plausibility.free_memory_bytes()
    if needed > free:
        raise BadData(
            f"{num_past + num_future} frames of {width_px}x{height_px} take about "
            f"{needed / 2**30:.1f} GiB of memory, "
            f"{free / 2**30:.1f} GiB are free: give a smaller --size or fewer frames"
        )
