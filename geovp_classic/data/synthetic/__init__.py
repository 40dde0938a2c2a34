"""A synthetic street world: the data set that needs no download, and its parts for whoever wants other drives on it."""

from geovp_classic.data.synthetic.camera import CAMERA_HEIGHT_M, square_camera, wide_camera, world_from_camera
from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.data.synthetic.drive import Manoeuvre
from geovp_classic.data.synthetic.render import Footage, render_drive
from geovp_classic.data.synthetic.shading import Optics
from geovp_classic.data.synthetic.world import World, build_world

__all__ = [
    "CAMERA_HEIGHT_M",
    "Footage",
    "Manoeuvre",
    "Optics",
    "Synthetic",
    "World",
    "build_world",
    "render_drive",
    "square_camera",
    "wide_camera",
    "world_from_camera",
]
