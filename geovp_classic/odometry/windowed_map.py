"""Points and the last few keyframes that saw them: what the camera is located against."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from geovp_classic.geometry import se3
from geovp_classic.odometry.bundle import bundle_adjust
from geovp_classic.odometry.lens import Lens, pixel
from geovp_classic.odometry.resection import misses
from geovp_classic.odometry.triangulation import triangulate
from geovp_classic.types import BoolArray, FloatArray

IndexArray = npt.NDArray[np.int64]

MIN_PARALLAX = 4.0  # a point is placed once its rays differ by this much beyond rotation, in standard deviations
MAX_MISS = 5.0  # an observation that misses its point by more standard deviations is forgotten


class WindowedMap:
    """Tracks of points through the last `size` keyframes, and where the points are, once known.

    Arrays share the axis N of all points still seen or still followed; a point that left the images stays as long as
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
        self.pixels: FloatArray = np.zeros((0, 2))  # [N, 2] in the last image, of points still followed
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
        """Make the last image a keyframe; the oldest one goes when the window is full."""
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
            depth[~known] = 1 / _mean_nearby(pixels[~known], pixels[known], 1 / depth[known])
        ahead_from_before, camera = cam_from_world @ se3.inverse(cam_from_world_before), self.lens.camera
        focal, centre = (camera.fx_px, camera.fy_px), (camera.cx_px, camera.cy_px)
        return _ahead(pixels, self.lens.rays(pixels), depth, ahead_from_before, focal, centre, float(self.lens.radial))

    def parallax(self, cam_from_world: FloatArray) -> float:
        """Median shift on z = 1 of the followed points since the newest keyframe, beyond what rotation explains."""
        shared = self.followed & np.isfinite(self.seen[-1, :, 0])
        if not shared.any():
            return 0.0
        rotation = (cam_from_world @ se3.inverse(self.cam_from_world[-1]))[:3, :3]
        return float(_shift(rotation, self.lens.rays(self.seen[-1, shared]), self.lens.rays(self.pixels[shared])))

    def _triangulated(self, index: IndexArray) -> FloatArray:
        """Points [M, 3]; NaN where parallax is missing, the error is large or the point is behind a camera."""
        rays = self.lens.rays(self.seen[:, index])
        points = triangulate(rays, self.cam_from_world)
        miss = np.where(np.isfinite(rays[..., 0]), misses(points, rays, self.cam_from_world), 0.0)
        good = (miss < MAX_MISS * self.noise).all(axis=0) & (
            _spread(rays, self.cam_from_world) > MIN_PARALLAX * self.noise
        )
        return np.where(good[:, None], points, np.nan)

    def _keep(self, mask: BoolArray) -> None:
        self.seen, self.pixels, self.points = self.seen[:, mask], self.pixels[mask], self.points[mask]
        self.followed, self.ids = self.followed[mask], self.ids[mask]


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _mean_nearby(places: FloatArray, pixels: FloatArray, values: FloatArray) -> FloatArray:
    """Means [M] of the values [N] at the three of the pixels [N, 2] nearest to each place [M, 2]."""
    means = np.empty(len(places))
    for m in range(len(places)):
        first, second, third = (np.inf, 0.0), (np.inf, 0.0), (np.inf, 0.0)  # squared distances and values
        for n in range(len(pixels)):
            square = (places[m, 0] - pixels[n, 0]) ** 2 + (places[m, 1] - pixels[n, 1]) ** 2
            if square < first[0]:
                first, second, third = (square, values[n]), first, second
            elif square < second[0]:
                second, third = (square, values[n]), second
            elif square < third[0]:
                third = (square, values[n])
        means[m] = (first[1] + second[1] + third[1]) / 3
    return means


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _ahead(
    pixels: FloatArray,  # [N, 2]
    rays: FloatArray,  # [N, 2]
    depth: FloatArray,  # [N]
    ahead_from_before: FloatArray,  # [4, 4]
    focal: tuple[float, float],
    centre: tuple[float, float],
    radial: float,
) -> FloatArray:
    """Where points on rays are seen after a motion [N, 2]; those behind stay where they are."""
    there = pixels.copy()
    for n in range(len(pixels)):
        x, y, z = _turned(ahead_from_before, rays[n, 0] * depth[n], rays[n, 1] * depth[n], depth[n])
        z += ahead_from_before[2, 3]
        if z > 1e-6:
            x, y = (x + ahead_from_before[0, 3]) / z, (y + ahead_from_before[1, 3]) / z
            there[n, 0], there[n, 1] = pixel(x, y, focal, centre, radial)
    return there


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _shift(rotation: FloatArray, before: FloatArray, now: FloatArray) -> float:
    """Median distance of rays [N, 2] from the turned ones before [N, 2], of those that stay in front; else NaN."""
    distance, count = np.empty(len(now)), 0
    for n in range(len(now)):
        x, y, z = _turned(rotation, before[n, 0], before[n, 1], 1.0)
        if z > 1e-6:
            distance[count] = np.sqrt((now[n, 0] - x / z) ** 2 + (now[n, 1] - y / z) ** 2)
            count += 1
    return np.median(distance[:count]) if count else np.nan


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _spread(rays: FloatArray, cam_from_world: FloatArray) -> FloatArray:
    """How far the rays [K, M, 2] of one point lie apart once turned into one orientation, as an angle [M]."""
    spread, first = np.zeros(rays.shape[1]), np.zeros((rays.shape[1], 3))
    for k in range(len(rays)):
        world_from_cam = cam_from_world[k].T
        for m in range(rays.shape[1]):
            if not np.isfinite(rays[k, m, 0]):
                continue
            x, y, z = _turned(world_from_cam, rays[k, m, 0], rays[k, m, 1], 1.0)
            size = np.sqrt(x * x + y * y + z * z)
            x, y, z = x / size, y / size, z / size
            if not first[m].any():
                first[m, 0], first[m, 1], first[m, 2] = x, y, z
            distance = np.sqrt((x - first[m, 0]) ** 2 + (y - first[m, 1]) ** 2 + (z - first[m, 2]) ** 2)
            spread[m] = max(spread[m], distance)
    return spread


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _turned(rotation: FloatArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector, turned by the matrix's first three rows and columns."""
    return (
        rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
    )
