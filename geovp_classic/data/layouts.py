"""The data set that a folder holds, by what lies in it."""

from pathlib import Path
from typing import Any

from geovp_classic.data.colmap import Colmap
from geovp_classic.data.euroc import Euroc
from geovp_classic.data.folder import Folder
from geovp_classic.data.kitti import Kitti
from geovp_classic.data.kitti_raw import KittiRaw
from geovp_classic.data.tum import Tum
from geovp_classic.errors import BadData

LAYOUTS: dict[str, Any] = {
    "kitti-raw": KittiRaw,
    "kitti": Kitti,
    "tum": Tum,
    "euroc": Euroc,
    "colmap": Colmap,
    "folder": Folder,
}


def name_of(root: Path) -> str:
    """Return the data set of a folder; BadData if it looks like none."""
    for name, layout in LAYOUTS.items():
        try:
            layout.folders(root)
        except BadData:
            continue
        return name
    raise BadData(
        f"{root} does not exist or holds no known data set: give a folder of KITTI odometry or "
        "raw, TUM RGB-D, EuRoC, a COLMAP model with its images, or a folder of images"
    )


def spec(root: Path) -> dict[str, Any]:
    """Return the table of the data set in a folder, as `registry.build` takes it.

    A folder of images needs intrinsics, too.
    """
    name = name_of(root)
    return {"name": name, ("path" if name == "folder" else "root"): root}
