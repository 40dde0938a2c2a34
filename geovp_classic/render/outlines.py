"""Which pixels of an image show a mixture of two surfaces that another view sees apart.

A pixel on an outline gathers light of the surface in front and of the one behind it. While both move together in the
image the mixture moves with them and stays right; once they part, its colour belongs to neither.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geovp_classic.geometry import pinhole
from geovp_classic.render import patches
from geovp_classic.types import BoolArray, FloatArray, Intrinsics

IndexArray = npt.NDArray[np.int64]

PARTED_PX = 1.0  # surfaces that come this far apart, or closer together, do not share a pixel any more
JUMP = 1e-3  # of the inverse depth: a smaller step opens no gap worth looking at
NEAR = 1e-6  # the smallest z of a point that is projected


@dataclass(frozen=True)
class Outlines:
    """Neighbouring pixels of one image that do not lie on one plane."""

    size: tuple[int, int]  # (H, W)
    pairs: IndexArray  # [P, 2], numbers of the two pixels, row by row
    ends: FloatArray  # [P, 2, 2, 4], homogeneous: for either pixel of the pair its place, and that on the other's plane

    def parted(
        self,
        view_from_image: FloatArray,  # [4, 4]
        camera: Intrinsics,
    ) -> BoolArray:
        """The image's pixels [H, W] beside a jump whose two sides the view shows PARTED_PX or more differently."""
        x, y, z, _ = np.moveaxis(self.ends @ view_from_image.T, -1, 0)
        z = np.maximum(z, NEAR)
        gap_px = np.hypot(camera.fx_px * np.diff(x / z, axis=-1), camera.fy_px * np.diff(y / z, axis=-1))  # [P, 2, 1]
        parted = np.zeros(self.size, dtype=bool)
        parted.ravel()[self.pairs[gap_px.min(axis=(1, 2)) >= PARTED_PX]] = True
        return parted


def outlines(
    inverse_depth: FloatArray,  # [H, W], NaN where unknown
    camera: Intrinsics,
) -> Outlines:
    """All pairs of pixels side by side or above one another with a jump between them; none beside unknown depth."""
    slopes = patches.slopes(inverse_depth).reshape(-1, 2)
    q, numbers = inverse_depth.ravel(), np.arange(inverse_depth.size).reshape(inverse_depth.shape)
    across = np.stack([numbers[:, :-1].ravel(), numbers[:, 1:].ravel()], axis=-1)
    down = np.stack([numbers[:-1].ravel(), numbers[1:].ravel()], axis=-1)
    pairs = np.concatenate([across, down])
    axis = np.repeat([0, 1], [len(across), len(down)])
    first, second = pairs.T
    on_others = np.stack([q[second] - slopes[second, axis], q[first] + slopes[first, axis]], axis=-1)  # [P, 2]
    jump = (np.abs(on_others - q[pairs]) > JUMP * q[pairs]).all(axis=-1)
    pairs, on_others = pairs[jump], np.maximum(on_others[jump], 0.0)
    rays = pinhole.rays(camera).reshape(-1, 3)[pairs]  # [P, 2, 3]
    ends = [np.concatenate([rays, depth[..., None]], axis=-1) for depth in (q[pairs], on_others)]
    return Outlines(inverse_depth.shape, pairs, np.stack(ends, axis=2))
