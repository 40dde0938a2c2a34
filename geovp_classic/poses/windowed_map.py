"""Points and the last few keyframes that saw them: what the camera is located against."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from geovp_classic.geometry import se3, two_view
from geovp_classic.poses.bundle import bundle_adjust
from geovp_classic.poses.lens import Lens
from geovp_classic.poses.resection import misses
from geovp_classic.poses.triangulation import triangulate
from geovp_classic.types import BoolArray, FloatArray

IndexArray = npt.NDArray[np.int64]

MIN_PARALLAX = 4.0  # a point is placed once its rays differ by this much beyond rotation, in standard deviations
MAX_MISS = 5.0  # an observation that misses its point by more standard deviations is forgotten


class WindowedMap:
    """Tracks of points through the last `size` keyframes, and where the points are, once known.

    Arrays share the axis N of all points still seen or still followed; a point that left the pictures stays as long as
    two keyframes of the window saw it, for the sake of their poses.
    """

    def __init__(self, lens: Lens, noise_px: float, size: int) -> None:
        """An empty map of at most `size` keyframes, for pixels with this standard deviation."""
        self.lens = lens
        self.noise_px = noise_px
        self.size = size
        self.first_serial = 0  # of the oldest keyframe kept, counted from the start
        self.cam_from_world: FloatArray = np.zeros((0, 4, 4))  # [K, 4, 4]
        self.seen: FloatArray = np.zeros((0, 0, 2))  # [K, N, 2] pixels; NaN where a keyframe does not see a point
        self.pixels: FloatArray = np.zeros((0, 2))  # [N, 2] in the last picture, of points still followed
        self.followed: BoolArray = np.zeros(0, dtype=bool)  # [N]
        self.points: FloatArray = np.zeros((0, 3))  # [N, 3] in the world; NaN while unknown
        self.ids: IndexArray = np.zeros(0, dtype=np.int64)  # [N], increasing
        self._num_ids = 0

    def __len__(self) -> int:
        """K, the number of keyframes."""
        return len(self.cam_from_world)

    @property
    def noise(self) -> float:
        """Standard deviation of a ray's coordinates."""
        return self.noise_px / self.lens.focal_px

    @property
    def known(self) -> BoolArray:
        """Points [N] whose place is known."""
        known: BoolArray = np.isfinite(self.points[:, 0])
        return known

    @property
    def newest_serial(self) -> int:
        """The number of the newest keyframe, counted from the start."""
        return self.first_serial + len(self) - 1

    def insert(self, cam_from_world: FloatArray) -> None:
        """Make the last picture a keyframe; the oldest one goes when the window is full."""
        observed = np.where(self.followed[:, None], self.pixels, np.nan)
        self.seen = np.concatenate([self.seen, observed[None]])
        self.cam_from_world = np.concatenate([self.cam_from_world, cam_from_world[None]])
        if len(self) > self.size:
            self.seen, self.cam_from_world = self.seen[1:], self.cam_from_world[1:]
            self.first_serial += 1
        counts = np.isfinite(self.seen[..., 0]).sum(axis=0)
        self._keep(self.followed | (self.known & (counts >= 2)))

    def add(self, pixels: FloatArray) -> None:
        """Start to follow new points [M, 2] of the newest keyframe."""
        unseen = np.full((len(self), len(pixels), 2), np.nan)
        unseen[-1] = pixels
        self.seen = np.concatenate([self.seen, unseen], axis=1)
        self.pixels = np.concatenate([self.pixels, pixels])
        self.followed = np.concatenate([self.followed, np.ones(len(pixels), dtype=bool)])
        self.points = np.concatenate([self.points, np.full((len(pixels), 3), np.nan)])
        self.ids = np.concatenate([self.ids, self._num_ids + np.arange(len(pixels))])
        self._num_ids += len(pixels)

    def index_of(self, ids: IndexArray) -> IndexArray:
        """Where points with these ids [M] are kept; -1 for those gone."""
        place = np.minimum(np.searchsorted(self.ids, ids), max(len(self.ids) - 1, 0))
        return np.where(self.ids[place] == ids, place, -1) if len(self.ids) else np.full(len(ids), -1)

    def keep_newest_only(self) -> None:
        """Forget all places and all keyframes but the newest; its points stay and are still followed."""
        self.first_serial = self.newest_serial
        self.cam_from_world, self.seen = self.cam_from_world[-1:], self.seen[-1:]
        self.points = np.full_like(self.points, np.nan)

    def clear(self) -> None:
        """Forget everything but how many keyframes and points there have been."""
        self.first_serial += len(self)
        self.cam_from_world, self.seen = self.cam_from_world[:0], self.seen[:0]
        self._keep(np.zeros(len(self.points), dtype=bool))

    def place(self) -> None:
        """Triangulate what two keyframes or more saw with enough parallax."""
        index: IndexArray = np.flatnonzero(~self.known & (np.isfinite(self.seen[..., 0]).sum(axis=0) >= 2))
        if len(index):
            self.points[index] = self._triangulated(index)

    def adjust(self, num_fixed: int, max_points: int) -> None:
        """Bundle adjustment of the window; points beyond `max_points`, those seen least, are placed anew after it."""
        counts = np.isfinite(self.seen[..., 0]).sum(axis=0)
        index: IndexArray = np.flatnonzero(self.known & (counts >= 2))
        if len(self) <= num_fixed or len(index) < 8:
            return
        order = np.argsort(-counts[index], kind="stable")
        chosen, others = index[order[:max_points]], index[order[max_points:]]
        self.cam_from_world, self.points[chosen] = bundle_adjust(
            self.cam_from_world, self.points[chosen], self.seen[:, chosen], self.lens, num_fixed, self.noise_px
        )
        if len(others):
            self.points[others] = self._triangulated(others)
        self.cull()

    def cull(self) -> None:
        """Forget observations that do not fit, then points with fewer than two left."""
        index: IndexArray = np.flatnonzero(self.known)
        seen = self.seen[:, index]
        miss = misses(self.points[index], self.lens.rays(seen), self.cam_from_world)
        self.seen[:, index] = np.where((miss > MAX_MISS * self.noise)[..., None], np.nan, seen)
        wrong = index[np.isfinite(self.seen[:, index, 0]).sum(axis=0) < 2]
        self.points[wrong] = np.nan
        self.followed[wrong] = False

    def predicted(self, cam_from_world_before: FloatArray, cam_from_world: FloatArray) -> FloatArray:
        """Where the followed points [M, 2] will appear from a new pose; unknown ones are as far as their neighbours."""
        index, known = np.flatnonzero(self.followed), self.known[self.followed]
        pixels, depth = self.pixels[index], np.full(len(index), 1e9)  # so far that only rotation shifts them
        depth[known] = np.maximum(se3.transform(cam_from_world_before, self.points[index[known]])[:, 2], 1e-3)
        if known.sum() >= 3 and not known.all():
            near = cKDTree(pixels[known]).query(pixels[~known], k=3)[1]
            depth[~known] = 1 / (1 / depth[known])[near].mean(axis=1)
        points = two_view.homogeneous(self.lens.rays(pixels)) * depth[:, None]
        ahead = se3.transform(cam_from_world @ se3.inverse(cam_from_world_before), points)
        front = ahead[:, 2:] > 1e-6
        return np.where(front, self.lens.pixels(ahead[:, :2] / np.where(front, ahead[:, 2:], 1.0)), pixels)

    def parallax(self, cam_from_world: FloatArray) -> float:
        """Median shift on z = 1 of the followed points since the newest keyframe, beyond what rotation explains."""
        shared = self.followed & np.isfinite(self.seen[-1, :, 0])
        if not shared.any():
            return 0.0
        rotation = (cam_from_world @ se3.inverse(self.cam_from_world[-1]))[:3, :3]
        before = two_view.rotate_rays(rotation, self.lens.rays(self.seen[-1, shared]))
        return float(np.nanmedian(np.linalg.norm(self.lens.rays(self.pixels[shared]) - before, axis=1)))

    def _triangulated(self, index: IndexArray) -> FloatArray:
        """Points [M, 3]; NaN where parallax is missing, the error is large or the point is behind a camera."""
        rays = self.lens.rays(self.seen[:, index])
        points = triangulate(rays, self.cam_from_world)
        miss = np.where(np.isfinite(rays[..., 0]), misses(points, rays, self.cam_from_world), 0.0)
        good = (miss < MAX_MISS * self.noise).all(axis=0) & (self._spread(rays) > MIN_PARALLAX * self.noise)
        return np.where(good[:, None], points, np.nan)

    def _spread(self, rays: FloatArray) -> FloatArray:
        """How far the rays [K, M] of one point lie apart once turned into one orientation, as an angle [M]."""
        turned = two_view.homogeneous(rays) @ self.cam_from_world[:, :3, :3]  # into the world's axes
        turned /= np.linalg.norm(turned, axis=-1, keepdims=True)
        first = turned[np.isfinite(turned[..., 0]).argmax(axis=0), np.arange(turned.shape[1])]
        spread: FloatArray = np.nanmax(np.linalg.norm(turned - first, axis=-1), axis=0)
        return spread

    def _keep(self, mask: BoolArray) -> None:
        self.seen, self.pixels, self.points = self.seen[:, mask], self.pixels[mask], self.points[mask]
        self.followed, self.ids = self.followed[mask], self.ids[mask]
