"""Clips of TUM RGB-D (Sturm et al. 2012), or of anything laid out like it.

A sequence is a folder with `rgb.txt` and, if they are known, `depth.txt` and `groundtruth.txt`. The
lists hold `time file`, times in seconds; the poses `t x y z qx qy qz qw`. Depth images hold 5000
values a metre, 0 where unknown.
"""

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

from geovp_classic.data.findings import Findings
from geovp_classic.data.formats import pose_files
from geovp_classic.data.frames.image_frames import image_size
from geovp_classic.data.frames.undistortion import DistortedCamera
from geovp_classic.data.recordings.scans import Scan, nearest, nearest_poses, read_list
from geovp_classic.data.recordings.sequences import PosedSequences
from geovp_classic.errors import BadData
from geovp_classic.types import Intrinsics

Numbers = tuple[float, float, float, float]
Distortion = tuple[float, float, float, float, float]
CAMERAS = tomllib.loads(Path(__file__).with_name("tum_cameras.toml").read_text())


@dataclass(frozen=True)
class Tum(PosedSequences):
    """TUM RGB-D; settings as `PosedSequences`'.

    `intrinsics` are (fx, fy, cx, cy) and `distortion` (k1, k2, p1, p2, k3), in pixels of the stored
    images; without them, those of the camera in the sequence's name (freiburg1, 2 or 3). Poses and
    depths belong to the image whose time is nearest, at most `max_difference_s` away. Times are
    those of rgb.txt.
    """

    name = "tum"
    patterns = ("rgb.txt",)

    intrinsics: Numbers | None = None
    distortion: Distortion | None = None
    max_difference_s: float = 0.02  # as the data set's own associate.py

    def __post_init__(self) -> None:
        if self.distortion is not None and self.intrinsics is None:
            raise BadData(
                "distortion is given without intrinsics: give both, they are of one calibration"
            )
        super().__post_init__()

    def scan(self, folder: Path, findings: Findings) -> Scan:
        """Scan a sequence; without a known camera, it has none."""
        times_s, images = read_list(folder / "rgb.txt", folder, findings)
        depths = poses = None
        depth_list = folder / "depth.txt"
        if depth_list.exists():
            depth_times_s, paths = read_list(depth_list, folder, findings)
            numbers = nearest(times_s, depth_times_s, self.max_difference_s)
            with_missing = [*paths, None]
            depths = tuple(with_missing[number] for number in numbers)
        truth = folder / "groundtruth.txt"
        if truth.exists():
            recorded = pose_files.read_tum(truth, findings)
            poses = nearest_poses(times_s, *recorded, self.max_difference_s)
        intrinsics = self.intrinsics
        distortion = self.distortion or ()
        match = re.search(r"freiburg[123](?!\d)", folder.resolve().name)
        if intrinsics is None and match:
            intrinsics, distortion = map(tuple, CAMERAS[match[0]].values())
        cameras: tuple[DistortedCamera, ...] = ()
        if images and intrinsics:
            with findings.catch(images[0]):
                view = Intrinsics(*intrinsics, *image_size(images[0]))
                camera = DistortedCamera(view, "FULL_OPENCV", distortion)
                cameras = (camera,) * len(images)
        return Scan(images, times_s, cameras, poses, depths)
