"""Clips of a COLMAP model (Schoenberger and Frahm 2016) with its images.

A sequence is a folder with the model, binary or text, in `sparse/0`, `sparse` or itself, and the
images in `images` or itself, where the model's names of images are looked up. An image that was not
registered breaks the sequence, as does another sub-folder.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from geovp_classic.data import colmap_sizes, posed_sequences
from geovp_classic.data.findings import Finding, error
from geovp_classic.data.frames import SUFFIXES, natural_order
from geovp_classic.data.pose_files import FARTHEST
from geovp_classic.data.posed_sequences import PosedSequences, Scanned
from geovp_classic.data.undistortion import DistortedCamera
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray

MODELS = ("sparse/0", "sparse", ".")
RATE_HZ = 10.0  # as KITTI; a model does not say when images were taken


@dataclass(frozen=True)
class Colmap(PosedSequences):
    """Images in the order of their names (2 before 10) with the poses of a COLMAP model; settings
    as `PosedSequences`'.

    Images are taken `rate_hz` times a second, those that the model lacks included. A model's unit
    is not the metre unless `is_metric` says so. Images of several cameras are all shown as one
    pinhole camera sees them.
    """

    name: ClassVar[str] = "colmap"

    rate_hz: float = RATE_HZ
    is_metric: bool = False

    def __post_init__(self) -> None:
        if not 0 < self.rate_hz < np.inf:
            raise BadData(
                f"rate_hz is {self.rate_hz}, expected a positive number of images a second"
            )
        super().__post_init__()

    def _folders(self) -> dict[str, Path]:
        return folders(self.root)

    def _scan(self, folder: Path) -> Scanned:
        return scan(folder, self.rate_hz, self.is_metric)


def folders(root: Path) -> dict[str, Path]:
    """The sequences of a root by name."""
    return posed_sequences.folders(
        root, lambda path: _model(path) is not None, "a folder with images and sparse/0"
    )


def scan(folder: Path, rate_hz: float = RATE_HZ, is_metric: bool = False) -> Scanned:
    """A sequence as its model describes it; without a model of that folder there are
    images alone.
    """
    model, images = _model(folder), folder / "images" if (folder / "images").is_dir() else folder
    files = sorted(
        (
            path
            for path in images.rglob("*")
            if path.suffix.lower() in SUFFIXES and not path.name.startswith(".")
        ),
        key=lambda path: (path.parent, natural_order(path)),
    )
    found = {} if model is None else _registered(model)
    findings = _lacking(images, files, found)
    if model is None or findings:
        return Scanned(tuple(files), np.arange(len(files)) / rate_hz, (), tuple(findings))
    first = next(iter(found.values()))[1]
    poses, cameras = np.full((len(files), 4, 4), np.nan), [first] * len(files)
    for number, path in enumerate(files):
        name = path.relative_to(images).as_posix()
        if name in found:
            poses[number], cameras[number] = found[name]
    starts = frozenset(i for i in range(1, len(files)) if files[i].parent != files[i - 1].parent)
    times_s = np.arange(len(files)) / rate_hz
    return Scanned(
        tuple(files), times_s, tuple(cameras), (), poses, is_metric=is_metric, starts=starts
    )


def _model(folder: Path) -> Path | None:
    """The folder of a sequence's model."""
    tried = [folder / name for name in MODELS]
    return next(
        (
            path
            for path in tried
            if any((path / f"images.{kind}").is_file() for kind in ("bin", "txt"))
        ),
        None,
    )


def _lacking(images: Path, files: list[Path], registered: dict[str, Any]) -> list[Finding]:
    """What keeps a model from being used with these files."""
    if not registered:
        return [
            error(images, None, "has a model without a registered image: run COLMAP's mapper again")
        ]
    there = {path.relative_to(images).as_posix() for path in files}
    lacking = sorted(registered.keys() - there)
    if not lacking:
        return []
    message = (
        f"lacks {len(lacking)} of {len(registered)} images of the model, the first being "
        f"{lacking[0]}"
    )
    return [
        error(images, None, f"{message}: put the folder that COLMAP was given as --image_path here")
    ]


def _registered(model: Path) -> dict[str, tuple[FloatArray, DistortedCamera]]:
    """world_from_cam [4, 4] and camera of every registered image by its name; BadData when the
    files are damaged.
    """
    from geovp_classic.colmap_library import pycolmap

    colmap_sizes.check(model)
    try:
        return _posed(model, pycolmap.Reconstruction(str(model)))
    except (ValueError, RuntimeError, LookupError, MemoryError, OverflowError) as problem:
        reason = str(problem).strip().partition("\n")[0]
        raise BadData(
            f"{model} is not a COLMAP model ({reason}): give cameras, images and points3D of one"
        ) from problem


def _posed(model: Path, read: Any) -> dict[str, tuple[FloatArray, DistortedCamera]]:
    found = {}
    for image in (each for each in read.images.values() if each.has_pose):
        camera = read.cameras[image.camera_id]
        params = tuple(float(value) for value in camera.params)
        lens = DistortedCamera(camera.model.name, params, camera.width, camera.height)
        cam_from_world = np.vstack([image.cam_from_world().matrix(), [0, 0, 0, 1]])
        if not (np.abs([*cam_from_world.ravel(), *params]) <= FARTHEST).all():
            raise BadData(
                f"{model}: image {image.name} has a pose or camera that is not finite: run "
                "COLMAP again"
            )
        found[image.name] = (se3.inverse(cam_from_world), lens)
    return found
