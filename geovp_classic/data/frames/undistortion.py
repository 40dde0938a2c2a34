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

from geovp_classic.data.frames.image_frames import Array, FrameReader, Size
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.types import FloatArray, Intrinsics


@dataclass(frozen=True)
class DistortedCamera:
    """A pinhole camera behind a lens with one of COLMAP's distortion models.

    FULL_OPENCV may have fewer than its eight coefficients: k1, k2 [, p1, p2 [, k3]].
    """

    pinhole: Intrinsics  # without the distortion
    model: str = "PINHOLE"
    distortion: tuple[float, ...] = ()  # parameters after focal lengths and principal point

    def __post_init__(self) -> None:
        counts = {"FULL_OPENCV": (0, 2, 4, 5, 8), "OPENCV_FISHEYE": (0, 4)}
        # programs write more than the model has, such as OpenCV's 14
        max_count = counts.get(self.model, (len(self.distortion),))[-1]
        if not any(self.distortion[max_count:]):
            object.__setattr__(self, "distortion", self.distortion[:max_count])
        count = len(self.distortion)
        expected = counts.get(self.model, (count,))
        if count not in expected:
            raise BadData(
                f"the distortion {list(self.distortion)} has {count} coefficients, expected one "
                f"of {expected[1:]}"
            )

    @classmethod
    def from_colmap(cls, camera: Any) -> Self:
        """Convert a pycolmap.Camera.

        Its parameters are one or two focal lengths, the principal point, and the distortion; the
        centre of the top-left pixel is (0.5, 0.5).
        """
        if not camera.focal_length_idxs():
            raise ValueError(f"its model is {camera.model.name}, expected a pinhole or a fisheye")
        matrix = camera.calibration_matrix().tolist()
        (fx, _, cx), (_, fy, cy), _ = matrix
        size_px = camera.width, camera.height
        view = Intrinsics(fx, fy, cx - 0.5, cy - 0.5, *size_px)
        distortion = np.array(camera.params)[camera.extra_params_idxs()]
        return cls(view, camera.model.name, tuple(distortion.tolist()))

    @property
    def size_px(self) -> Size:
        """Return (width, height) of the images."""
        return self.pinhole.width_px, self.pinhole.height_px

    def sees(self, rays: FloatArray) -> bool:
        """Return whether all rays [N, 3] lie inside the image."""
        pixels = self.project(rays) + 0.5
        return bool(((pixels >= 0) & (pixels <= self.size_px)).all())

    def project(self, rays: FloatArray) -> FloatArray:
        """Project rays [N, 3] to pixels [N, 2]."""
        # a fisheye lens without coefficients has r = f theta, not r = f tan(theta)
        if "FISHEYE" not in self.model and not any(self.distortion):
            return pinhole.project(rays, self.pinhole)[0]
        # imported here, because training on KITTI does not need it
        from geovp_classic.colmap_library import pycolmap

        lens = pycolmap.Camera(model=self.model)
        focals = np.ones(len(lens.focal_length_idxs()))
        distortion = np.zeros(len(lens.extra_params_idxs()))
        distortion[: len(self.distortion)] = self.distortion
        lens.params = [*focals, 0.0, 0.0, *distortion]
        contiguous = np.ascontiguousarray(rays, np.float64)
        bent = np.asarray(lens.img_from_cam(contiguous))
        view = self.pinhole
        return bent * [view.fx_px, view.fy_px] + [view.cx_px, view.cy_px]


def common_pinhole(cameras: Iterable[DistortedCamera], source: Path) -> Intrinsics:
    """Return the first camera without distortion, zoomed in until all cameras see all its pixels.

    BadData naming `source` if that takes more than a zoom of 2.
    """
    distinct = list(dict.fromkeys(cameras))
    first = distinct[0].pinhole
    for zoom in np.geomspace(1.0, 2.0, 71).tolist():  # 1 % apart
        view = replace(first, fx_px=first.fx_px * zoom, fy_px=first.fy_px * zoom)
        rays = pinhole.rays(view)
        border = np.concatenate([rays[0], rays[-1], rays[:, 0], rays[:, -1]])
        if all(camera.sees(border) for camera in distinct):
            return view
    raise BadData(
        f"{source}: no pinhole camera, up to a zoom of 2, sees only what all its {len(distinct)} "
        "cameras see: check focal lengths, principal points and distortion"
    )


@functools.lru_cache(maxsize=8)
def _map(camera: DistortedCamera, view: Intrinsics) -> FloatArray | None:
    """Return where each pixel of the view lies in the camera's image, (u, v) [H, W, 2].

    None if each lies at the pixel itself.
    """
    grid = pinhole.pixel_grid(view)
    pixels = camera.project(pinhole.rays(view).reshape(-1, 3))
    pixels = pixels.reshape(grid.shape)
    has_same_size = camera.size_px == (view.width_px, view.height_px)
    if has_same_size and np.abs(pixels - grid).max() < 1e-6:
        return None
    return pixels.astype(np.float32)


@dataclass(frozen=True)
class UndistortedFrames:
    """Frames, each with its camera, all shown as the pinhole camera `view` sees them."""

    frames: FrameReader  # N
    cameras: tuple[DistortedCamera, ...]  # N
    view: Intrinsics
    interpolation: int = cv2.INTER_LINEAR

    def __len__(self) -> int:
        return len(self.frames)

    def digest(self, index: int) -> bytes:
        """Return a hash of the content of a frame and of its lens."""
        return self.frames.digest(index) + repr(self.cameras[index]).encode()

    def read(self, index: int) -> Array:
        """Return one frame; without distortion, it is not resampled."""
        image = self.frames.read(index)
        pixels = _map(self.cameras[index], self.view)
        if pixels is None:
            return image
        border = cv2.BORDER_REPLICATE
        return cv2.remap(image, pixels, None, self.interpolation, borderMode=border)
