"""Request for the prediction of one clip."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from geovp_benchmarks.matrix import schema
from geovp_benchmarks.matrix.components import on_device
from geovp_classic import registry
from geovp_classic.errors import BadData, UnknownComponent
from geovp_classic.interfaces import FramePredictor
from geovp_classic.predictors.geometric import GeometricPredictor

Spec = dict[str, Any] | str


@dataclass(frozen=True)
class PredictionRequest:
    """Input of `predict`; BadData for options that exclude each other."""

    path: Path  # a folder of images, a video, or the number of a webcam
    intrinsics: tuple[float, float, float, float] | None = None  # fx, fy, cx, cy of stored images
    fov_deg: float | None = None  # horizontal
    calibration: Path | None = None
    distortion: tuple[float, ...] | None = None  # OpenCV's k1, k2, p1, p2, k3, ...
    rate_hz: float | None = None
    camera_height_m: float | None = None
    first: int | None = None  # first observed frame; None: as late as possible
    num_past: int = 10
    num_future: int = 20
    size_px: tuple[int, int] | int | None = None  # one number: the side of a square
    with_full: bool = False  # use the whole images, not only their middle
    pose_source: Spec | None = None
    renderer: Spec | None = None
    predictor: Spec | None = None
    method: tuple[str, str] | None = None  # a matrix and the label of one of its methods
    num_samples: int = 1
    mask: Path | None = None
    device: str | None = None

    def __post_init__(self) -> None:
        cameras = {
            "--intrinsics": self.intrinsics,
            "--fov": self.fov_deg,
            "--calibration": self.calibration,
        }
        _check_alternatives(cameras)
        components = self.pose_source or self.renderer
        predictors = {
            "--method": self.method,
            "--predictor": self.predictor,
            "--pose-source or --renderer": components,
        }
        _check_alternatives(predictors)
        if self.distortion is not None and self.intrinsics is None and self.fov_deg is None:
            raise BadData("--distortion belongs to --intrinsics or --fov: give one of them")
        if self.fov_deg is not None and not 0 < self.fov_deg < 170:
            raise BadData(f"--fov is {self.fov_deg:g}: give degrees between 0 and 170")
        if self.num_past < 2:
            raise BadData("--past 1 shows no motion: give 2 or more frames")

    def build(self) -> FramePredictor:
        """Build the predictor; by default refined odometry with a forecast, and depth fusion."""
        with on_device(self.device):
            predictor = self._build()
        if self.mask is None:
            return predictor
        if not isinstance(predictor, GeometricPredictor):
            name = registry.name_of(predictor)
            raise BadData(f"--mask needs a pose source and a renderer, {name} has none")
        return replace(predictor, observer=replace(predictor.observer, mask=self.mask))

    def _build(self) -> FramePredictor:
        if self.method is not None:
            return _of_method(*self.method)
        if self.predictor is not None:
            built: FramePredictor = registry.build("predictors", self.predictor, "--predictor")
            return built
        frames = "full" if self.with_full else "crop"
        scale = "unit-speed" if self.camera_height_m is None else "ground-plane"
        odometry = {"name": "monocular", "frames": frames, "scale": scale}
        refined = {
            "name": "refined",
            "source": {"name": "chained", "odometry": odometry},
            "refinements": [{"name": "registration", "frames": frames}],
        }
        fusion = {"name": "depth-fusion", "frames": frames}
        return GeometricPredictor(
            registry.build("pose_sources", self.pose_source or refined, "--pose-source"),
            registry.build("renderers", self.renderer or fusion, "--renderer"),
        )


def output_size(
    size_px: tuple[int, int] | int | None, width_px: int, height_px: int, max_side_px: int = 640
) -> tuple[int, int]:
    """Return width and height of predicted frames; by default even, in the video's aspect."""
    if isinstance(size_px, int):
        return size_px, size_px
    if size_px is not None:
        return size_px
    scale = min(1.0, max_side_px / max(width_px, height_px))
    return max(2, 2 * round(width_px * scale / 2)), max(2, 2 * round(height_px * scale / 2))


def _check_alternatives(options: Mapping[str, object]) -> None:
    """Raise BadData unless at most one of the options is given."""
    given = [option for option, value in options.items() if value is not None]
    if len(given) > 1:
        raise BadData(f"{' and '.join(given)} are given, expected at most one: keep one of them")


def _of_method(file: str, label: str) -> FramePredictor:
    """Build a method of a matrix; UnknownComponent names the nearest one."""
    matrix = schema.read(Path(file))
    plans = {plan.label: plan for plan in matrix.methods}
    if label not in plans:
        raise UnknownComponent(f"{file} has no method {label!r}{registry.nearest(label, plans)}")
    components = [
        registry.build(role, matrix.specs[role, name], f"{file}: {name}")
        for role, name in plans[label].components.values()
    ]
    return GeometricPredictor(*components) if len(components) > 1 else components[0]
