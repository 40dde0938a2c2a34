"""The interfaces of the suite: one-method Protocols that a component or plug-in fulfils without a
base class.
"""

from typing import Protocol, runtime_checkable

from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Clip,
    Context,
    FloatArray,
    Intrinsics,
    Motion,
    Prediction,
    PrivilegedInput,
    Trajectory,
    Views,
)


class Component(Protocol):
    """A component with access to a context."""

    @property
    def needs(self) -> PrivilegedInput:
        """The parts of the context that it must be granted."""


@runtime_checkable
class Odometry(Component, Protocol):
    """Estimates the past trajectory from the frames; never raises on hard images but bridges and
    marks the step.
    """

    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        """The past trajectory [P] and which steps were really tracked [P]."""


@runtime_checkable
class ScaleEstimator(Protocol):
    """Estimates from image to image how many metres an odometry's unit of length is."""

    @property
    def unit(self) -> float:
        """Metres per unit of the odometry; 1 while unknown."""

    @property
    def confidence(self) -> float:
        """How well the unit is known, from 0 (not at all) to 1."""

    @property
    def uncertainty(self) -> float:
        """Relative standard deviation of the unit; infinite while unknown."""

    def settle(self, length: float, duration_s: float) -> None:
        """The clip is over: so long a path, in units of the odometry, took so many seconds.

        Where nothing could be measured the unit may be assumed from that.
        """

    def update(
        self, before: ByteArray, now: ByteArray, before_from_now: FloatArray, radial: float = 0.0
    ) -> None:
        """Take two grey images [H, W] and the motion between them [4, 4], in units of the odometry.

        `radial` is the distortion that the odometry found: undistorted ray = ray * (1 + radial *
        |ray|^2).
        """

    def restart(self) -> None:
        """The odometry has lost its unit of length and continues with another."""


@runtime_checkable
class Scale(Component, Protocol):
    """Gives an odometry metric scale, or leaves its lengths without a unit."""

    @property
    def is_metric(self) -> bool:
        """Whether lengths become metres."""

    def estimator(
        self, intrinsics: Intrinsics, camera_height_m: float | None, pitch_rad: float = 0.0
    ) -> ScaleEstimator:
        """A fresh estimator for one camera and one drive; Incompatible when what it needs is
        missing.

        The camera looks about `pitch_rad` above the direction in which it travels.
        """


@runtime_checkable
class Forecaster(Protocol):
    """Predicts future poses from past ones; sees poses only."""

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        """Futures [S, F, 4, 4] at the given times [F], in the world frame of the past."""


@runtime_checkable
class PoseSource(Component, Protocol):
    """Gives the camera's past and future motion."""

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """The motion: past trajectory and futures [S, F, 4, 4]; Incompatible when the clip lacks
        what it needs.
        """


@runtime_checkable
class PoseRefinement(Component, Protocol):
    """Corrects the camera's motion, from the images and from the poses themselves."""

    def refine(self, context: Context, motion: Motion) -> Motion:
        """The motion, corrected, in the same world frame; unchanged where there is no correction.

        Incompatible when the clip or the refinements before it lack what it needs.
        """


@runtime_checkable
class DepthSource(Component, Protocol):
    """Estimates the depth of the observed pixels."""

    def inverse_depths(self, context: Context, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        """Inverse z-depth [P, H, W] (1 / the past's unit; 0 = infinitely far) and confidence [P, H,
        W] in [0, 1].
        """


@runtime_checkable
class Scene(Protocol):
    """A reconstruction from the past; can be rendered from any pose, at any time, any number of
    times.
    """

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        """The scene from the poses [F, 4, 4] at the times [F], in the world frame and on the clock
        of its past.

        Row k depends on pose k and time k alone: not on the other rows, their order or their
        number.
        """


@runtime_checkable
class Renderer(Component, Protocol):
    """Reconstructs a scene from observed frames and their poses."""

    def reconstruct(self, context: Context, past: Trajectory) -> Scene:
        """The scene; Incompatible when the past's unit or the clip does not suit it."""


@runtime_checkable
class Inpainter(Protocol):
    """Invents the pixels that a scene does not cover."""

    def inpaint(self, views: Views, last: ByteArray) -> ByteArray:
        """Frames [F, H, W, 3], unchanged where `views.covered`; each from its own view alone.

        `last` [H, W, 3] is the last observed frame, resampled to the views' camera.
        """


@runtime_checkable
class FramePredictor(Component, Protocol):
    """Predicts future frames, by whatever means."""

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        """Predicted frames [S, F, H, W, 3] for the future times of the context."""


class Metric(Protocol):
    """A measure with one number per step.

    An optional attribute `bounds`, (lowest, highest), says what values it can have: intervals of
    means are cut there.
    """

    @property
    def unit(self) -> str:
        """What the numbers are in, "" for none."""

    @property
    def higher_is_better(self) -> bool:
        """Whether larger numbers are better."""


@runtime_checkable
class FrameMetric(Metric, Protocol):
    """Compares predicted with real frames, step by step."""

    def __call__(
        self, predicted: ByteArray, target: ByteArray, mask: BoolArray | None
    ) -> FloatArray:
        """One number per step [F] from frames [F, H, W, 3]; only pixels of the mask [F, H, W]
        count; NaN for none.
        """


@runtime_checkable
class TrajectoryMetric(Metric, Protocol):
    """Compares predicted with real poses, step by step; both are in the same world frame."""

    def __call__(self, predicted: Trajectory, target: Trajectory) -> FloatArray:
        """One number per step [F]."""


@runtime_checkable
class Dataset(Protocol):
    """Clips by number."""

    @property
    def name(self) -> str:
        """What the results call it."""

    def __len__(self) -> int:
        """The number of clips."""

    def __getitem__(self, index: int) -> Clip:
        """One clip; BadData says which file is wrong."""
