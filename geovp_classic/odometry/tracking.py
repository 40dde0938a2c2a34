"""Track one camera image by image: two-view initialisation, localisation in a sliding map, bundle
adjustment.
"""

from dataclasses import dataclass, replace

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.geometry.two_view import two_view
from geovp_classic.odometry.features import NOISE_PX, CornerTracker
from geovp_classic.odometry.lens import Lens
from geovp_classic.odometry.relative_poses import MIN_INLIERS, Observations, RelativePoses
from geovp_classic.odometry.resection import resect
from geovp_classic.odometry.self_calibration import RadialEstimate
from geovp_classic.odometry.windowed_map import WindowedMap
from geovp_classic.types import BoolArray, ByteArray, FloatArray

MIN_INLIER_SHARE = 0.4
MIN_START_POINTS = 30
MIN_START_SHARE = 0.5
MIN_SHARED = (
    0.3  # of the reference keyframe's points; with fewer inliers left, a new reference is taken
)
MIN_FOUND_SHARE = 0.5  # of the points; with fewer found the image is bad rather than the map
MAX_BRIDGED = 4  # images in a row, before the map is discarded
COAST_S = 1.0  # after the map is lost, a moving camera is not taken to stand still for this long


@dataclass(frozen=True)
class KeyframePolicy:
    """How often keyframes are made, and how many are kept and adjusted together."""

    window: int = 8
    keyframe_parallax: float = (
        0.025  # median shift since the last keyframe after the rotation is taken out, on z = 1
    )
    start_parallax: float = 0.004  # the same between the two images that a map starts from
    keyframe_share: float = 0.6  # a keyframe is due when fewer of the last one's points are left
    max_bundle_points: int = 300
    adjust_every: int = 1  # keyframes from one bundle adjustment to the next


@dataclass(frozen=True)
class KeyframePair:
    """The last two keyframes."""

    before: ByteArray  # [H, W]
    now: ByteArray  # [H, W]
    before_from_now: FloatArray  # [4, 4]
    radial: float  # current estimate of `Lens.radial`


