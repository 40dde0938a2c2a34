"""Images of a camera with lens distortion, shown as a pinhole camera sees them.

Distortion models and their equations are COLMAP's; of these, OPENCV is what ROS and Kalibr call
radtan or plumb_bob, FULL_OPENCV with a third radial coefficient is TUM's, and OPENCV_FISHEYE is
equidistant (Kannala and Brandt 2006).
"""

import functools
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np
import numpy.typing as npt

from geovp_classic.data import decoding
from geovp_classic.data.frames import FrameReader, load_sized
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.types import FloatArray, Intrinsics

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class DistortedCamera:
    """A pinhole camera behind a lens with one of COLMAP's distortion models."""

    pinhole: Intrinsics  # without the distortion
    model: str = "PINHOLE"
    distortion: tuple[
        float, ...
    ] = ()  # the parameters after focal lengths and principal point

    @classmethod
    def from_colmap(cls, camera: Any) -> Self:
        """Convert a pycolmap.Camera.

        Its parameters are one or two focal lengths, the principal point, and the distortion; the
        centre of the top-left pixel is (0.5, 0.5).
        """
        params = [float(value) for value in camera.params]
        num_focals = len(camera.focal_length_idxs())
        fx_px, fy_px = params[0], params[num_focals - 1]
        cx_px, cy_px = params[num_focals : num_focals + 2]
        intrinsics = Intrinsics(
            fx_px, fy_px, cx_px - 0.5, cy_px - 0.5, camera.width, camera.height
        )
        return cls(
            intrinsics, camera.model.name, tuple(params[num_focals + 2 :])
        )

    @property
    def size_px(self) -> tuple[int, int]:
        """Return (width, height) of the images."""
        return self.pinhole.width_px, self.pinhole.height_px

    def pixels(self, rays: FloatArray) -> FloatArray:
        """Project rays [N, 3] to pixels [N, 2].

        The centre of the top-left pixel is (0, 0) here and (0.5, 0.5) in COLMAP.
        """
        if not any(self.distortion):
            return pinhole.project(rays, self.pinhole)[0]
        from geovp_classic.colmap_library import (
            pycolmap,
        )  # not needed to train on KITTI

        camera = pycolmap.Camera(model=self.model)
        num_focals = len(camera.focal_length_idxs())
        focal_px = (self.pinhole.fx_px, self.pinhole.fy_px)[:num_focals]
        centre_px = (self.pinhole.cx_px + 0.5, self.pinhole.cy_px + 0.5)
        camera.params = (*focal_px, *centre_px, *self.distortion)
        contiguous = np.ascontiguousarray(rays, np.float64)
        return np.asarray(camera.img_from_cam(contiguous)) - 0.5


def common_pinhole(
    cameras: Iterable[DistortedCamera], source: Path
) -> Intrinsics:
    """Return the first camera without distortion, zoomed in until all cameras see all its pixels.

    BadData naming `source` if that takes more than a zoom of 2.
    """
    distinct = list(dict.fromkeys(cameras))
    first = distinct[0].pinhole
    for zoom in np.geomspace(1.0, 2.0, 71).tolist():  # 1 % apart
        zoomed = replace(
            first, fx_px=first.fx_px * zoom, fy_px=first.fy_px * zoom
        )
        if all(_covers(camera, zoomed) for camera in distinct):
            return zoomed
    raise BadData(
        f"{source}: no pinhole camera, up to a zoom of 2, sees only what all its {len(distinct)} "
        "cameras see: check focal lengths, principal points and distortion"
    )


def _covers(camera: DistortedCamera, view: Intrinsics) -> bool:
    """Return whether the pixels on the border of the view lie inside the camera's image."""
    grid = pinhole.pixel_grid(view)
    border = np.concatenate([grid[0], grid[-1], grid[:, 0], grid[:, -1]])
    pixels = camera.pixels(
        pinhole.unproject(border, np.ones(len(border)), view)
    )
    max_px = np.array(camera.size_px) - 0.5
    return bool(((pixels >= -0.5) & (pixels <= max_px)).all())


def undistorted(
    image: Array,  # [H, W, ...] of the distorted camera
    camera: DistortedCamera,
    view: Intrinsics,
    interpolation: int = cv2.INTER_LINEAR,
) -> Array:
    """Return the image of the pinhole camera `view`; the same image if there is no distortion."""
    maps = _maps(camera, view)
    if maps is None:
        return image
    return cv2.remap(
        image, *maps, interpolation, borderMode=cv2.BORDER_REPLICATE
    )


@functools.lru_cache(maxsize=8)
def _maps(
    camera: DistortedCamera, view: Intrinsics
) -> tuple[FloatArray, FloatArray] | None:
    """Return where each pixel of the view lies in the camera's image: u and v [H, W].

    None if each lies at the pixel itself.
    """
    pixels = camera.pixels(pinhole.rays(view).reshape(-1, 3))
    pixels = pixels.reshape(view.height_px, view.width_px, 2)
    has_same_size = camera.size_px == (view.width_px, view.height_px)
    if has_same_size and np.abs(pixels - pinhole.pixel_grid(view)).max() < 1e-6:
        return None
    return pixels[..., 0].astype(np.float32), pixels[..., 1].astype(np.float32)


@dataclass(frozen=True)
class UndistortedFrames:
    """Frames, each with its camera, all shown as one pinhole camera sees them."""

    frames: FrameReader  # N
    cameras: tuple[DistortedCamera, ...]  # N
    view: Intrinsics

    def __len__(self) -> int:
        return len(self.frames)

    def read(self, index: int) -> Array:
        """Return one frame."""
        return undistorted(
            self.frames.read(index), self.cameras[index], self.view
        )


@dataclass(frozen=True)
class UndistortedDepths:
    """The depth images of such frames: z-depth [H, W] in metres, 0 where unknown."""

    paths: tuple[Path | None, ...]  # N, None for a frame that has none
    cameras: tuple[DistortedCamera, ...]  # N
    view: Intrinsics
    values_per_m: float

    def __call__(self, index: int) -> FloatArray:
        """Return the depth of one frame; BadData if its file is damaged or of another type."""
        path = self.paths[index]
        if path is None:
            return np.zeros(
                (self.view.height_px, self.view.width_px), np.float32
            )
        camera = self.cameras[index]
        image = load_sized(path, camera.size_px, _load_depth)
        values = undistorted(image, camera, self.view, cv2.INTER_NEAREST)
        return (values / self.values_per_m).astype(np.float32)


def _load_depth(path: Path) -> Array:
    """Read the values [H, W] of a depth image; BadData for an image of another type."""
    image = decoding.decoded(path, cv2.IMREAD_UNCHANGED)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise BadData(
            f"{path} holds {image.dtype} in {image.ndim} dimensions, expected a depth image of "
            "one channel of 16 bits: restore the file"
        )
    return image
