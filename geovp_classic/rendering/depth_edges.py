"""Depth edges of an image, whose pixels may show a mixture of two surfaces."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.geometry import pinhole
from geovp_classic.rendering.patches import PatchModel
from geovp_classic.types import BoolArray, FloatArray, IntArray, Intrinsics


@dataclass(frozen=True)
class DepthEdges:
    """Neighbouring pixels of one image that do not lie on one plane.

    While both surfaces move together in the image, a mixture of their colours moves with them and
    stays right; once they separate, it belongs to neither.
    """

    size: tuple[int, int]  # (H, W)
    pairs: IntArray  # [P, 2], flat indices of the two pixels
    # [P, 2, 2, 4], homogeneous: each pixel of a pair at its place, and on the plane of the other.
    ends: FloatArray

    @classmethod
    def of(
        cls,
        inverse_depth: FloatArray,  # [H, W], NaN where unknown
        camera: Intrinsics,
        model: PatchModel,
        min_step: float = 1e-3,  # of the inverse depth; smaller ones open no visible gap
    ) -> "DepthEdges":
        """Return all horizontal and vertical pairs with a depth step; none at unknown depth."""
        q = inverse_depth.ravel()
        slopes = model.slopes(inverse_depth).reshape(-1, 2)
        index = np.arange(q.size).reshape(inverse_depth.shape)
        horizontal = np.stack([index[:, :-1].ravel(), index[:, 1:].ravel()], axis=-1)
        vertical = np.stack([index[:-1].ravel(), index[1:].ravel()], axis=-1)
        pairs = np.concatenate([horizontal, vertical])
        axis = np.repeat([0, 1], [len(horizontal), len(vertical)])
        first, second = pairs.T
        first_on_second = q[second] - slopes[second, axis]
        second_on_first = q[first] + slopes[first, axis]
        on_other = np.stack([first_on_second, second_on_first], axis=-1)  # [P, 2]
        is_edge = (np.abs(on_other - q[pairs]) > min_step * q[pairs]).all(axis=-1)
        pairs = pairs[is_edge]
        depths = np.stack([q[pairs], np.maximum(on_other[is_edge], 0)], axis=-1)  # [P, 2, 2]
        rays = pinhole.rays(camera).reshape(-1, 3)[pairs]  # [P, 2, 3]
        rays = np.repeat(rays[:, :, None], 2, axis=2)
        ends = np.concatenate([rays, depths[..., None]], axis=-1)
        return cls(inverse_depth.shape, pairs, ends)

    def separated(
        self,
        view_from_image: FloatArray,  # [4, 4]
        camera: Intrinsics,
        min_gap_px: float,
    ) -> BoolArray:
        """Return the image's pixels [H, W] whose two surfaces the view shows so far apart."""
        x, y, z, _ = np.moveaxis(self.ends @ view_from_image.T, -1, 0)
        z = np.maximum(z, 1e-6)
        gap_u = camera.fx_px * np.diff(x / z, axis=-1)
        gap_v = camera.fy_px * np.diff(y / z, axis=-1)
        gap_px = np.hypot(gap_u, gap_v).min(axis=(1, 2))  # [P]
        is_separated = np.zeros(self.size, bool)
        is_separated.flat[self.pairs[gap_px >= min_gap_px]] = True
        return is_separated