class Tracker:
    """Poses of one camera, in a unit of its own; bad images are bridged with the last motion and
    never raise.
    """

    def __init__(
        self, corners: CornerTracker, lens: Lens, policy: KeyframePolicy, seed: int
    ) -> None:
        self.corners, self.policy, self.seed = corners, policy, seed
        self.map = WindowedMap(lens, NOISE_PX, policy.window)
        self.radial = RadialEstimate(lens.radial)
        self.world_from_cam: FloatArray = np.eye(4)  # of the last image, localised or bridged
        self.num_starts = 0  # how often a map was started; each has a unit of length of its own
        self.new_pair: KeyframePair | None = None  # when the last image became a keyframe of a map
        self._keyframe_grey: ByteArray | None = None
        self._last_grey: ByteArray | None = None  # the last image that was localised
        self._world_from_last: FloatArray = np.eye(4)
        self._twist_per_s: FloatArray = np.zeros(6)
        self._speed_per_s: float | None = None  # the last one that was not zero
        self._time_s, self._last_s, self._keyframe_s = 0.0, 0.0, 0.0
        self._corners: FloatArray | None = None  # of the last image
        self._coast_until_s = -np.inf
        self._num_bridged = 0
        self._poses = RelativePoses(self.map)

    def push(self, grey: ByteArray, time_s: float, corners: FloatArray | None = None) -> bool:
        """Take the next image [H, W]; whether its pose, now `world_from_cam`, was tracked rather
        than bridged.

        `corners` are those of `features.all_corners`, where they are known already.
        """
        predicted = self.world_from_cam @ se3.exp(self._twist_per_s * (time_s - self._time_s))
        self._time_s, self.new_pair, self._corners = time_s, None, corners
        observations = self._localise(grey, predicted) if len(self.map) else None
        tracked = observations is not None
        self._num_bridged = 0 if tracked else self._num_bridged + 1
        if not tracked:
            self.world_from_cam = predicted
            if len(self.map) == 0 or self._num_bridged > MAX_BRIDGED:
                tracked = self._restart(grey) and self._num_bridged == 1
        self._poses.add(self.world_from_cam, tracked, observations)
        return tracked

    def take_final(self, *, all_of_them: bool = False) -> tuple[FloatArray, BoolArray]:
        """Poses [T, 4, 4] and marks [T] of the images since the last call that later ones cannot
        change.
        """
        if all_of_them:
            self._poses.finish(self.map.newest_keyframe_id + 1)
        return self._poses.take_final()

    def adjust_all(self) -> None:
        """One more bundle adjustment of the whole window, with only the first keyframe fixed."""
        self.map.adjust(1, self.policy.max_bundle_points)

    def _localise(self, grey: ByteArray, predicted: FloatArray) -> Observations | None:
        """Localise the camera in the map, else relative to the newest keyframe alone."""
        assert self._last_grey is not None
        index = np.flatnonzero(self.map.active)
        guess = self.map.predict_pixels(se3.inverse(self._world_from_last), se3.inverse(predicted))
        pixels, found = self.corners.track(self._last_grey, grey, self.map.pixels[index], guess)
        observations = Observations(self.map.track_ids[index], pixels, found)
        return self._localise_by_map(grey, observations, predicted) or self._localise_by_keyframe(
            grey, observations
        )

    def _localise_by_map(
        self, grey: ByteArray, observations: Observations, predicted: FloatArray
    ) -> Observations | None:
        index = self.map.index_of(observations.track_ids)
        known = observations.inliers & self.map.triangulated[index]
        if known.sum() < MIN_INLIERS:
            return None
        points, rays = self.map.points[index[known]], self.map.lens.rays(observations.pixels[known])
        cam_from_world, inliers = resect(
            points, rays, se3.inverse(predicted), self.map.noise, self.seed
        )
        if inliers.sum() < MIN_INLIERS or inliers.mean() < MIN_INLIER_SHARE:
            return None
        good = observations.inliers.copy()
        good[known] = inliers
        observations = replace(observations, inliers=good)
        self._move(grey, observations, cam_from_world)
        if self._keyframe_is_due():
            self._add_keyframe()
        return observations

    def _localise_by_keyframe(
        self, grey: ByteArray, observations: Observations
    ) -> Observations | None:
        """Two-view motion since the newest keyframe: none, a rotation, or one that starts a new
        map.
        """
        has_map = self.map.triangulated.any()
        if has_map and observations.inliers.mean() < MIN_FOUND_SHARE:
            return None
        keyframe_pixels = self.map.observations[-1, self.map.index_of(observations.track_ids)]
        shared = observations.inliers & np.isfinite(keyframe_pixels[:, 0])
        rays, rays_now = (
            self.map.lens.rays(pixels[shared]) for pixels in (keyframe_pixels, observations.pixels)
        )
        motion = two_view(rays, rays_now, self.map.noise, self.seed)
        if motion.inliers.sum() < MIN_START_POINTS or motion.inliers.mean() < MIN_START_SHARE:
            return None
        few_left = motion.inliers.sum() < MIN_SHARED * self.map.observed[-1].sum()
        min_parallax = max(0.0 if few_left else self.policy.start_parallax, 4 * self.map.noise)
        starts = motion.kind == "general" and motion.parallax > min_parallax
        if not starts and not has_map and self._time_s < self._coast_until_s:
            return None
        good = observations.inliers & shared
        good[shared] = motion.inliers
        observations = replace(observations, inliers=good)
        if has_map:
            self._poses.finish(self.map.newest_keyframe_id)
            self.map.keep_newest_only()
        cam_from_keyframe = motion.b_from_a.copy()
        cam_from_keyframe[:3, 3] *= self._baseline() if starts else 0.0
        self._move(grey, observations, cam_from_keyframe @ self.map.cam_from_world[-1])
        if starts:
            self.num_starts += 1
            elapsed_s = max(self._time_s - self._keyframe_s, 1e-6)
            self._twist_per_s = se3.log(se3.inverse(cam_from_keyframe)) / elapsed_s
            self._add_keyframe()
            self._poses.localise_waiting(self.seed)
        elif few_left:
            self._new_reference()
        return observations

    def _baseline(self) -> float:
        """The length given to the first motion of a new map: that of the last speed, else 1."""
        return (
            1.0
            if self._speed_per_s is None
            else self._speed_per_s * (self._time_s - self._keyframe_s)
        )

    def _move(
        self, grey: ByteArray, observations: Observations, cam_from_world: FloatArray
    ) -> None:
        """Make this image the last localised one, from which points are tracked."""
        index = self.map.index_of(observations.track_ids)
        self.map.pixels[index], self.map.active[index] = observations.pixels, observations.inliers
        world_from_cam = se3.inverse(cam_from_world)
        elapsed_s = max(self._time_s - self._last_s, 1e-6)
        self._twist_per_s = se3.log(se3.inverse(self._world_from_last) @ world_from_cam) / elapsed_s
        self._last_grey, self._last_s = grey, self._time_s
        self._world_from_last = self.world_from_cam = world_from_cam

    def _keyframe_is_due(self) -> bool:
        observed = self.map.observed[-1]
        share = (self.map.active & observed).sum() / max(1, int(observed.sum()))
        parallax = self.map.parallax(se3.inverse(self.world_from_cam))
        min_parallax = max(self.policy.keyframe_parallax, 3 * self.map.noise)
        return bool(parallax > min_parallax or share < self.policy.keyframe_share)

    def _add_keyframe(self) -> None:
        """Add the last localised image to the map, triangulate, adjust, and detect new points."""
        assert self._last_grey is not None
        if len(self.map) == self.map.size:
            self._poses.finish(self.map.first_keyframe_id + 1)
        moves = self.map.parallax(se3.inverse(self.world_from_cam)) > self.policy.start_parallax
        self.map.add_keyframe(se3.inverse(self.world_from_cam))
        self._calibrate()
        self.map.triangulate()
        if self.map.newest_keyframe_id % self.policy.adjust_every == 0:
            self.map.adjust(
                2 if len(self.map) == self.map.size else 1, self.policy.max_bundle_points
            )
        self._world_from_last = self.world_from_cam = se3.inverse(self.map.cam_from_world[-1])
        self._detect()
        before_from_now = self.map.cam_from_world[-2] @ self.world_from_cam
        if moves:
            self._speed_per_s = float(np.linalg.norm(before_from_now[:3, 3])) / (
                self._time_s - self._keyframe_s
            )
            self._coast_until_s = self._time_s + COAST_S
        assert self._keyframe_grey is not None
        self.new_pair = KeyframePair(
            self._keyframe_grey, self._last_grey, before_from_now, self.radial.mean
        )
        self._keyframe_grey, self._keyframe_s = self._last_grey, self._time_s

    def _calibrate(self) -> None:
        """Update the lens by the last two keyframes."""
        shared = self.map.observed[-2:].all(axis=0)
        rays_a, rays_b = self.map.lens.distorted_rays(self.map.observations[-2:, shared])
        now_from_before = self.map.cam_from_world[-1] @ se3.inverse(self.map.cam_from_world[-2])
        self.radial = self.radial.updated(rays_a, rays_b, now_from_before, self.map.noise)
        self.map.lens = replace(self.map.lens, radial=self.radial.mean)

    def _restart(self, grey: ByteArray) -> bool:
        """Start anew from this image; whether it has enough corners."""
        corners = self.corners.detect(grey, np.zeros((0, 2)), self._corners)
        if len(corners) < MIN_START_POINTS:
            return False
        self._poses.finish(self.map.newest_keyframe_id + 1)
        self.map.clear()
        self.map.add_keyframe(se3.inverse(self.world_from_cam))
        self.map.add_tracks(corners)
        self._last_grey = self._keyframe_grey = grey
        self._last_s = self._keyframe_s = self._time_s
        self._world_from_last = self.world_from_cam
        return True

    def _new_reference(self) -> None:
        """Make the last localised image the keyframe that a map may start from; waiting images
        refer to it.
        """
        waiting = self._poses.take_waiting()
        self._poses.finish(self.map.newest_keyframe_id + 1)
        self.map.add_keyframe(se3.inverse(self.world_from_cam))
        self.map.keep_newest_only()
        self._detect()
        self._keyframe_grey, self._keyframe_s = self._last_grey, self._time_s
        for one in waiting:
            self._poses.add(*one)

    def _detect(self) -> None:
        """Start tracks at new corners of the last localised image, which is the newest keyframe."""
        assert self._last_grey is not None
        occupied = self.map.pixels[self.map.active]
        self.map.add_tracks(self.corners.detect(self._last_grey, occupied, self._corners))
