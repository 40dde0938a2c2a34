"""Clips of KITTI odometry, or of anything laid out like it (Geiger et al. 2012).

A root holds `sequences/NN/{image_K/000000.png, calib.txt, times.txt}` and `poses/NN.txt`; any image
type, any name NN. P_k of calib.txt is K_k [I | t] with cam_k_from_cam0 = (I, t): all cameras are
rectified to look the same way, and poses are camera 0's, so world_from_camk = world_from_cam0 @
cam0_from_camk.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path

from geovp_classic.data.findings import RAISE, Findings
from geovp_classic.data.formats import pose_files
from geovp_classic.data.formats.calibration_files import (
    KITTI_CAMERAS,
    read_projection,
)
from geovp_classic.data.frames.image_frames import image_size
from geovp_classic.data.frames.image_names import numbered_images
from geovp_classic.data.recordings import splits
from geovp_classic.data.recordings.scans import Scan, per_frame
from geovp_classic.data.recordings.sequences import PosedSequences
from geovp_classic.data.recordings.windows import FrameRange, Recording, SideCamera
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class Kitti(PosedSequences):
    """KITTI odometry; one clip every `stride` frames of each range.

    Either `split` (a name, or a .toml file) or `sequences` ("06", "03[180:360)") says which frames;
    with neither, all sequences are used. Without `camera`, each sequence shows image_2 if it has
    it, else image_0, else what it has. Poses are those of the camera shown, or None for a sequence
    without a pose file. `with_right` adds the frames of the right camera where there is one. Other
    settings are `SequenceDataset`'s.
    """

    name = "kitti"  # in results
    prefix = "image_"  # of the folders of images

    split: str | None = None
    camera: int | None = None
    camera_height_m: float = field(default=1.65, kw_only=True)  # by its sensor setup
    with_right: bool = False

    def __post_init__(self) -> None:
        if self.split is not None and self.sequences is not None:
            raise BadData(
                f"both split {self.split!r} and sequences {list(self.sequences)} are given: "
                "keep one of them"
            )
        super().__post_init__()

    def _named_ranges(self) -> tuple[FrameRange, ...]:
        if self.split is None:
            return super()._named_ranges()
        return splits.load(self.split)

    def folders(self) -> dict[str, Path]:
        """Return the sequences of the root by name; BadData if it is not KITTI odometry."""
        folder = self.root / "sequences"
        if not folder.is_dir():
            refuse_part(self.root)
            raise BadData(
                f"{self.root} holds no folder 'sequences': give KITTI odometry's 'dataset'"
            )
        return {path.name: path for path in sorted(folder.glob("[!.]*/"))}

    def scan(self, folder: Path, findings: Findings, camera: int | None = None) -> Scan:
        """Scan a sequence with one of its cameras, by default the one that it shows.

        `folder` is root/sequences/NN; the poses are root/poses/NN.txt, if there are any.
        """
        camera = self._cameras(folder)[0] if camera is None else camera
        images = numbered_images(folder / f"image_{camera}", findings)
        path = folder / "times.txt"
        times_s = per_frame(pose_files.read_times, path, images, findings)
        path = folder.parents[1] / "poses" / f"{folder.name}.txt"
        poses = None
        if path.exists():
            poses = per_frame(pose_files.read_kitti, path, images, findings)
        return rectified(images, folder / "calib.txt", f"P{camera}", times_s, poses, findings)

    def scans(self, folder: Path, findings: Findings) -> dict[str, Scan]:
        """Scan a sequence with each of its cameras."""
        return {
            f"image_{camera}": self.scan(folder, findings, camera)
            for camera in self._cameras(folder)
        }

    def _cameras(self, folder: Path) -> list[int]:
        """Return the cameras of a sequence that have a folder, first the one that it shows."""
        cameras = [
            camera for camera in KITTI_CAMERAS if (folder / f"{self.prefix}{camera}").is_dir()
        ]
        if self.camera not in (None, *cameras):
            raise BadData(f"{folder} has no {self.prefix}{self.camera}: give a camera of {cameras}")
        cameras.sort(key=lambda camera: camera != self.camera)
        return cameras or [KITTI_CAMERAS[0]]

    def _read(self, name: str, folder: Path) -> Recording:
        camera, *others = self._cameras(folder)
        left = self.scan(folder, RAISE)
        recording = self._recording(name, folder, left)
        right_camera = {0: 1, 2: 3}.get(camera)
        if not self.with_right or right_camera not in others:
            return recording
        right = self.scan(folder, RAISE, right_camera)
        view = self._recording(name, folder, right)
        right_from_left = se3.inverse(right.rig_from_cam) @ left.rig_from_cam
        side = SideCamera(view.frames, view.intrinsics, right_from_left)
        return replace(recording, right=side)


def refuse_part(path: Path) -> None:
    """Raise BadData for a path inside KITTI odometry, such as its sequences or one of them."""
    absolute = path.absolute()
    for folder in (absolute, *absolute.parents):
        root = folder.parent
        if folder.name in ("sequences", "poses") and any(root.glob("sequences/*/image_?")):
            raise BadData(f"{path} is a part of KITTI odometry: give its root, {root}")


def rectified(
    images: tuple[Path, ...],  # N
    calibration: Path,
    name: str,  # of the projection
    times_s: FloatArray,  # [N]
    world_from_cam0: FloatArray | None,  # [N, 4, 4]
    findings: Findings,
) -> Scan:
    """Return the scan of a rectified camera from its calibration and the poses of camera 0."""
    scan = Scan(images, times_s)
    if not images:
        return scan
    with findings.catch(images[0]):
        size_px = image_size(images[0])
        with findings.catch(calibration):
            camera, cam_from_cam0 = read_projection(calibration, name, size_px)
            cam0_from_cam = se3.inverse(cam_from_cam0)
            scan = scan.mounted(camera, cam0_from_cam, world_from_cam0)
    return scan
