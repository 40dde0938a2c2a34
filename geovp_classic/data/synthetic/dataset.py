"""The synthetic data set: clips of a car driving through synthetic streets, rendered on first use
and kept on disk.
"""

import dataclasses
import functools
import hashlib
import json
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from geovp_classic import files
from geovp_classic.data.synthetic import drive
from geovp_classic.data.synthetic.drive import Manoeuvre
from geovp_classic.data.synthetic.render import render_drive
from geovp_classic.data.synthetic.shading import Optics
from geovp_classic.data.synthetic.street import build_street
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import Clip, ExtraView, FloatArray, Intrinsics, Trajectory

Arrays = dict[str, npt.NDArray[Any]]
RATE_HZ = 10.0
DRIVE_FRAMES = 60  # as long as the traffic is interesting
RIGHT_FROM_CAM = se3.compose(np.eye(3), np.array([-drive.BASELINE_M, 0.0, 0.0]))


@dataclass(frozen=True)
class Synthetic:
    """A synthetic street with exact poses, depths and moving masks.

    The clips go round the manoeuvres of `drive.Manoeuvre`, each on a street of its own. After one
    round come later windows of the same drives, `stride` frames on, and when the drives
    (DRIVE_FRAMES long) are used up, new streets. Streets are furnished for 230 m, so that clips of
    more than about 150 frames drive out of town. The same settings give the same bytes. Clips are
    kept under `cache` (default: GEOVP_CACHE, else the user's cache folder). `noise` (in bytes),
    `exposure_drift`, `haze_per_m` and `gloss` set to 0 make a world whose surfaces look the same
    from everywhere. More `blur_px`, the spread of the lens, and `finest_detail_m`, the size to
    which textures are smoothed, make images that survive resampling. `pitch_deg` (up) and
    `roll_deg` (clockwise) say how the camera is mounted, `bounce` scales how the car shakes it.
    """

    name: ClassVar[str] = "synthetic"  # in results

    seed: int = 0
    num_clips: int = 8
    num_frames: int = 30
    stride: int = 10
    size_px: tuple[int, int] = (256, 256)
    with_full: bool = False
    with_right: bool = False
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    bounce: float = 1.0
    noise: float = 1.5
    exposure_drift: float = 0.02
    haze_per_m: float = 0.0012
    gloss: float = 1.0
    blur_px: float = 0.45
    finest_detail_m: float = 0.0
    cache: Path | None = None

    def __post_init__(self) -> None:
        if min(self.num_clips, self.num_frames, self.stride, *self.size_px) < 1:
            raise BadData(
                f"synthetic: num_clips {self.num_clips}, num_frames {self.num_frames}, stride "
                f"{self.stride} and "
                f"size_px {tuple(self.size_px)} must all be at least 1"
            )
        if self.seed < 0:
            raise BadData(f"synthetic: seed is {self.seed}, expected 0 or more")

    def __len__(self) -> int:
        return self.num_clips

    def __getitem__(self, index: int) -> Clip:
        """One clip, from the cache or rendered now."""
        if not -self.num_clips <= index < self.num_clips:
            raise IndexError(f"synthetic clip {index} of {self.num_clips}")
        index %= self.num_clips
        file = self._folder() / f"{index:04d}.npz"
        try:
            arrays = files.read_npz(file)
        except BadData:  # missing or damaged
            arrays = self._render(index)
            _write(file, arrays)
        wide = drive.wide_camera(self.size_px)
        return Clip(
            name=self.clip_name(index),
            frames=arrays["frames"],
            times_s=arrays["times_s"],
            intrinsics=drive.square_camera(self.size_px),
            trajectory=Trajectory(arrays["world_from_cam"], arrays["times_s"], is_metric=True),
            depths=arrays["depths"],
            moving=arrays["moving"],
            full=ExtraView(arrays["full"], wide, np.eye(4)) if self.with_full else None,
            right=ExtraView(arrays["right"], wide, RIGHT_FROM_CAM) if self.with_right else None,
            camera_height_m=drive.CAMERA_HEIGHT_M,
        )

    def window(self, index: int) -> tuple[int, Manoeuvre, int]:
        """The seed of clip `index`'s street, what is driven there, and the first frame of the clip
        on that drive.
        """
        windows = max(1, 1 + (DRIVE_FRAMES - self.num_frames) // self.stride)
        lap, kind = divmod(index, len(Manoeuvre))
        return (
            self.seed + 1000 * (lap // windows),
            list(Manoeuvre)[kind],
            (lap % windows) * self.stride,
        )

    @property
    def clip_names(self) -> tuple[str, ...]:
        """The names in order; nothing is rendered for them."""
        return tuple(self.clip_name(index) for index in range(self.num_clips))

    def clip_name(self, index: int) -> str:
        """As "seed0-left-turn/000": the drive, which is a sequence, and the first frame."""
        seed, manoeuvre, first = self.window(index)
        return f"seed{seed}-{manoeuvre.value}/{first:03d}"

    def _render(self, index: int) -> Arrays:
        seed, manoeuvre, first = self.window(index)
        times_s = (first + np.arange(self.num_frames)) / RATE_HZ
        street = _street(seed, manoeuvre)
        square, wide = drive.square_camera(self.size_px), drive.wide_camera(self.size_px)
        optics = Optics(self.haze_per_m, self.gloss, self.blur_px, self.finest_detail_m)

        def images(world_from_cam: FloatArray, camera: Intrinsics, eye: int) -> Arrays:
            rendering = render_drive(street, world_from_cam, camera, times_s, optics)
            rng = np.random.default_rng([self.seed, index, eye, 99])
            frames = drive.expose(
                rendering.light, wide.width_px, rng, self.noise, self.exposure_drift
            )
            return {"frames": frames, "depths": rendering.depths, "moving": rendering.moving}

        world_from_cam = drive.world_from_camera(
            street.ego, street.terrain, times_s, seed, self.pitch_deg, self.roll_deg, self.bounce
        )
        whole = images(world_from_cam, wide if self.with_full else square, eye=0)
        left = (whole["frames"].shape[2] - square.width_px) // 2
        arrays = {key: value[:, :, left : left + square.width_px] for key, value in whole.items()}
        arrays |= {"world_from_cam": world_from_cam, "times_s": times_s}
        if self.with_full:
            arrays["full"] = whole["frames"]
        if self.with_right:
            arrays["right"] = images(world_from_cam @ se3.inverse(RIGHT_FROM_CAM), wide, eye=1)[
                "frames"
            ]
        return arrays

    def _folder(self) -> Path:
        """Where clips of these settings, made by this code, are kept."""
        settings = {
            key: value
            for key, value in dataclasses.asdict(self).items()
            if key not in ("cache", "num_clips")
        }
        code = b"".join(
            source.read_bytes() for source in sorted(Path(__file__).parent.glob("*.py"))
        )
        digest = hashlib.sha256(json.dumps(settings, sort_keys=True).encode() + code).hexdigest()
        users = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "geovp"
        return (
            Path(self.cache or os.environ.get("GEOVP_CACHE") or users) / "synthetic" / digest[:16]
        )


_street = functools.lru_cache(maxsize=2)(build_street)


def _write(file: Path, arrays: Arrays) -> None:
    """Written to a temporary file and renamed, so that a reader never sees half a file."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=file.parent, suffix=".part", delete=False) as part:
            np.savez(part, allow_pickle=False, **arrays)
        os.replace(part.name, file)
    except OSError as error:
        raise BadData(
            f"synthetic clips cannot be kept in {file.parent} ({error.strerror}): make room "
            "there or set GEOVP_CACHE "
            "to another folder"
        ) from error
