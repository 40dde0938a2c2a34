"""Which data set a folder holds, by what lies in it."""

from pathlib import Path
from typing import Any

from geovp_classic.data import colmap, euroc, folder, kitti_raw_layout, tum
from geovp_classic.errors import BadData

POSED = {"tum": tum, "euroc": euroc, "colmap": colmap}
EXPECTED = (
    "KITTI odometry or raw, TUM RGB-D, EuRoC, a COLMAP model with its images, or a folder of images"
)


def name_of(root: Path) -> str:
    """The data set of a folder; BadData when it looks like none."""
    if not root.is_dir():
        raise BadData(f"{root} does not exist: give a folder of {EXPECTED}")
    if kitti_raw_layout.is_raw(root):
        return "kitti-raw"
    if (root / "sequences").is_dir() or (root / "dataset" / "sequences").is_dir():
        return "kitti"
    for name, layout in POSED.items():
        try:
            layout.folders(root)
        except BadData:
            continue
        return name
    if folder.paths_below(root):
        return "folder"
    raise BadData(
        f"{root} is laid out as no data set that is known here: give a folder of {EXPECTED}"
    )


def spec(root: Path) -> dict[str, Any]:
    """The table of the data set in a folder, as `registry.build` takes it; a folder of images needs
    intrinsics, too.
    """
    name = name_of(root)
    return {"name": name, ("path" if name == "folder" else "root"): root}
