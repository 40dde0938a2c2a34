"""The archives of KITTI's official site (www.cvlibs.net/datasets/kitti) that a root lacks.

The site asks for an account, so nothing is downloaded here.
"""

import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple


class Archive(NamedTuple):
    """An archive of the site, and the path in the root that its content takes."""

    name: str
    size: str  # as the site or its server states it
    belongs_in: str
    purpose: str


COLUMNS = ["archive", "size", "belongs in", "needed for"]
RAW_SIZES = Path(__file__).with_name("kitti_raw_sizes.toml")

CALIBRATION = Archive(
    "data_odometry_calib.zip",
    "1 MB",
    "sequences/NN/calib.txt",
    "cameras, times",
)
POSES = Archive(
    "data_odometry_poses.zip", "4 MB", "poses/NN.txt", "true poses of 00 to 10"
)
GREY = Archive(
    "data_odometry_gray.zip", "22 GB", "sequences/NN/image_0", "grey images"
)
COLOUR = Archive(
    "data_odometry_color.zip", "65 GB", "sequences/NN/image_2", "colour images"
)


def missing_odometry(
    root: Path, sequences: Iterable[str], camera: int | None = None
) -> list[Archive]:
    """Return the archives that hold what some of the sequences lack.

    Sequences of other names are the user's own. Without a camera, grey or colour images serve,
    and both are named where there are none.
    """
    images = [GREY, COLOUR]
    if camera is not None:
        images = [images[camera // 2]]
    official = {f"{number:02d}" for number in range(22)}
    missing: dict[Archive, None] = {}
    for sequence in sorted(official.intersection(sequences)):
        poses = [[POSES]] if sequence < "11" else []
        for choice in [[CALIBRATION], *poses, images]:
            paths = [
                root / archive.belongs_in.replace("NN", sequence)
                for archive in choice
            ]
            if not any(path.exists() for path in paths):
                missing.update(dict.fromkeys(choice))
    return list(missing)


def missing_raw(root: Path, drives: Iterable[str]) -> list[Archive]:
    """Return the archives of missing drives, and of the calibration of their dates.

    A drive is called as `KittiRaw` calls it: "2011_09_26_drive_0084".
    """
    sizes = tomllib.loads(RAW_SIZES.read_text())
    archives = {}
    for drive in drives:
        date = drive.partition("_drive_")[0]
        for name, path, purpose in (
            (f"{date}_calib", f"{date}/calib_cam_to_cam.txt", "cameras"),
            (f"{drive}_sync", f"{date}/{drive}_sync", "images, true poses"),
        ):
            if not (root / path).exists():
                size = sizes.get(name, "unknown")
                archives[name] = Archive(f"{name}.zip", size, path, purpose)
    return list(archives.values())
