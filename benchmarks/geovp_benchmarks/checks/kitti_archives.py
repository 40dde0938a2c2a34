"""The archives of KITTI's official site (www.cvlibs.net/datasets/kitti) that a root lacks.

The site asks for an account, so nothing is downloaded here.
"""

import tomllib
from collections.abc import Iterable
from pathlib import Path

COLUMNS = ["archive", "size", "belongs in", "needed for"]  # sizes as the site states them
TABLES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text())
ODOMETRY: dict[str, list[str]] = TABLES["odometry"]  # rows by content


def missing_odometry(
    root: Path, sequences: Iterable[str], camera: int | None = None
) -> list[list[str]]:
    """Return rows of the archives that hold what some of the sequences lack.

    Sequences of other names are the user's own. Without a camera, grey or colour images serve,
    and both are named where there are none.
    """
    images = ["grey", "colour"]
    if camera is not None:
        images = [images[camera // 2]]
    official = {f"{number:02d}" for number in range(22)}
    missing: list[list[str]] = []
    for sequence in sorted(official.intersection(sequences)):
        poses = [["poses"]] if sequence < "11" else []
        for contents in [["calibration"], *poses, images]:
            rows = [ODOMETRY[content] for content in contents]
            paths = [root / path.replace("NN", sequence) for _, _, path, _ in rows]
            if not any(path.exists() for path in paths):
                missing += [row for row in rows if row not in missing]
    return missing


def missing_raw(root: Path, drives: Iterable[str]) -> list[list[str]]:
    """Return rows of the archives of missing drives, and of the calibration of their dates.

    A drive is called as `KittiRaw` calls it: "2011_09_26_drive_0084".
    """
    archives = {}
    for drive in drives:
        date = drive.partition("_drive_")[0]
        for name, path, purpose in (
            (f"{date}_calib", f"{date}/calib_cam_to_cam.txt", "cameras"),
            (f"{drive}_sync", f"{date}/{drive}_sync", "images, true poses"),
        ):
            if not (root / path).exists():
                size = TABLES["raw_sizes"].get(name, "unknown")
                archives[name] = [f"{name}.zip", size, path, purpose]
    return list(archives.values())
