"""The synthetic data set: clips of drives through synthetic streets."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from geovp_classic.data.synthetic import camera
from geovp_classic.data.synthetic.manoeuvres import Manoeuvre
from geovp_classic.data.synthetic.rendering import render_drive
from geovp_classic.data.synthetic.shading import Optics
from geovp_classic.data.synthetic.street import build_street
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Clip,
    ExtraView,
    FloatArray,
    Intrinsics,
    Trajectory,
)


@dataclass(frozen=True)
class Synthetic:
    """Clips of a synthetic street at 10 Hz with exact poses, depths and masks of moving objects.

    Clips cycle through the manoeuvres of `Manoeuvre`, each on its own street. The next round shows
    windows of the same drives, `stride` frames later. When the drives of 60 frames are used up, new
    streets follow. Streets are furnished for 230 m: clips of more than about 150 frames leave the
    town. The same settings give the same clips.

    With `noise`, `exposure_drift`, `haze_per_m` and `gloss` at 0, surfaces look the same from
    everywhere. More `blur_px` and `finest_detail_m` make images that survive resampling.
    """

    name: ClassVar[str] = "synthetic"  # in results

    seed: int = 0
    num_clips: int = 8
    num_frames: int = 30
    stride: int = 10  # frames
    size_px: tuple[int, int] = (256, 256)
    with_full: bool = False  # also the uncropped frames
    with_right: bool = False  # also the frames of the right camera
    pitch_deg: float = 0.0  # of the mounted camera, up
    roll_deg: float = 0.0  # of the mounted camera, clockwise
    bounce: float = 1.0  # scale of the motion of the car's body
    noise: float = 1.5  # standard deviation, grey levels
    exposure_drift: float = 0.02  # standard deviation, fraction
    haze_per_m: float = 0.0012  # extinction
    gloss: float = 1.0  # scale of the reflections of glass and paint
    blur_px: float = 0.45  # standard deviation of the lens
    finest_detail_m: float = 0.0  # textures are smoothed to this size

    def __post_init__(self) -> None:
        counts = (self.num_clips, self.num_frames, self.stride, *self.size_px)
        if min(counts) < 1 or self.seed < 0:
            raise BadData(
                f"synthetic: seed is {self.seed}, expected 0 or more; num_clips, num_frames, "
                f"stride and size_px are {counts}, expected 1 or more"
            )

    def __len__(self) -> int:
        return self.num_clips

    def __getitem__(self, index: int) -> Clip:
        """Render a clip."""
        if not -self.num_clips <= index < self.num_clips:
            raise IndexError(f"synthetic clip {index} of {self.num_clips}")
        index %= self.num_clips
        seed, manoeuvre, first = self.window(index)
        street = build_street(seed, manoeuvre)
        times_s = (first + np.arange(self.num_frames)) / 10.0
        world_from_cam = camera.world_from_camera(
            street.ego,
            times_s,
            seed,
            self.pitch_deg,
            self.roll_deg,
            self.bounce,
        )
        square = camera.square_camera(self.size_px)
        full = camera.full_camera(self.size_px)
        optics = Optics(
            self.haze_per_m, self.gloss, self.blur_px, self.finest_detail_m
        )

        def render(
            poses: FloatArray, intrinsics: Intrinsics, view: int
        ) -> tuple[ByteArray, FloatArray, BoolArray]:
            light, depths, moving = render_drive(
                street, poses, intrinsics, times_s, optics
            )
            rng = np.random.default_rng([self.seed, index, view, 99])
            frames = camera.expose(
                light, full.width_px, rng, self.noise, self.exposure_drift
            )
            return frames, depths, moving

        images = render(world_from_cam, full if self.with_full else square, 0)
        left_px = (images[0].shape[2] - square.width_px) // 2
        crop = np.s_[:, :, left_px : left_px + square.width_px]
        views = {}
        if self.with_full:
            views["full"] = ExtraView(images[0], full, np.eye(4))
        if self.with_right:
            right_from_left = camera.right_from_left()
            poses = world_from_cam @ se3.inverse(right_from_left)
            right, _, _ = render(poses, full, 1)
            views["right"] = ExtraView(right, full, right_from_left)
        return Clip(
            name=self.clip_name(index),
            frames=images[0][crop],
            times_s=times_s,
            intrinsics=square,
            trajectory=Trajectory(world_from_cam, times_s, is_metric=True),
            depths=images[1][crop],
            moving=images[2][crop],
            camera_height_m=camera.CAMERA_HEIGHT_M,
            **views,
        )

    def window(self, index: int) -> tuple[int, Manoeuvre, int]:
        """Return the seed of a clip's street, the manoeuvre, and the first frame of the drive."""
        num_windows = max(1, 1 + (60 - self.num_frames) // self.stride)
        lap, number = divmod(index, len(Manoeuvre))
        seed = self.seed + 1000 * (lap // num_windows)
        return seed, list(Manoeuvre)[number], (lap % num_windows) * self.stride

    @property
    def clip_names(self) -> tuple[str, ...]:
        """Return the names of all clips without rendering them."""
        return tuple(self.clip_name(index) for index in range(self.num_clips))

    def clip_name(self, index: int) -> str:
        """Return the drive (a sequence) and its first frame, as "seed0-left-turn/000"."""
        seed, manoeuvre, first = self.window(index)
        return f"seed{seed}-{manoeuvre.value}/{first:03d}"
