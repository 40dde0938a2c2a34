"""The synthetic data set: clips of drives through synthetic streets."""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from geovp_classic.data.frames.image_frames import Array
from geovp_classic.data.synthetic.rendering import Optics, render_drive
from geovp_classic.data.synthetic.roads import Journey, world_from_vehicle
from geovp_classic.data.synthetic.street import MANOEUVRES, build_street
from geovp_classic.errors import BadData
from geovp_classic.geometry import planar, se3
from geovp_classic.types import (
    ByteArray,
    Clip,
    ExtraView,
    FloatArray,
    Intrinsics,
    Trajectory,
)


@dataclass(frozen=True)
class Synthetic(Optics):
    """Clips of a synthetic street at 10 Hz with exact poses, depths and masks of moving objects.

    Clips cycle through `MANOEUVRES`, each on its own street. The next round shows windows of the
    same drives, `stride` frames later. When the drives of 60 frames are used up, new
    streets follow. Streets are furnished for 230 m: clips of more than about 150 frames leave the
    town. The same settings give the same clips.

    The camera is that of a square crop of KITTI's images. With `noise`, `exposure_drift`,
    `haze_per_m` and `gloss` at 0, surfaces look the same from everywhere. More `blur_px` and
    `finest_detail_m` make images that survive resampling.
    """

    name = "synthetic"  # in results

    seed: int = 0
    num_clips: int = 8  # one for each manoeuvre
    num_frames: int = 30  # 10 observed and 20 predicted, as in the thesis
    stride: int = 10  # frames, as many as are observed
    size_px: tuple[int, int] = (256, 256)  # as in the thesis
    with_full: bool = False  # also the uncropped frames
    with_right: bool = False  # also the frames of the right camera
    has_plain_road: bool = False  # asphalt without lines, cracks, stains and grain
    pitch_deg: float = 0.0  # of the mounted camera, up
    roll_deg: float = 0.0  # of the mounted camera, clockwise
    bounce: float = 1.0  # scale of the motion of the car's body
    # standard deviation in grey levels: a round value, above the 0.3 of rounding to 8 bits
    noise: float = 1.5
    exposure_drift: float = 0.02  # standard deviation, a fraction: a round value
    camera_height_m = 1.65  # KITTI's

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
        index = range(self.num_clips)[index]
        seed, manoeuvre, first = self.window(index)
        street = build_street(seed, manoeuvre, self.has_plain_road)
        times_s = (first + np.arange(self.num_frames)) / 10.0
        world_from_cam = self._world_from_cam(street.ego, times_s, seed)
        square, uncropped = self._cameras()
        camera = uncropped if self.with_full else square
        light, depths, moving = render_drive(street, world_from_cam, camera, times_s, self)
        frames = self._expose(light, index, 0)
        right = None
        if self.with_right:
            right_from_left = np.eye(4)
            right_from_left[0, 3] = -0.54  # KITTI's baseline
            poses = world_from_cam @ se3.inverse(right_from_left)
            light, _, _ = render_drive(street, poses, uncropped, times_s, self)
            images = self._expose(light, index, 1)
            right = ExtraView(images, uncropped, right_from_left)
        return Clip(
            name=self.clip_names[index],
            frames=_middle(frames, square.width_px),
            times_s=times_s,
            intrinsics=square,
            trajectory=Trajectory(world_from_cam, times_s, is_metric=True),
            depths=_middle(depths, square.width_px),
            moving=_middle(moving, square.width_px),
            full=ExtraView(frames, uncropped, np.eye(4)) if self.with_full else None,
            right=right,
            camera_height_m=self.camera_height_m,
        )

    def window(self, index: int) -> tuple[int, str, int]:
        """Return the seed of a clip's street, the manoeuvre, and the first frame of the drive."""
        num_windows = max(1, 1 + (60 - self.num_frames) // self.stride)
        lap, number = divmod(index, len(MANOEUVRES))
        seed = self.seed + 1000 * (lap // num_windows)
        return seed, list(MANOEUVRES)[number], (lap % num_windows) * self.stride

    @property
    def clip_names(self) -> tuple[str, ...]:
        """Return the drive (a sequence) and first frame of each clip: "seed0-left-turn/000"."""
        name = "seed{}-{}/{:03d}".format
        return tuple(name(*self.window(index)) for index in range(len(self)))

    def _cameras(self) -> tuple[Intrinsics, Intrinsics]:
        """Return the square camera and the uncropped one, whose middle the square camera sees."""
        width_px, height_px = self.size_px
        kitti = Intrinsics(489.0, 489.0, 127.5, 127.5, 256, 256)
        square = kitti.resized(width_px, height_px)
        extra_px = round(width_px * (1242 / 375 - 1) / 2)  # KITTI's aspect
        full_px = width_px + 2 * extra_px
        return square, square.cropped(-extra_px, 0, full_px, height_px)

    def _world_from_cam(self, ego: Journey, times_s: FloatArray, seed: int) -> FloatArray:
        """Return world_from_cam [T, 4, 4] of a car that shakes at 0.8 to 2.2 Hz while it moves."""
        delays_s = np.array([-0.2, -0.1, 0.0, 0.1, 0.2])[:, None]
        travelled_m = ego.travelled_m(times_s + delays_s)  # [5, T]
        speed_m_s = (travelled_m[3] - travelled_m[1]) / 0.2
        acceleration_m_s2 = np.diff(travelled_m[::2], n=2, axis=0)[0] / 0.04
        amplitude = self.bounce * np.clip(speed_m_s / 8.0, 0.0, 1.2)
        rng = np.random.default_rng([seed, 7])
        waves = [_waves(rng, times_s, 0.8, 2.2) for _ in range(3)]
        pitch, roll, heave = amplitude * waves
        braking = self.bounce * 0.004 * acceleration_m_s2
        body_from_rest = np.zeros((len(times_s), 6))
        body_from_rest[:, 1] = 0.008 * heave - self.camera_height_m
        body_from_rest[:, 3] = 0.0022 * pitch + braking
        body_from_rest[:, 5] = 0.0016 * roll
        mount_rad = np.deg2rad([self.pitch_deg, self.roll_deg])
        mount = planar.level_vehicle_from_cam(*mount_rad)
        world_from_rest = world_from_vehicle(*ego.place_at(times_s))
        return world_from_rest @ se3.exp(body_from_rest) @ mount

    def _expose(self, light: FloatArray, *clip_and_eye: int) -> ByteArray:
        """Return images [T, H, W, 3] of linear light with noise and drifting exposure.

        A crop has the noise of the uncropped image.
        """
        rng = np.random.default_rng([self.seed, *clip_and_eye, 99])
        num_frames, height_px, width_px, _ = light.shape
        times_s = np.arange(num_frames) * 0.1
        drift = self.exposure_drift * _waves(rng, times_s, 0.1, 0.5)
        gain = np.exp(drift)[:, None, None, None]
        full_px = self._cameras()[1].width_px
        shape = (num_frames, height_px, full_px, 3)
        grain = _middle(rng.standard_normal(shape, np.float32), width_px)
        image = 255 * np.sqrt(np.clip(light * gain, 0.0, 1.0))
        image = image + self.noise * grain + 0.5
        return np.clip(image, 0, 255).astype(np.uint8)


def _middle(images: Array, width_px: int) -> Array:
    """Return the middle columns of images [T, H, W, ...]."""
    left_px = (images.shape[2] - width_px) // 2
    return images[:, :, left_px : left_px + width_px]


def _waves(rng: Generator, times_s: FloatArray, min_hz: float, max_hz: float) -> FloatArray:
    """Return a wandering signal [T] of about unit variance: four waves."""
    frequencies_hz = rng.uniform(min_hz, max_hz, 4)
    phases_rad = rng.uniform(0, 2 * np.pi, 4)
    waves = np.sin(2 * np.pi * np.outer(times_s, frequencies_hz) + phases_rad)
    return waves.sum(axis=-1) * np.sqrt(2 / 4)
