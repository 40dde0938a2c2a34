"""Clips of a COLMAP model (Schoenberger and Frahm 2016) with its images.

A sequence is a folder with the model, binary or text, in `sparse/N`, `sparse`, `colmap/sparse/N`
(nerfstudio) or itself, and the images in `images` or itself, where the model's names of images are
looked up. An image that was not registered breaks the sequence, as does another sub-folder. Images
that differ by more than numbers from all registered ones, such as masks, are ignored.
"""

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geovp_classic import files
from geovp_classic.data.findings import Findings
from geovp_classic.data.frames.image_names import (
    frame_numbers,
    images_below,
    natural_order,
    series_name,
)
from geovp_classic.data.frames.undistortion import DistortedCamera
from geovp_classic.data.recordings.scans import Scan
from geovp_classic.data.recordings.sequences import PosedSequences
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray

Registered = dict[str, tuple[FloatArray, DistortedCamera]]


@dataclass(frozen=True)
class Colmap(PosedSequences):
    """Images in the order of their names (2 before 10) with the poses of a COLMAP model.

    Settings are `PosedSequences`'. Images are taken `frame_rate_hz` times a second, those that the
    model lacks included. A model's unit is not the metre unless `is_metric` says so. Images of
    several cameras are all shown as one pinhole camera sees them.
    """

    name = "colmap"
    patterns = (
        "sparse/[0-9]*/images.[bt]*",
        "sparse/images.[bt]*",
        "images.[bt]*",
        "colmap/sparse/[0-9]*/images.[bt]*",
    )

    frame_rate_hz: float = 10.0  # as KITTI; a model does not state times
    is_metric: bool = False

    def __post_init__(self) -> None:
        if not 0 < self.frame_rate_hz < np.inf:
            raise BadData(
                f"frame_rate_hz is {self.frame_rate_hz}, expected a positive number of images a "
                "second"
            )
        super().__post_init__()

    def scan(self, folder: Path, findings: Findings) -> Scan:
        """Scan a sequence; it has images alone if the model cannot be used."""
        root = folder / "images" if (folder / "images").is_dir() else folder
        paths = sorted(images_below(root), key=lambda path: (path.parent, natural_order(path)))
        names = [path.relative_to(root).as_posix() for path in paths]
        registered: Registered = {}
        with findings.catch(folder):
            parts = itertools.chain(*map(folder.glob, self.patterns))
            models = list(dict.fromkeys(path.parent for path in parts))
            # a mapper that starts again writes several models; a merged one may lie above them
            registered = max(map(_read_model, sorted(models)), key=len)
            if len(models) > 1:
                findings.add(
                    folder,
                    f"has {len(models)} models: the largest, of {len(registered)} images, is used",
                    severity="warning",
                )
        # masks may lie beside the images: COLMAP calls that of im1.jpg im1.jpg.png
        if registered:
            series = {*map(series_name, registered)}
            names = [name for name in names if name in registered or series_name(name) in series]
        images = tuple(root / name for name in names)
        times_s = frame_numbers(images) / self.frame_rate_hz
        missing = sorted(registered.keys() - set(names))
        if missing:
            findings.add(
                root,
                f"lacks {len(missing)} of {len(registered)} images of the model, the first being "
                f"{missing[0][:200]}: put the folder that COLMAP was given as --image_path here",
            )
        if missing or not registered:
            return Scan(images, times_s)
        _, camera = next(iter(registered.values()))
        unregistered = np.full((4, 4), np.nan), camera
        views = (registered.get(name, unregistered) for name in names)
        poses, cameras = zip(*views, strict=True)
        return Scan(
            images,
            times_s,
            cameras,
            np.stack(poses),
            is_metric=self.is_metric,
        )


def _read_model(model: Path) -> Registered:
    """Read world_from_cam [4, 4] and camera of every registered image by its name."""
    from geovp_classic.colmap_library import pycolmap

    _check_counts(model / "images.bin", 64, True, 8, 24)
    _check_counts(model / "points3D.bin", 43, False, 8, 8)
    _check_counts(model / "frames.bin", 64, False, 4, 16)
    registered: Registered = {}
    advice = "give cameras, images and points3D of one, or rerun COLMAP's mapper"
    with files.checked(f"{model} is not a COLMAP model", advice):
        reconstruction = pycolmap.Reconstruction(str(model))
        for image in reconstruction.images.values():
            if image.has_pose:
                camera = reconstruction.cameras[image.camera_id]
                rows = image.cam_from_world().inverse().matrix()
                registered[image.name] = (
                    se3.compose(rows[:, :3], rows[:, 3]),
                    DistortedCamera.from_colmap(camera),
                )
        if not registered:
            raise ValueError("no image is registered")
    return registered


def _check_counts(
    path: Path,
    fixed_bytes: int,
    has_name: bool,
    count_bytes: int,
    item_bytes: int,
) -> None:
    """Raise BadData for a binary file of a model that is not as long as its counts say.

    A record holds fixed bytes, perhaps a name, and a count of items. pycolmap 4.2 reads points,
    images and frames beyond the end of a file, for hours or until memory is full; it refuses other
    damage.
    """
    if not path.exists():
        return
    content = files.read_bytes(path, 4096 * files.MIB)
    end = 8
    for _ in range(int.from_bytes(content[:8], "little")):
        end += fixed_bytes
        if has_name:
            end = content.find(b"\0", end) + 1 or len(content)
        count = int.from_bytes(content[end : end + count_bytes], "little")
        end += count_bytes + count * item_bytes
        if end > len(content):
            break
    if end != len(content):
        raise BadData(f"{path} has {len(content)} bytes, not as its counts say: rerun COLMAP")
