"""The data set that a folder holds, by what lies in it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from geovp_classic.data.frames.video_frames import is_video
from geovp_classic.data.layouts.cityscapes import Cityscapes
from geovp_classic.data.layouts.colmap import Colmap
from geovp_classic.data.layouts.euroc import Euroc
from geovp_classic.data.layouts.folder import JSON_ADVICE, Folder
from geovp_classic.data.layouts.kitti import Kitti, refuse_part
from geovp_classic.data.layouts.kitti_raw import KittiRaw
from geovp_classic.data.layouts.rosbag import RosBag
from geovp_classic.data.layouts.tum import Tum
from geovp_classic.data.layouts.videos import Videos
from geovp_classic.errors import BadData

LAYOUTS: dict[str, Any] = {
    "kitti-raw": KittiRaw,
    "kitti": Kitti,
    "cityscapes": Cityscapes,
    "tum": Tum,
    "euroc": Euroc,
    "colmap": Colmap,
    "rosbag": RosBag,
    "videos": Videos,
    "folder": Folder,
}


def detect(
    root: Path, settings: Mapping[str, Any] | None = None, *, is_part_allowed: bool = False
) -> tuple[str, Any]:
    """Return the name of a folder's data set, and the data set itself.

    Its settings are checked, but its files are not, which is for the doctor to do. BadData if the
    folder looks like no data set, or is a part of one, whose root has the camera and the poses.
    Settings may give these, and callers may do without.
    """
    if not (settings or is_part_allowed):
        refuse_part(root)
    for name, layout in LAYOUTS.items():
        unread = type(layout.__name__, (layout,), {"_check_files": lambda _: None})
        try:
            unread(root).folders()
        except BadData:
            continue
        return name, unread(root, **(settings or {}))
    if root.is_dir() and any(map(is_video, root.iterdir())):
        Videos(root)  # names what it lacks
    for path in (root, *root.glob("transforms*.json")):
        if path.suffix == ".json":
            raise BadData(f"{path} {JSON_ADVICE}")
    raise BadData(
        f"{root} does not exist or holds no known data set: give a folder of KITTI odometry or "
        "raw, Cityscapes, TUM RGB-D, EuRoC, a COLMAP model with its images, a ROS bag, a video, "
        "or a folder of images (png, jpg, webp, bmp, tif, ppm, jp2) or of videos with a file of "
        "cameras"
    )


def spec(root: Path) -> dict[str, Any]:
    """Return the table of the data set in a folder, as `registry.build` takes it.

    A folder of images needs intrinsics, too.
    """
    name, _ = detect(root)
    return {"name": name, "path" if name == "folder" else "root": root}
