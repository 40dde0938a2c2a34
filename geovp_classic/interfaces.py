"""The verbs of the suite: one-method Protocols that a component, ours or a plug-in's, fulfils without a base class."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Clip,
    Context,
    FloatArray,
    Grant,
    Intrinsics,
    Motion,
    Prediction,
    Trajectory,
    Views,
)


class Component(Protocol):
    """Whatever sees a context: it says which parts of it it must be granted."""

    @property
    def needs(self) -> Grant:
        """What it must be granted."""
        ...


@runtime_checkable
class Odometry(Component, Protocol):
    """Says where the camera was, from what it saw; never raises on hard images but bridges and marks the step."""

    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        """The past trajectory [P] and which steps were really tracked [P]."""
        ...


@runtime_checkable
class ScaleEstimator(Protocol):
    """Estimates from image to image how many metres an odometry's unit of length is."""

    @property
    def unit(self) -> float:
        """Metres per unit of the odometry; 1 while unknown."""
        ...

    @property
    def confidence(self) -> float:
        """How well the unit is known, from 0 (not at all) to 1."""
        ...

    def update(self, before: ByteArray, now: ByteArray, before_from_now: FloatArray, radial: float = 0.0) -> None:
        """Take two grey images [H, W] and the motion between them [4, 4], in units of the odometry.

        `radial` is the distortion that the odometry found: undistorted ray = ray * (1 + radial * |ray|^2).
        """
        ...

    def restart(self) -> None:
        """The odometry has lost its unit of length and continues with another."""
        ...


@runtime_checkable
class Scale(Component, Protocol):
    """Gives an odometry metres, or says that its lengths have no unit."""

    @property
    def is_metric(self) -> bool:
        """Whether lengths become metres."""
        ...

    def estimator(self, intrinsics: Intrinsics, camera_height_m: float | None) -> ScaleEstimator:
        """A fresh estimator for one camera and one drive; Incompatible when what it needs is missing."""
        ...


@runtime_checkable
class Forecaster(Protocol):
    """Says where the camera will be, from where it was; sees poses only."""

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        """Futures [S, F, 4, 4] at the given times [F], in the world frame of the past."""
        ...


@runtime_checkable
class PoseSource(Component, Protocol):
    """Says where the camera was and will be."""

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """The motion: past trajectory and futures [S, F, 4, 4]; Incompatible when the clip lacks what it needs."""
        ...


@runtime_checkable
class PoseRefinement(Component, Protocol):
    """Says better where the camera was and will be, from the images and from what the poses themselves show."""

    def refine(self, context: Context, motion: Motion) -> Motion:
        """The motion, corrected, in the same world frame; unchanged where there is nothing to say.

        Incompatible when the clip or the refinements before it lack what it needs.
        """
        ...


@runtime_checkable
class DepthSource(Component, Protocol):
    """Says how far away the observed pixels are."""

    def inverse_depths(self, context: Context, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        """Inverse z-depth [P, H, W] (1 / the past's unit; 0 = infinitely far) and confidence [P, H, W] in [0, 1]."""
        ...


@runtime_checkable
class Scene(Protocol):
    """What was reconstructed from the past; can be seen from anywhere, at any time, any number of times."""

    def view(self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics) -> Views:
        """The scene from the poses [F, 4, 4] at the times [F], in the world frame and on the clock of its past.

        Row k depends on pose k and time k alone: not on the other rows, their order or their number.
        """
        ...


@runtime_checkable
class Renderer(Component, Protocol):
    """Builds a scene from what was seen and from where."""

    def reconstruct(self, context: Context, past: Trajectory) -> Scene:
        """The scene; Incompatible when the past's unit or the clip does not suit it."""
        ...


@runtime_checkable
class Fill(Protocol):
    """Invents the pixels that a scene does not cover."""

    def fill(self, views: Views, last: ByteArray) -> ByteArray:
        """Frames [F, H, W, 3], unchanged where `views.covered`; each from its own view alone.

        `last` [H, W, 3] is what the views' camera would have seen in the last observed frame's place.
        """
        ...


@runtime_checkable
class FramePredictor(Component, Protocol):
    """Says what the camera will see, by whatever means."""

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        """Predicted frames [S, F, H, W, 3] for the future times of the context."""
        ...


class Metric(Protocol):
    """A measure with one number per step."""

    @property
    def unit(self) -> str:
        """What the numbers are in, "" for none."""
        ...

    @property
    def higher_is_better(self) -> bool:
        """Which way the arrow points."""
        ...


@runtime_checkable
class FrameMetric(Metric, Protocol):
    """Compares predicted with real frames, step by step."""

    def __call__(self, predicted: ByteArray, target: ByteArray, mask: BoolArray | None) -> FloatArray:
        """One number per step [F] from frames [F, H, W, 3]; only pixels of the mask [F, H, W] count; NaN for none."""
        ...


@runtime_checkable
class TrajectoryMetric(Metric, Protocol):
    """Compares predicted with real poses, step by step; both are in the same world frame."""

    def __call__(self, predicted: Trajectory, target: Trajectory) -> FloatArray:
        """One number per step [F]."""
        ...


@runtime_checkable
class Dataset(Protocol):
    """Clips by number."""

    @property
    def name(self) -> str:
        """What the results call it."""
        ...

    def __len__(self) -> int:
        """The number of clips."""
        ...

    def __getitem__(self, index: int) -> Clip:
        """One clip; BadData says which file is wrong."""
        ...
