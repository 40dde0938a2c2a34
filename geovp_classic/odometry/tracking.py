"""Tracking of one camera image by image: two-view initialisation, resection, keyframes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.geometry.two_view import TwoViewEstimator
from geovp_classic.odometry.features import CornerTracker
from geovp_classic.odometry.resection import Resection
from geovp_classic.odometry.windowed_map import (
    Keyframe,
    KeyframePolicy,
    WindowedMap,
)
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    FloatArray,
    IntArray,
    Intrinsics,
)


@dataclass(frozen=True)
class Tracking:
    """Methods and settings of a tracker."""

    corners: CornerTracker = CornerTracker()
    keyframes: KeyframePolicy = KeyframePolicy()
    two_view: TwoViewEstimator = TwoViewEstimator()
    resection: Resection = Resection()
    # corners or inliers that a map is initialised with
    min_start_points: int = 30
    # inliers of a motion relative to a keyframe
    min_start_fraction: float = 0.5
    # inliers among a reference keyframe's points; with fewer left a new reference is chosen
    min_reference_fraction: float = 0.3
    # with fewer points found, the image is bad, not the map
    min_found_fraction: float = 0.5
    max_bridged: int = 4  # images in a row, before the map is discarded


@dataclass(frozen=True)
class Image:
    """An image with its corners."""

    grey: ByteArray  # [H, W]
    corners: FloatArray  # [M, 2], of `CornerTracker.detect`
    time_s: float


Tracks = tuple[IntArray, FloatArray]  # identifiers [M] and pixels [M, 2]


@dataclass
class RelativePose:
    """Pose of an image relative to a keyframe, which improves with it."""

    tracked: bool
    keyframe: Keyframe
    keyframe_from_cam: FloatArray  # [4, 4]
    waiting: Tracks | None  # of an image that waits for a map


def track_clip(settings: Tracking, images: Sequence[Image], camera: Intrinsics) -> "Tracker":
    """Track the images of a clip with keyframes that stay for its bundle adjustment."""
    keyframes = settings.keyframes.for_clip(len(images))
    tracker = Tracker(replace(settings, keyframes=keyframes), camera)
    for image in images:
        tracker.push(image)
    return tracker


class Tracker:
    """Poses of one camera, in an arbitrary unit of length.

    Bad images never raise: they are bridged with the last motion.
    """

    def __init__(self, settings: Tracking, camera: Intrinsics) -> None:
        self.settings = settings
        self.map = WindowedMap(camera, settings.corners.noise_px, settings.keyframes)
        self.map.add_keyframe(np.eye(4))
        self.num_starts = 0  # maps so far; each has its own unit of length
        # the last two keyframes' images and their motion before_from_now [4, 4]
        self.new_pair: tuple[ByteArray, ByteArray, FloatArray] | None = None
        self._poses: list[RelativePose] = []
        self._last: Image | None = None  # last localised image
        self._world_from_last: FloatArray = np.eye(4)
        self._twist_per_s: FloatArray = np.zeros(6)
        self._keyframe: Image | None = None  # newest one
        self._speed_per_s: float | None = None  # last one of a moving camera
        self._num_bridged = 0

    def push(self, image: Image) -> None:
        """Localise the next image in the map, else from the newest keyframe, or bridge it."""
        self.new_pair = None
        world_from_cam = self._world_from_last
        tracks = None
        if self._last is not None:
            elapsed_s = image.time_s - self._last.time_s
            step = se3.exp(self._twist_per_s * elapsed_s)
            world_from_cam = world_from_cam @ step
            predicted = se3.inverse(world_from_cam)
            tracks = self._localise(self._last, image, predicted)
        tracked = tracks is not None
        if tracked:
            self._num_bridged = 0
            world_from_cam = self._world_from_last
        else:
            self._num_bridged += 1
            is_lost = self._num_bridged > self.settings.max_bridged
            if self._last is None or is_lost:
                has_corners = self._restart(image, world_from_cam)
                tracked = has_corners and self._num_bridged == 1
        keyframe = self.map.keyframes[-1]
        keyframe_from_cam = keyframe.cam_from_world @ world_from_cam
        waiting = None if self.map.triangulated.any() else tracks
        self._poses.append(RelativePose(tracked, keyframe, keyframe_from_cam, waiting))

    def poses(self) -> tuple[FloatArray, BoolArray]:
        """Return world_from_cam [T, 4, 4] and marks of tracked images [T]."""
        world_from_cam = [
            se3.inverse(pose.keyframe.cam_from_world) @ pose.keyframe_from_cam
            for pose in self._poses
        ]
        return np.stack(world_from_cam), np.array([pose.tracked for pose in self._poses])

    def forget(self, num_images: int) -> None:
        """Forget the poses of all but the newest images."""
        del self._poses[:-num_images]

    def _localise(self, last: Image, image: Image, predicted: FloatArray) -> Tracks | None:
        """Localise the camera near a predicted cam_from_world [4, 4] by the points of the map."""
        index = np.flatnonzero(self.map.active)
        guess = self.map.predict_pixels(se3.inverse(self._world_from_last), predicted)
        corners = self.settings.corners
        pixels, is_found = corners.track(last.grey, image.grey, self.map.pixels[index], guess)
        has_point = is_found & self.map.triangulated[index]
        points = self.map.points[index[has_point]]
        rays = self.map.rays(pixels[has_point])
        localised = self.settings.resection.resect(points, rays, predicted, self.map.noise)
        if localised is None:
            return self._localise_from_keyframe(image, index[is_found], pixels[is_found])
        cam_from_world, is_found[has_point] = localised
        tracks = self._move(image, index[is_found], pixels[is_found], cam_from_world)
        if self._keyframe_is_due():
            self._add_keyframe(image)
        return tracks

    def _localise_from_keyframe(
        self, image: Image, index: IntArray, pixels: FloatArray
    ) -> Tracks | None:
        """Localise the camera by two-view motion since the newest keyframe.

        It needs the indices [M] and pixels [M, 2] of tracks that were found. A motion with enough
        parallax initialises a new map.
        """
        settings = self.settings
        world = self.map
        has_map = world.triangulated.any()
        min_found = settings.min_found_fraction * world.active.sum()
        if has_map and len(index) < min_found:
            return None
        in_keyframe = world.observed[-1, index]
        index = index[in_keyframe]
        pixels = pixels[in_keyframe]
        motion = settings.two_view.estimate(
            world.rays(world.observations[-1, index]),
            world.rays(pixels),
            world.noise,
        )
        min_fraction = settings.min_start_fraction
        min_inliers = max(settings.min_start_points, min_fraction * len(index))
        if motion is None or motion.inliers.sum() < min_inliers:
            return None
        inliers = motion.inliers
        num_reference = world.observed[-1].sum()
        min_left = settings.min_reference_fraction * num_reference
        few_left = inliers.sum() < min_left
        min_parallax = 4 * world.noise
        if not few_left:
            policy = settings.keyframes
            min_parallax = max(min_parallax, policy.min_start_parallax)
        initialises = motion.parallax > min_parallax
        initialises &= motion.has_translation
        if has_map:
            world.keep_newest_only()
        assert self._keyframe is not None
        elapsed_s = max(image.time_s - self._keyframe.time_s, 1e-6)
        baseline = 1.0  # of the first map
        if self._speed_per_s is not None:
            baseline = self._speed_per_s * elapsed_s
        cam_from_keyframe = motion.b_from_a.copy()
        cam_from_keyframe[:3, 3] *= baseline if initialises else 0.0
        cam_from_world = cam_from_keyframe @ world.keyframes[-1].cam_from_world
        tracks = self._move(image, index[inliers], pixels[inliers], cam_from_world)
        if initialises:
            self.num_starts += 1
            twist = se3.log(se3.inverse(cam_from_keyframe))
            self._twist_per_s = twist / elapsed_s
            self._add_keyframe(image)
            self._localise_waiting()
        elif few_left:
            self._start_from(image)
        return tracks

    def _move(
        self,
        image: Image,
        index: IntArray,
        pixels: FloatArray,
        cam_from_world: FloatArray,
    ) -> Tracks:
        """Make this image the last localised one, in which the tracks [M] are at pixels [M, 2]."""
        self.map.pixels[:] = np.nan
        self.map.pixels[index] = pixels
        world_from_cam = se3.inverse(cam_from_world)
        if self._last is not None:
            elapsed_s = max(image.time_s - self._last.time_s, 1e-6)
            last_from_cam = se3.inverse(self._world_from_last) @ world_from_cam
            self._twist_per_s = se3.log(last_from_cam) / elapsed_s
        self._last = image
        self._world_from_last = world_from_cam
        return self.map.track_ids[index], pixels

    def _keyframe_is_due(self) -> bool:
        policy = self.settings.keyframes
        observed = self.map.observed[-1]
        num_shared = (self.map.active & observed).sum()
        parallax = self.map.parallax(se3.inverse(self._world_from_last))
        return bool(
            parallax > max(policy.min_parallax, 3 * self.map.noise)
            or num_shared < policy.min_shared_fraction * observed.sum()
        )

    def _add_keyframe(self, image: Image) -> None:
        """Add the last localised image to the map, triangulate, adjust, and detect."""
        assert self._keyframe is not None
        policy = self.settings.keyframes
        world = self.map
        cam_from_world = se3.inverse(self._world_from_last)
        moves = world.parallax(cam_from_world) > policy.min_start_parallax
        world.add_keyframe(cam_from_world)
        before, now = world.keyframes[-2:]  # which are adjusted below
        world.triangulate()
        if world.is_full or (len(world.keyframes) - 1) % policy.adjust_every == 0:
            world.adjust(num_fixed=2 if world.is_full else 1)
        self._world_from_last = se3.inverse(now.cam_from_world)
        before_from_now = before.cam_from_world @ self._world_from_last
        if moves:
            distance = float(np.linalg.norm(before_from_now[:3, 3]))
            elapsed_s = image.time_s - self._keyframe.time_s
            self._speed_per_s = distance / elapsed_s
        self.new_pair = (
            self._keyframe.grey,
            image.grey,
            before_from_now,
        )
        self._start_tracks(image)

    def _restart(self, image: Image, world_from_cam: FloatArray) -> bool:
        """Start a new map from an image, and return whether it has enough corners."""
        if len(image.corners) < self.settings.min_start_points:
            return False
        self.map.clear()
        self._last = image
        self._world_from_last = world_from_cam
        self._start_from(image)
        return True

    def _start_from(self, image: Image) -> None:
        """Make the last localised image the keyframe that a map may be initialised from."""
        self.map.add_keyframe(se3.inverse(self._world_from_last))
        self.map.keep_newest_only()
        self._start_tracks(image)

    def _start_tracks(self, image: Image) -> None:
        """Start tracks at new corners of the newest keyframe."""
        self._keyframe = image
        occupied = self.map.pixels[self.map.active]
        self.map.add_tracks(self.settings.corners.select(image.corners, occupied, image.grey))

    def _localise_waiting(self) -> None:
        """Localise earlier images in a map that was just initialised."""
        for pose in self._poses:
            if pose.waiting is None:
                continue
            ids, pixels = pose.waiting
            pose.waiting = None
            _, observed, index = np.intersect1d(ids, self.map.track_ids, return_indices=True)
            has_point = self.map.triangulated[index]
            points = self.map.points[index[has_point]]
            rays = self.map.rays(pixels[observed[has_point]])
            guess = se3.inverse(pose.keyframe_from_cam) @ pose.keyframe.cam_from_world
            localised = self.settings.resection.resect(points, rays, guess, self.map.noise)
            if localised is not None:
                pose.keyframe_from_cam = pose.keyframe.cam_from_world @ se3.inverse(localised[0])
