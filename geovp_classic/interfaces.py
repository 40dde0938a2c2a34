"""Interfaces of the components: Protocols that a plug-in fulfils without a base class."""

from collections.abc import Iterable
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
    """Component that is given a context."""

    @property
    def needs(self) -> PrivilegedInput:
        """Return the privileged inputs that the component uses."""


@runtime_checkable
class Odometry(Component, Protocol):
    """Estimator of the past trajectory from the frames.

    It bridges and marks a step that it cannot track instead of raising an error.
    """

    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        """Return the past trajectory [P] and whether each pose was tracked [P]."""


@runtime_checkable
class SequenceOdometry(Odometry, Protocol):
    """Odometry that can also track a whole sequence, which it reads image by image."""

    def track_sequence(
        self,
        frames: Iterable[ByteArray],
        times_s: FloatArray,
        intrinsics: Intrinsics,
        camera_height_m: float | None,
    ) -> tuple[Trajectory, BoolArray]:
        """Return the trajectory [T] and whether each pose was tracked [T].

        Frames are [H, W, 3] or grey [H, W]. Raises Incompatible if the camera's height is needed
        but unknown.
        """


@runtime_checkable
class ScaleEstimator(Protocol):
    """Recursive estimate of the metres in an odometry's unit of length."""

    @property
    def unit(self) -> float:
        """Return metres per unit of the odometry, on average; 1 while unknown."""

    @property
    def units(self) -> FloatArray:
        """Return metres per unit of the odometry at the last updates [N] that are remembered.

        They are NaN where no update since the last restart was a measurement.
        """

    @property
    def uncertainty(self) -> float:
        """Return the relative standard deviation of the unit; infinite while unknown."""

    def finalize(self, length: float, duration_s: float) -> None:
        """Finish the estimate after the last image.

        `length` is that of the whole path, in units of the odometry. If no measurement was
        possible, the unit may be assumed from the mean speed.
        """

    def update(
        self,
        before: ByteArray,
        now: ByteArray,
        before_from_now: FloatArray,
    ) -> None:
        """Update the estimate with two grey images [H, W] and the motion between them [4, 4].

        The translation is in units of the odometry.
        """

    def restart(self) -> None:
        """Forget the estimate, since the odometry continues with another unit of length."""


@runtime_checkable
class Scale(Component, Protocol):
    """Source of an odometry's metric scale, or of none."""

    @property
    def is_metric(self) -> bool:
        """Return whether lengths become metres."""

    def estimator(
        self,
        intrinsics: Intrinsics,
        camera_height_m: float | None,
        pitch_rad: float = 0.0,
    ) -> ScaleEstimator:
        """Return a new estimator for one camera and clip.

        The camera looks about `pitch_rad` above its direction of travel. Raises Incompatible if
        a required input is missing.
        """


@runtime_checkable
class Forecaster(Protocol):
    """Predictor of future poses from past poses alone."""

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        """Return futures [S, F, 4, 4] at the times [F], in the world frame of the past."""


@runtime_checkable
class PoseSource(Component, Protocol):
    """Source of the camera's past and future motion."""

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """Return the past trajectory and the futures [S, F, 4, 4].

        Raises Incompatible if the context lacks a required input.
        """


@runtime_checkable
class PoseRefinement(Component, Protocol):
    """Correction of the camera's motion, from the images or from the poses themselves."""

    def refine(self, context: Context, motion: Motion) -> Motion:
        """Return the corrected motion in the same world frame, or the same motion.

        Raises Incompatible if the context or the motion lacks a required input.
        """


@runtime_checkable
class DepthSource(Component, Protocol):
    """Estimator of the depth of the observed pixels."""

    def inverse_depths(self, context: Context, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        """Return inverse z-depth [P, H, W] and confidence [P, H, W] in [0, 1].

        The unit is 1 / that of the past trajectory; 0 is infinitely far.
        """


@runtime_checkable
class Scene(Protocol):
    """Reconstruction from the observed frames, which can be viewed from any pose at any time."""

    def view(
        self,
        world_from_cam: FloatArray,
        times_s: FloatArray,
        intrinsics: Intrinsics,
    ) -> Views:
        """Render the scene from the poses [F, 4, 4] at the times [F].

        World frame and clock are those of the past trajectory. View k depends on pose k and
        time k alone.
        """


@runtime_checkable
class Renderer(Component, Protocol):
    """Reconstruction of scenes from observed frames and their poses."""

    def reconstruct(self, context: Context, past: Trajectory) -> Scene:
        """Reconstruct the scene.

        Raises Incompatible if the context or the unit of the past trajectory is unsuitable.
        """


@runtime_checkable
class Inpainter(Protocol):
    """Inpainting of the pixels that a scene does not cover."""

    def inpaint(self, views: Views, last: ByteArray) -> ByteArray:
        """Return frames [F, H, W, 3], unchanged where `views.covered`.

        Frame k depends on view k and on `last` [H, W, 3] alone, the last observed frame, resampled
        to the camera of the views.
        """


@runtime_checkable
class FramePredictor(Component, Protocol):
    """Predictor of future frames, by any method."""

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        """Predict frames [S, F, H, W, 3] for the future times of the context."""


class Metric(Protocol):
    """Measure with one value per step.

    Confidence intervals are clipped to an optional attribute `bounds`, (lowest, highest).
    """

    @property
    def unit(self) -> str:
        """Return the unit of the values, "" for none."""

    @property
    def higher_is_better(self) -> bool:
        """Return whether larger values are better."""


@runtime_checkable
class FrameMetric(Metric, Protocol):
    """Comparison of predicted with real frames, step by step."""

    def __call__(
        self, predicted: ByteArray, target: ByteArray, mask: BoolArray | None
    ) -> FloatArray:
        """Return a value per step [F] from frames [F, H, W, 3], over the mask [F, H, W].

        The value is NaN for a step with an empty mask.
        """


@runtime_checkable
class TrajectoryMetric(Metric, Protocol):
    """Comparison of predicted with real poses in one world frame, step by step."""

    def __call__(self, predicted: Trajectory, target: Trajectory) -> FloatArray:
        """Return a value per step [F]."""


@runtime_checkable
class SetMetric(Metric, Protocol):
    """Comparison of sets of predicted and real clips by the Frechet distance of features."""

    @property
    def max_samples(self) -> int:
        """Return the number of samples of a clip that are compared, each in a set of its own."""

    def features(self, observed: ByteArray, future: ByteArray) -> FloatArray:
        """Return features [D] of a clip with frames [P, H, W, 3] and real or predicted ones [F]."""


@runtime_checkable
class Dataset(Protocol):
    """Sequence of clips."""

    @property
    def name(self) -> str:
        """Return the name under which results are stored."""

    def __len__(self) -> int:
        """Return the number of clips."""

    def __getitem__(self, index: int) -> Clip:
        """Return one clip; raise BadData for a damaged file, IndexError beyond the last clip."""
