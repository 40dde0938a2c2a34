"""Clips of KITTI raw's synchronised drives (see `kitti_raw_layout`)."""

from dataclasses import dataclass
from typing import Any, ClassVar

from geovp_classic.data import kitti_raw_layout
from geovp_classic.data.kitti import Kitti


@dataclass(frozen=True)
class KittiRaw(Kitti):
    """KITTI raw; settings as `Kitti`'s, sequences being drives such as "2011_09_26_drive_0084" or
    "...[100:200)".

    Poses come from the GPS and IMU readings of `oxts`; a drive without that folder has none. Times
    are seconds since the drive's first image.
    """

    name: ClassVar[str] = "kitti-raw"
    layout: ClassVar[Any] = kitti_raw_layout
