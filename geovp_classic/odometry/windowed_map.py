"""Sliding window of keyframes with the points that they observe."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole, se3
from geovp_classic.geometry.bundle_adjustment import bundle_adjust
from geovp_classic.geometry.two_view import homogeneous, parallax
from geovp_classic.odometry.triangulation import reprojection_errors, triangulate
from geovp_classic.types import BoolArray, FloatArray, IntArray, Intrinsics


@dataclass(frozen=True)
class KeyframePolicy:
    """Choice of keyframes, and of the points that are triangulated and adjusted with them."""

    # Keyframes of a sequence; a clip is adjusted as a whole. At 1 m per keyframe, that is as far as
    # the near points of a road are visible.
    window: int = 16
    # Median shift on z = 1 since the last keyframe, beyond rotation, that makes a new one: 18 px at
    # KITTI's 720 px of focal length, about one image at 1 m per image. In a clip, every image of
    # a moving camera is a keyframe.
    min_parallax: float = 0.025
    min_clip_parallax: float = 0.001
    # It is at least this many standard deviations of a ray: noise exceeds them once in 370 tracks.
    min_parallax_deviations: float = 3.0
    # Between the two images that initialise a map: 3 px at KITTI's focal length, 12 standard
    # deviations of a pixel, so that the depths of most points are known to about a tenth.
    min_start_parallax: float = 0.004
    # Of the last keyframe's tracks; a new keyframe is due when fewer are left. The next image then
    # still shares more than the 30 % that `TrackerSettings.min_reference_fraction` asks for.
    min_shared_fraction: float = 0.6
    # Those with most observations: 300 points in all keyframes are 9,600 equations for 996
    # unknowns, and time is linear in them. 0: no bundle adjustment (docs/results/parts.md).
    max_bundle_points: int = 300
    # Keyframes between bundle adjustments, until the window is full. A clip is adjusted at its end
    # again; once in between keeps its predictions good.
    adjust_every: int = 1
    adjust_every_in_clip: int = 5
    # Each of at least two cameras has six unknowns, each point adds four equations with three.
    min_bundle_points: int = 8
    # Of a triangulated point's rays, in standard deviations: its depth is known to a quarter.
    min_point_parallax: float = 4.0
    # Of an observation, in standard deviations, as `Resection.max_inlier_error`.
    max_reprojection_error: float = 5.0

    def __post_init__(self) -> None:
        if self.window < 3:
            raise BadData(f"window is {self.window}: expected at least 3 keyframes")

    def for_clip(self, num_images: int) -> KeyframePolicy:
        """Return the policy for a clip, which is adjusted as a whole."""
        return replace(
            self,
            window=num_images + 2,  # never full
            min_parallax=self.min_clip_parallax,
            adjust_every=self.adjust_every_in_clip,
        )


@dataclass
class Keyframe:
    """An image of the map, whose pose improves until it leaves the window."""

    cam_from_world: FloatArray  # [4, 4]


class WindowedMap:
    """Corner tracks through the last keyframes, and their points where triangulated.

    Arrays share the axis N of all tracks. A track that has ended stays as long as two keyframes of
    the window observe its point, which constrains their poses.
    """

    def __init__(self, camera: Intrinsics, noise_px: float, policy: KeyframePolicy) -> None:
        self.camera = camera
        self.noise_px = noise_px  # standard deviation of a pixel's coordinates
        self.policy = policy
        self.keyframes: list[Keyframe] = []  # K
        self.observations: FloatArray = np.zeros((0, 0, 2))  # [K, N, 2] pixels; NaN: not observed
        self.pixels: FloatArray = np.zeros((0, 2))  # [N, 2] in the last image; NaN: ended
        self.points: FloatArray = np.zeros((0, 3))  # [N, 3] in the world; NaN: not triangulated
        self.track_ids: IntArray = np.zeros(0, dtype=np.int64)  # [N]
        self._num_tracks = 0

    @property
    def is_full(self) -> bool:
        """Return whether the next keyframe replaces the oldest one."""
        return len(self.keyframes) == self.policy.window

    @property
    def noise(self) -> float:
        """Return the standard deviation of a ray's coordinates."""
        return self.noise_px / self.camera.fx_px

    def rays(self, pixels: FloatArray) -> FloatArray:
        """Return the rays [..., 2] at z = 1 of pixels [..., 2]."""
        return pinhole.normalised(pixels, self.camera)

    @property
    def observed(self) -> BoolArray:
        """Return which keyframe observes which track [K, N]."""
        return np.isfinite(self.observations[..., 0])

    @property
    def triangulated(self) -> BoolArray:
        """Return which tracks have a point [N]."""
        return np.isfinite(self.points[:, 0])

    @property
    def active(self) -> BoolArray:
        """Return which tracks reach the last image [N]."""
        return np.isfinite(self.pixels[:, 0])

    @property
    def cam_from_world(self) -> FloatArray:
        """Return the poses [K, 4, 4] of the keyframes."""
        return np.stack([keyframe.cam_from_world for keyframe in self.keyframes])

    def add_keyframe(self, cam_from_world: FloatArray) -> None:
        """Make the last image a keyframe; the oldest one leaves a full window."""
        if self.is_full:
            self._drop_oldest(1)
        # The tracks' pixels in the last image are the observations of the new keyframe
        self.observations = np.concatenate([self.observations, self.pixels[None]])
        self.keyframes.append(Keyframe(cam_from_world))
        # Ended tracks stay while two keyframes observe their point
        self._keep(self.active | (self.triangulated & (self.observed.sum(axis=0) >= 2)))

    def add_tracks(self, pixels: FloatArray) -> None:
        """Start tracks at new pixels [M, 2] of the newest keyframe."""
        count = len(pixels)
        observations = np.full((len(self.keyframes), count, 2), np.nan)
        observations[-1] = pixels
        ids = self._num_tracks + np.arange(count)
        self.observations = np.concatenate([self.observations, observations], axis=1)
        self.pixels = np.concatenate([self.pixels, pixels])
        self.points = np.concatenate([self.points, np.full((count, 3), np.nan)])
        self.track_ids = np.concatenate([self.track_ids, ids])
        self._num_tracks += count

    def keep_newest_only(self) -> None:
        """Remove all points and all keyframes but the newest; its tracks continue."""
        self._drop_oldest(len(self.keyframes) - 1)
        self.points[:] = np.nan

    def clear(self) -> None:
        """Remove all keyframes and tracks."""
        self._drop_oldest(len(self.keyframes))
        self._keep(np.zeros(len(self.points), bool))

    def triangulate(self) -> None:
        """Triangulate tracks that two or more keyframes observe with enough parallax."""
        is_new = ~self.triangulated & (self.observed.sum(axis=0) >= 2)
        self.points[is_new] = self._triangulate(np.flatnonzero(is_new))

    def adjustable(self) -> IntArray:
        """Return the points with two observations or more, those with most first."""
        num_observations = self.observed.sum(axis=0)
        index = np.flatnonzero(self.triangulated & (num_observations >= 2))
        return index[np.argsort(-num_observations[index], kind="stable")]

    def adjust(self, num_fixed: int) -> None:
        """Adjust all keyframes but the first ones, and the points with most observations.

        The other points are triangulated again.
        """
        adjusted, others = np.split(self.adjustable(), [self.policy.max_bundle_points])
        if len(self.keyframes) <= num_fixed or len(adjusted) < self.policy.min_bundle_points:
            return
        # Minimise the robust reprojection errors over poses and points
        poses, points = bundle_adjust(
            self.cam_from_world,
            self.points[adjusted],
            self.observations[:, adjusted],
            self.camera,
            num_fixed,
            self.noise_px,
        )
        for keyframe, pose in zip(self.keyframes, poses, strict=True):
            keyframe.cam_from_world = pose
        self.points[adjusted] = points
        # The other points follow the poses
        self.points[others] = self._triangulate(others)
        self.cull()

    def cull(self) -> None:
        """Discard observations with large errors, then points with fewer than two left."""
        is_outlier = self._is_outlier(self.points, self.observations)
        self.observations[is_outlier] = np.nan
        # A point needs two observations; without it, its track ends as well
        outliers = self.triangulated & (self.observed.sum(axis=0) < 2)
        self.points[outliers] = np.nan
        self.pixels[outliers] = np.nan

    def predict_pixels(self, last_from_world: FloatArray, cam_from_world: FloatArray) -> FloatArray:
        """Return the pixels [M, 2] of the active tracks in a new image.

        A track without a point is as far away as its three neighbours in the image.
        """
        # Depths of the tracks in the last image
        pixels = self.pixels[self.active]
        points = se3.transform(last_from_world, self.points[self.active])
        depth: FloatArray = np.maximum(points[:, 2], 1e-3)
        has_depth = np.isfinite(depth)
        # Inverse depth is interpolated: on a plane, it is linear in the image
        if has_depth.sum() >= 3:
            _, neighbours = cKDTree(pixels[has_depth]).query(pixels[~has_depth], k=3)
            inverse_depth = 1 / depth[has_depth]
            depth[~has_depth] = 1 / inverse_depth[neighbours].mean(axis=1)
        else:
            depth[:] = 1e9  # only rotation shifts them
        # Move the points into the new camera and project them
        points = pinhole.unproject(pixels, depth, self.camera)
        cam_from_last = cam_from_world @ se3.inverse(last_from_world)
        points = se3.transform(cam_from_last, points)
        predicted, depth = pinhole.project(points, self.camera)
        return np.where(depth[:, None] > 1e-6, predicted, pixels)

    def parallax(self, cam_from_world: FloatArray) -> float:
        """Return the median shift on z = 1 of tracks since the newest keyframe, beyond rotation."""
        cam_from_keyframe = cam_from_world @ se3.inverse(self.keyframes[-1].cam_from_world)
        rays_keyframe = self.rays(self.observations[-1])
        shift = parallax(cam_from_keyframe, rays_keyframe, self.rays(self.pixels))
        shift = shift[np.isfinite(shift)]
        return float(np.median(shift)) if len(shift) else 0.0

    def _triangulate(self, index: IntArray) -> FloatArray:
        """Return points [M, 3]; NaN without parallax or with an error that is too large."""
        # Linear triangulation from all keyframes that observe a track
        observations = self.observations[:, index]
        rays = self.rays(observations)
        points = triangulate(rays, self.cam_from_world)
        # Its rays must agree, and meet at an angle that determines the depth
        is_outlier = self._is_outlier(points, observations)
        is_near = largest_parallax(rays, self.cam_from_world) > (
            self.policy.min_point_parallax * self.noise
        )
        is_good = is_near & ~is_outlier.any(axis=0)
        return np.where(is_good[:, None], points, np.nan)

    def _is_outlier(self, points: FloatArray, observations: FloatArray) -> BoolArray:
        """Return which observations [K, M] have large errors; there may be none of some points."""
        errors = reprojection_errors(points, self.rays(observations), self.cam_from_world)
        return errors > self.policy.max_reprojection_error * self.noise

    def _drop_oldest(self, count: int) -> None:
        self.keyframes = self.keyframes[count:]
        self.observations = self.observations[count:]

    def _keep(self, mask: BoolArray) -> None:
        self.observations = self.observations[:, mask]
        self.pixels = self.pixels[mask]
        self.points = self.points[mask]
        self.track_ids = self.track_ids[mask]


def largest_parallax(rays: FloatArray, cam_from_world: FloatArray) -> FloatArray:
    """Return the largest chord [M] between the first ray of each point and its others.

    Rays [K, M, 2] are NaN where a keyframe does not observe a point.
    """
    directions = homogeneous(rays) @ cam_from_world[:, :3, :3]  # in the world
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    first_keyframe = np.isfinite(rays[..., 0]).argmax(axis=0)
    first = directions[first_keyframe, np.arange(rays.shape[1])]
    chord = np.linalg.norm(directions - first, axis=-1)
    return np.nan_to_num(chord).max(axis=0)
