"""A sliding window of keyframes with the points that they observe: what the camera is located
against.
"""

import numpy as np
from scipy.spatial import cKDTree

from geovp_classic.geometry import se3
from geovp_classic.geometry.robust import median
from geovp_classic.geometry.two_view import homogeneous, rotate_rays
from geovp_classic.odometry.bundle import bundle_adjust
from geovp_classic.odometry.lens import Lens
from geovp_classic.odometry.resection import reprojection_errors
from geovp_classic.odometry.triangulation import triangulate
from geovp_classic.types import BoolArray, FloatArray, IntArray

# a point is triangulated once its rays differ by this beyond rotation, in standard deviations
MIN_PARALLAX = 4.0
MAX_REPROJECTION_ERROR = (
    5.0  # an observation with a larger error is discarded, in standard deviations
)
NUM_NEIGHBOURS = 3  # whose mean inverse depth stands in for that of a point not yet triangulated


class WindowedMap:
    """Feature tracks through the last `size` keyframes, and their points where triangulated.

    Arrays share the axis N of all tracks. A track that has ended stays as long as two keyframes of
    the window observe its point, which constrains their poses.
    """

    def __init__(self, lens: Lens, noise_px: float, size: int) -> None:
        """An empty map of at most `size` keyframes, for pixels with this standard deviation."""
        self.lens = lens
        self.noise_px = noise_px
        self.size = size
        self.first_keyframe_id = 0
        self.cam_from_world: FloatArray = np.zeros((0, 4, 4))  # [K, 4, 4]
        self.observations: FloatArray = np.zeros(
            (0, 0, 2)
        )  # [K, N, 2] pixels; NaN where not observed
        self.pixels: FloatArray = np.zeros((0, 2))  # [N, 2] in the last image, of active tracks
        self.active: BoolArray = np.zeros(0, dtype=bool)  # [N], tracked up to the last image
        self.points: FloatArray = np.zeros(
            (0, 3)
        )  # [N, 3] in the world; NaN while not triangulated
        self.track_ids: IntArray = np.zeros(0, dtype=np.int64)  # [N], increasing
        self._num_tracks = 0

    def __len__(self) -> int:
        """K, the number of keyframes."""
        return len(self.cam_from_world)

    @property
    def noise(self) -> float:
        """Standard deviation of a ray's coordinates."""
        return self.noise_px / self.lens.focal_px

    @property
    def observed(self) -> BoolArray:
        """Which keyframe observes which point [K, N]."""
        observed: BoolArray = np.isfinite(self.observations[..., 0])
        return observed

    @property
    def triangulated(self) -> BoolArray:
        """Which tracks have a point [N]."""
        triangulated: BoolArray = np.isfinite(self.points[:, 0])
        return triangulated

    @property
    def reprojection_error(self) -> float:
        """The median reprojection error of the points' observations, in standard deviations;
        infinite without any.
        """
        index = np.flatnonzero(self.triangulated)
        rays = self.lens.rays(self.observations[:, index])
        errors = reprojection_errors(self.points[index], rays, self.cam_from_world)
        known = errors[np.isfinite(errors)]
        return median(known) / self.noise if len(known) else np.inf

    @property
    def newest_keyframe_id(self) -> int:
        """Keyframes are numbered from the start."""
        return self.first_keyframe_id + len(self) - 1

    def add_keyframe(self, cam_from_world: FloatArray) -> None:
        """Make the last image a keyframe; the oldest one leaves a full window."""
        observed = np.where(self.active[:, None], self.pixels, np.nan)
        self.observations = np.concatenate([self.observations, observed[None]])
        self.cam_from_world = np.concatenate([self.cam_from_world, cam_from_world[None]])
        if len(self) > self.size:
            self.observations, self.cam_from_world = self.observations[1:], self.cam_from_world[1:]
            self.first_keyframe_id += 1
        self._keep(self.active | (self.triangulated & (self.observed.sum(axis=0) >= 2)))

    def add_tracks(self, pixels: FloatArray) -> None:
        """Start tracks at new pixels [M, 2] of the newest keyframe."""
        observations = np.full((len(self), len(pixels), 2), np.nan)
        observations[-1] = pixels
        self.observations = np.concatenate([self.observations, observations], axis=1)
        self.pixels = np.concatenate([self.pixels, pixels])
        self.active = np.concatenate([self.active, np.ones(len(pixels), dtype=bool)])
        self.points = np.concatenate([self.points, np.full((len(pixels), 3), np.nan)])
        self.track_ids = np.concatenate([self.track_ids, self._num_tracks + np.arange(len(pixels))])
        self._num_tracks += len(pixels)

    def index_of(self, track_ids: IntArray) -> IntArray:
        """The indices of tracks with these ids [M]; -1 for those that were removed."""
        if len(self.track_ids) == 0:
            return np.full(len(track_ids), -1)
        index = np.minimum(np.searchsorted(self.track_ids, track_ids), len(self.track_ids) - 1)
        return np.where(self.track_ids[index] == track_ids, index, -1)

    def keep_newest_only(self) -> None:
        """Remove all points and all keyframes but the newest; its tracks go on."""
        self.first_keyframe_id = self.newest_keyframe_id
        self.cam_from_world, self.observations = self.cam_from_world[-1:], self.observations[-1:]
        self.points = np.full_like(self.points, np.nan)

    def clear(self) -> None:
        """Remove all keyframes and tracks; numbering goes on."""
        self.first_keyframe_id += len(self)
        self.cam_from_world, self.observations = self.cam_from_world[:0], self.observations[:0]
        self._keep(np.zeros(len(self.points), dtype=bool))

    def triangulate(self) -> None:
        """Triangulate tracks that two keyframes or more observe with enough parallax."""
        index: IntArray = np.flatnonzero(~self.triangulated & (self.observed.sum(axis=0) >= 2))
        if len(index):
            self.points[index] = self._triangulate(index)

    def adjust(self, num_fixed: int, max_points: int) -> None:
        """Bundle adjustment of the window; only the `max_points` with most observations, others are
        triangulated.
        """
        counts = self.observed.sum(axis=0)
        index: IntArray = np.flatnonzero(self.triangulated & (counts >= 2))
        if len(self) <= num_fixed or len(index) < 8 or max_points == 0:
            return
        order = np.argsort(-counts[index], kind="stable")
        chosen, others = index[order[:max_points]], index[order[max_points:]]
        self.cam_from_world, self.points[chosen] = bundle_adjust(
            self.cam_from_world,
            self.points[chosen],
            self.observations[:, chosen],
            self.lens,
            num_fixed,
            self.noise_px,
        )
        if len(others):
            self.points[others] = self._triangulate(others)
        self.cull()

    def cull(self) -> None:
        """Discard observations with large errors, then points with fewer than two left."""
        index: IntArray = np.flatnonzero(self.triangulated)
        observations = self.observations[:, index]
        errors = reprojection_errors(
            self.points[index], self.lens.rays(observations), self.cam_from_world
        )
        outliers = errors > MAX_REPROJECTION_ERROR * self.noise
        self.observations[:, index] = np.where(outliers[..., None], np.nan, observations)
        wrong = index[self.observed[:, index].sum(axis=0) < 2]
        self.points[wrong] = np.nan
        self.active[wrong] = False

    def predict_pixels(
        self, cam_from_world_before: FloatArray, cam_from_world: FloatArray
    ) -> FloatArray:
        """Pixels [M, 2] of the active tracks from a new pose; without a point, neighbours say how
        deep it is.
        """
        index, triangulated = np.flatnonzero(self.active), self.triangulated[self.active]
        pixels, depth = (
            self.pixels[index],
            np.full(len(index), 1e9),
        )  # so far that only rotation shifts them
        points_cam = se3.transform(cam_from_world_before, self.points[index[triangulated]])
        depth[triangulated] = np.maximum(points_cam[:, 2], 1e-3)
        if triangulated.sum() >= NUM_NEIGHBOURS and not triangulated.all():
            nearest = cKDTree(pixels[triangulated]).query(pixels[~triangulated], k=NUM_NEIGHBOURS)[
                1
            ]
            depth[~triangulated] = 1 / (1 / depth[triangulated])[nearest].mean(axis=1)
        ahead_from_before = cam_from_world @ se3.inverse(cam_from_world_before)
        ahead = se3.transform(
            ahead_from_before, homogeneous(self.lens.rays(pixels)) * depth[:, None]
        )
        in_front = ahead[:, 2:] > 1e-6
        return np.where(
            in_front, self.lens.pixels(ahead[:, :2] / np.where(in_front, ahead[:, 2:], 1.0)), pixels
        )

    def parallax(self, cam_from_world: FloatArray) -> float:
        """Median shift on z = 1 of the active tracks since the newest keyframe, beyond what
        rotation explains.
        """
        shared = self.active & self.observed[-1]
        if not shared.any():
            return 0.0
        rotation = (cam_from_world @ se3.inverse(self.cam_from_world[-1]))[:3, :3]
        rotated = rotate_rays(rotation, self.lens.rays(self.observations[-1, shared]))
        shift = np.linalg.norm(self.lens.rays(self.pixels[shared]) - rotated, axis=1)
        return median(shift[np.isfinite(shift)]) if np.isfinite(shift).any() else np.nan

    def _triangulate(self, index: IntArray) -> FloatArray:
        """Points [M, 3]; NaN where parallax is missing, the error is large or the point is behind a
        camera.
        """
        rays = self.lens.rays(self.observations[:, index])
        points = triangulate(rays, self.cam_from_world)
        errors = reprojection_errors(points, rays, self.cam_from_world)
        fits = (errors < MAX_REPROJECTION_ERROR * self.noise) | np.isnan(rays[..., 0])
        good = fits.all(axis=0) & (
            max_parallax(rays, self.cam_from_world) > MIN_PARALLAX * self.noise
        )
        return np.where(good[:, None], points, np.nan)

    def _keep(self, mask: BoolArray) -> None:
        self.observations, self.pixels, self.points = (
            self.observations[:, mask],
            self.pixels[mask],
            self.points[mask],
        )
        self.active, self.track_ids = self.active[mask], self.track_ids[mask]


def max_parallax(rays: FloatArray, cam_from_world: FloatArray) -> FloatArray:
    """The largest angle [M] between the first ray of each point and its others; rays [K, M, 2] with
    NaN for none.
    """
    rotation = cam_from_world[
        :, :3, :3, None
    ]  # its rows turn directions into the world: [K, 3, M] there
    directions = (
        rays[:, None, :, 0] * rotation[:, 0] + rays[:, None, :, 1] * rotation[:, 1] + rotation[:, 2]
    )
    directions /= np.sqrt((directions**2).sum(axis=1, keepdims=True))
    first = np.take_along_axis(
        directions, np.isfinite(rays[..., 0]).argmax(axis=0)[None, None], axis=0
    )
    return np.asarray(np.nan_to_num(np.sqrt(((directions - first) ** 2).sum(axis=1))).max(axis=0))
