"""Images of a camera with lens distortion as a pinhole camera without any sees them.

Distortion models and their equations are COLMAP's; of these, OPENCV is what ROS and Kalibr call
radtan or plumb_bob, FULL_OPENCV with a third radial coefficient is TUM's, and OPENCV_FISHEYE is
equidistant (Kannala and Brandt 2006).
"""

import functools
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np
import numpy.typing as npt

from geovp_classic.data import decoding
from geovp_classic.data.frames import FrameReader
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.types import ByteArray, FloatArray, Intrinsics

ZOOMS = np.geomspace(1.0, 2.0, 71)  # 1 % apart
Size = tuple[int, int]  # (width, height)
EXACT_PX = 1e-6  # maps that differ less from the pixels themselves change nothing


@dataclass(frozen=True)
class DistortedCamera:
    """One of COLMAP's camera models with its parameters, in which (0.5, 0.5) is the top-left
    pixel's centre.
    """

    model: str
    params: tuple[float, ...]
    width_px: int
    height_px: int

    @classmethod
    def of(
        cls,
        model: str,
        numbers: tuple[float, float, float, float],
        distortion: Iterable[float],
        size_px: Size,
    ) -> Self:
        """The camera of (fx, fy, cx, cy) with (0, 0) the top-left pixel's centre; fx where its
        model has one focal.
        """
        from geovp_classic.colmap_library import pycolmap

        fx, fy, cx, cy = numbers
        focal = (fx, fy)[: len(pycolmap.Camera(model=model).focal_length_idxs())]
        return cls(model, (*focal, cx + 0.5, cy + 0.5, *distortion), *size_px)

    @property
    def pinhole(self) -> Intrinsics:
        """The same camera without its distortion, (0, 0) the top-left pixel's centre."""
        camera = self._colmap
        focal_px = [self.params[i] for i in camera.focal_length_idxs()]
        cx, cy = (self.params[i] - 0.5 for i in camera.principal_point_idxs())
        return Intrinsics(focal_px[0], focal_px[-1], cx, cy, self.width_px, self.height_px)

    def pixels(self, rays: FloatArray) -> FloatArray:
        """The pixels [N, 2], (0, 0) the top-left one's centre, that rays [N, 3] fall on."""
        return np.asarray(self._colmap.img_from_cam(np.ascontiguousarray(rays, np.float64))) - 0.5

    @property
    def _colmap(self) -> Any:  # pycolmap.Camera
        from geovp_classic.colmap_library import pycolmap

        return pycolmap.Camera(
            model=self.model, params=self.params, width=self.width_px, height=self.height_px
        )


def common_pinhole(cameras: Iterable[DistortedCamera], source: Path) -> Intrinsics:
    """The first camera without its distortion, zoomed in until every pixel lies inside the images
    of all cameras.

    BadData naming `source` where that takes more than a zoom of 2.
    """
    every = list(dict.fromkeys(cameras))
    for zoom in ZOOMS:
        first = every[0].pinhole
        zoomed = replace(first, fx_px=first.fx_px * float(zoom), fy_px=first.fy_px * float(zoom))
        if all(_covers(camera, zoomed) for camera in every):
            return zoomed
    raise BadData(
        f"{source}: no pinhole camera, up to a zoom of 2, sees only what all its {len(every)} "
        "cameras see: check focal "
        "lengths, principal points and distortion"
    )


def undistorted(
    image: npt.NDArray[Any],  # [H, W, ...] of the distorted camera
    camera: DistortedCamera,
    view: Intrinsics,
    interpolation: int = cv2.INTER_LINEAR,
) -> npt.NDArray[Any]:
    """The image of the pinhole camera `view` in the same place; the same image where there is no
    distortion.
    """
    maps = _maps(camera, view)
    return (
        image
        if maps is None
        else cv2.remap(image, *maps, interpolation, borderMode=cv2.BORDER_REPLICATE)
    )


@dataclass(frozen=True)
class UndistortedFrames:
    """One image file a frame, each of a camera of its own, all shown as one pinhole camera sees
    them.
    """

    paths: tuple[Path, ...]  # N
    cameras: tuple[DistortedCamera, ...]  # N
    view: Intrinsics
    load: Callable[[Path], ByteArray]

    def __len__(self) -> int:
        return len(self.paths)

    def read(self, index: int) -> ByteArray:
        """One frame; BadData when its file is damaged or not of the size that its camera was
        calibrated at.
        """
        image = self.load(self.paths[index])
        _check_size(self.paths[index], image.shape, self.cameras[index])
        return undistorted(image, self.cameras[index], self.view)


@dataclass(frozen=True)
class UndistortedVideo:
    """The frames of one camera, shown as a pinhole camera sees them."""

    frames: FrameReader
    camera: DistortedCamera
    view: Intrinsics

    def __len__(self) -> int:
        return len(self.frames)

    def read(self, index: int) -> ByteArray:
        """One frame."""
        return undistorted(self.frames.read(index), self.camera, self.view)


@dataclass(frozen=True)
class UndistortedDepths:
    """The depth images of such frames; `depths(number)` is z-depth [H, W] in metres, 0 where
    unknown.
    """

    paths: tuple[Path | None, ...]  # N, None for a frame that has none
    cameras: tuple[DistortedCamera, ...]  # N
    view: Intrinsics
    values_per_m: float

    def __call__(self, index: int) -> FloatArray:
        """The depth of one frame; BadData when its file is damaged or of another type or size."""
        path = self.paths[index]
        if path is None:
            return np.zeros((self.view.height_px, self.view.width_px), np.float32)
        image = decoding.decoded(path, cv2.IMREAD_UNCHANGED)
        if image.dtype != np.uint16 or image.ndim != 2:
            found = f"holds {image.dtype} in {image.ndim} dimensions"
            raise BadData(
                f"{path} {found}, expected a depth image of one channel of 16 bits: restore the "
                "file"
            )
        _check_size(path, image.shape, self.cameras[index])
        values = undistorted(image, self.cameras[index], self.view, cv2.INTER_NEAREST)
        return (values / self.values_per_m).astype(np.float32)


def _check_size(path: Path, shape: tuple[int, ...], camera: DistortedCamera) -> None:
    if shape[:2] != (camera.height_px, camera.width_px):
        expected = f"{camera.width_px}x{camera.height_px} as its calibration says"
        raise BadData(f"{path} is {shape[1]}x{shape[0]} pixels, expected {expected}")


@functools.lru_cache(maxsize=8)
def _maps(camera: DistortedCamera, view: Intrinsics) -> tuple[FloatArray, FloatArray] | None:
    """Where each pixel of the view lies in the camera's image: u and v [H, W]; None where that is
    the pixel itself.
    """
    pixels = camera.pixels(pinhole.rays(view).reshape(-1, 3)).reshape(
        view.height_px, view.width_px, 2
    )
    same_size = (view.width_px, view.height_px) == (camera.width_px, camera.height_px)
    if same_size and np.abs(pixels - pinhole.pixel_grid(view)).max() < EXACT_PX:
        return None
    return pixels[..., 0].astype(np.float32), pixels[..., 1].astype(np.float32)


def _covers(camera: DistortedCamera, view: Intrinsics) -> bool:
    """Whether the pixels on the border of the view lie inside the camera's image."""
    grid = pinhole.pixel_grid(view)
    border = np.concatenate([grid[0], grid[-1], grid[:, 0], grid[:, -1]])
    pixels = camera.pixels(pinhole.unproject(border, np.ones(len(border)), view))
    return bool(
        ((pixels >= -0.5) & (pixels <= np.array([camera.width_px, camera.height_px]) - 0.5)).all()
    )
