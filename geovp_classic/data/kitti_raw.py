"""Clips of KITTI raw's synchronised drives (see `kitti_raw_layout`)."""

from __future__ import annotations

from dataclasses import dataclass

from geovp_classic.data import kitti_raw_layout
from geovp_classic.data.kitti import Kitti
from geovp_classic.data.sequences import Load
from geovp_classic.data.windows import Recording


@dataclass(frozen=True)
class KittiRaw(Kitti):
    """KITTI raw; settings as `Kitti`'s, sequences being drives such as "2011_09_26_drive_0084" or "...[100:200)".

    Poses come from the GPS and IMU readings of `oxts`; a drive without that folder has none. Times are seconds since
    the drive's first image.
    """

    @property
    def name(self) -> str:
        """The data set's name in results."""
        return "kitti-raw"

    def _names(self) -> list[str]:
        return kitti_raw_layout.drive_names(self.root)

    def _read(self, name: str, load: Load) -> Recording:
        settings = (self.camera, load, self.camera_height_m)
        return kitti_raw_layout.read_recording(self.root, name, *settings, with_right=self.with_right)
