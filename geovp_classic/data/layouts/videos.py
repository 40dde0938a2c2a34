"""Clips of a folder of videos, whose cameras a small file describes.

The file, cameras.toml, cameras.json or the only .toml or .json file of the folder, has a table for
each video, called by the video's name without its suffix:

    [drive]
    fps = 29.97                                # optional, the file states it
    intrinsics = [511.9, 511.9, 279.9, 209.9]  # of the frames as they are shown, or:
    fov_deg = 60                               # horizontal
    camera_height_m = 1.4                      # optional
    kind = "country road"                      # optional text
    moving = "some"                            # optional text: objects that move
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from geovp_classic import files
from geovp_classic.data.findings import Findings
from geovp_classic.data.frames.undistortion import DistortedCamera
from geovp_classic.data.frames.video_frames import VideoFrames, is_video
from geovp_classic.data.layouts.folder import DEFAULT_RATE_HZ
from geovp_classic.data.recordings import windows
from geovp_classic.data.recordings.scans import Scan
from geovp_classic.data.recordings.sequences import PosedSequences
from geovp_classic.data.recordings.windows import Fit, Rate, Recording, frames_at_rate
from geovp_classic.errors import BadData
from geovp_classic.types import Intrinsics

TABLES = (".toml", ".json")


@dataclass(frozen=True)
class Videos(PosedSequences):
    """Videos with a file of cameras; other settings are `PosedSequences`'.

    `cameras` is that file, by default the only .toml or .json file of `root`. With `num_windows`,
    each video gives that many clips, evenly spaced from its first frame to its last, without those
    across a pause; with "all", one every `stride` frames. Images are `size_px[0]` wide and have the
    aspect of their video.
    """

    name = "videos"
    is_upright = True

    cameras: Path | None = None
    num_windows: int | Literal["all"] = 2  # of 3 s each, the first and the last of a short video
    fit: Fit = field(default="width", kw_only=True)
    rate_hz: Rate = field(default=DEFAULT_RATE_HZ, kw_only=True)

    def __post_init__(self) -> None:
        if self.num_windows != "all" and self.num_windows < 1:
            raise BadData(f'num_windows is {self.num_windows}, expected 1 or more, or "all"')
        super().__post_init__()

    def folders(self) -> dict[str, Path]:
        """Return the videos by name; BadData if there are none, or no file of cameras."""
        videos: dict[str, Path] = {}
        for path in filter(is_video, sorted(self.root.glob("[!.]*"))):
            first = videos.setdefault(path.stem, path)
            if first != path:
                raise BadData(f"{path} has the same name as {first.name}: rename one of them")
        if not videos:
            raise BadData(f"{self.root} holds no videos: give mp4, mov, mkv or ts files")
        missing = sorted(videos.keys() - self.facts.keys())
        if missing:
            raise BadData(
                f"{self._camera_file} does not describe {', '.join(missing[:5])}: add a table for "
                'each, such as ["a name"], with fov_deg or intrinsics'
            )
        return videos

    @property
    def _camera_file(self) -> Path:
        if self.cameras is not None:
            return self.cameras
        present = [path for path in sorted(self.root.glob("*.*")) if path.suffix in TABLES]
        named = [path for path in present if path.stem == "cameras"] or present
        if len(named) != 1:
            raise BadData(
                f"{self.root} has {len(named)} .toml or .json files, expected one with a table for "
                "each video: call it cameras.toml"
            )
        return named[0]

    @cached_property
    def facts(self) -> dict[str, Mapping[str, Any]]:
        """Return what the file of cameras says, by the names of videos."""
        path = self._camera_file
        if path.suffix == ".json":
            table = files.read_json(path)
        else:
            text = files.read_text(path)
            with files.checked(f"{path} is not TOML", "fix it"):
                table = tomllib.loads(text)
        for name, facts in table.items():
            if not isinstance(facts, dict):
                raise BadData(f"{path}: {name} is {facts!r:.80}, expected a table for each video")
        return table

    def strata(self, clip_name: str) -> dict[str, str]:
        """Return the texts about a clip's video, such as its kind, by name."""
        facts = self.facts[clip_name.rpartition("/")[0]]
        return {name: value for name, value in facts.items() if isinstance(value, str)}

    def scan(self, folder: Path, findings: Findings) -> Scan:
        """Scan a video with its camera; an error names what the file of cameras lacks."""
        frames = VideoFrames(folder)
        name, facts = folder.stem, self.facts[folder.stem]
        width_px, height_px = frames.size_px
        expected = "expected positive numbers, and four of them as intrinsics"
        with files.checked(f"{self._camera_file}: {name} has a wrong value", expected):
            # the camera, as four numbers or as the field of view of a pinhole in the middle
            if (intrinsics := facts.get("intrinsics")) is None:
                focal_px = width_px / 2 / np.tan(np.radians(float(facts["fov_deg"])) / 2)
                intrinsics = focal_px, focal_px, (width_px - 1) / 2, (height_px - 1) / 2
            fx, fy, cx, cy = map(float, intrinsics)
            stated = {key: facts.get(key) for key in ("fps", "camera_height_m")}
            scalars = {key: float(value) for key, value in stated.items() if value is not None}
            if not all(1e-6 < value < 1e6 for value in (fx, fy, cx, cy, *scalars.values())):
                raise ValueError("not a positive number")
        camera = DistortedCamera(Intrinsics(fx, fy, cx, cy, width_px, height_px))
        return Scan(
            frames.names,
            frames.times_at(scalars.get("fps"), "fps"),
            (camera,) * len(frames),
            camera_height_m=scalars.get("camera_height_m"),
            reader=frames,
        )

    @cached_property
    def _clips(self) -> list[tuple[str, Recording, int]]:
        """Return the name and the frames of each clip, which are a recording of their own."""
        if self.num_windows == "all":
            return super()._clips
        clips = []
        for name, recording in self.native_recordings.items():
            # the last window ends at the last frame
            times_s = recording.times_s
            last_frame = len(times_s) - 1
            from_end = frames_at_rate(times_s, self.rate_hz, self.frame_step, anchor=last_frame)
            if len(from_end) < self.num_frames:
                raise BadData(
                    f"{name} has {len(from_end)} frames at rate_hz = {self.rate_hz}, but one clip "
                    f"needs {self.num_frames}: name other sequences, or give a larger rate_hz"
                )
            last = from_end[-self.num_frames]
            # the others begin evenly spaced between the first frame and that window's
            starts = np.linspace(0, last, self.num_windows).round().astype(int)
            for start in np.unique(starts).tolist():
                following = frames_at_rate(times_s[start:], self.rate_hz, self.frame_step)
                numbers = start + following[: self.num_frames]
                clip_name = windows.clip_name(name, start)
                window = replace(recording.selected(numbers), name=clip_name)
                if not self._paused(window).breaks:
                    clips.append((clip_name, window, 0))
        if not clips:
            raise BadData(f"{self.root}: each clip holds a pause of more than {self.max_step_s} s")
        return clips
