"""Tracking of one camera image by image: two-view initialisation, resection, keyframes.

Each image is localised by resection in a map of triangulated corners (Klein & Murray 2007;
Mur-Artal et al. 2015). The first keyframes of a map come from two-view geometry, so that every map
has its own unit of length. Poses with one unit form a segment.
"""

from dataclasses import dataclass

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.geometry.two_view import TwoView, TwoViewEstimator
from geovp_classic.odometry.features import CornerTracker
from geovp_classic.odometry.resection import Resection
from geovp_classic.odometry.windowed_map import Keyframe, KeyframePolicy, WindowedMap
from geovp_classic.types import BoolArray, ByteArray, FloatArray, IntArray, Intrinsics


@dataclass(frozen=True)
class TrackerSettings:
    """Methods and settings of a tracker."""

    corners: CornerTracker = CornerTracker()
    keyframes: KeyframePolicy = KeyframePolicy()
    two_view: TwoViewEstimator = TwoViewEstimator()
    resection: Resection = Resection()
    # Corners or inliers that a map is initialised with. Resection needs 12 of them, and up to 40 %
    # are lost before the next keyframe.
    min_start_points: int = 30
    # Inliers of a motion relative to a keyframe: the camera's motion is that of the majority.
    min_start_fraction: float = 0.5
    # Inliers among a reference keyframe's points; with fewer left a new reference is chosen. The
    # same fraction as `CornerTracker.min_predicted_fraction`.
    min_reference_fraction: float = 0.3
    # Parallax that initialises a map from a reference with few points left, in standard deviations
    # of a ray. Depth has a relative error of 1 / 4, as with `KeyframePolicy.min_point_parallax`.
    min_last_chance_parallax: float = 4.0
    # With fewer points found than half, the image is bad, not the map.
    min_found_fraction: float = 0.5
    # Images in a row, before the map is discarded. At 10 Hz, constant velocity that bridges five
    # images is off by 1 m/s^2 * (.5 s)^2 / 2 = .1 m.
    max_bridged: int = 4


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
    is_localised: bool  # tracked, or the first one of a segment
    segment: int
    keyframe: Keyframe
    keyframe_from_cam: FloatArray  # [4, 4]
    waiting: Tracks | None  # of an image that waits for a map


@dataclass(frozen=True)
class TrackedPoses:
    """Poses of consecutive images, in one unit of length per segment."""

    world_from_cam: FloatArray  # [T, 4, 4]
    tracked: BoolArray  # [T]
    is_localised: BoolArray  # [T]; the other poses continue the last motion
    segments: IntArray  # [T], numbers that increase


class Tracker:
    """Poses of one camera, in an arbitrary unit of length per segment.

    Bad images never raise: they are bridged with the last motion.
    """

    def __init__(self, settings: TrackerSettings, camera: Intrinsics) -> None:
        self.settings = settings
        self.map = WindowedMap(camera, settings.corners.noise_px, settings.keyframes)
        self.map.add_keyframe(np.eye(4))
        self.segment = -1  # number of the current one; none before the first image with corners
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
        last = self._last
        if last is None:
            self._bridge_or_restart(image, self._world_from_last)
            return
        # Constant velocity predicts where the camera is now
        elapsed_s = image.time_s - last.time_s
        world_from_cam = self._world_from_last @ se3.exp(self._twist_per_s * elapsed_s)
        tracks = self._localise(last, image, se3.inverse(world_from_cam))
        if tracks is None:
            self._bridge_or_restart(image, world_from_cam)
        else:
            # Before the first translation there are no points: the pose is a rotation, and the
            # tracks wait for a map
            self._num_bridged = 0
            has_map = self.map.triangulated.any()
            self._append(self._world_from_last, waiting=None if has_map else tracks)

    def adjust(self) -> None:
        """Adjust all keyframes of the window, and with them the poses of all its images.

        The last pose, from which tracking continues, follows its keyframe.
        """
        if self.map.is_full:  # is adjusted at each keyframe
            return
        keyframe = self.map.keyframes[-1]
        keyframe_from_last = keyframe.cam_from_world @ self._world_from_last
        self.map.adjust(num_fixed=1)  # changes the keyframe's pose
        self._world_from_last = se3.inverse(keyframe.cam_from_world) @ keyframe_from_last

    def poses(self) -> TrackedPoses:
        """Return the poses of all images that are not forgotten."""
        world_from_cam = [
            se3.inverse(pose.keyframe.cam_from_world) @ pose.keyframe_from_cam
            for pose in self._poses
        ]
        return TrackedPoses(
            np.stack(world_from_cam),
            np.array([pose.tracked for pose in self._poses]),
            np.array([pose.is_localised for pose in self._poses]),
            np.array([pose.segment for pose in self._poses]),
        )

    def forget(self, num_images: int) -> None:
        """Forget the poses of all but the newest images."""
        del self._poses[:-num_images]

    def _localise(self, last: Image, image: Image, predicted: FloatArray) -> Tracks | None:
        """Localise the camera near a predicted cam_from_world [4, 4]."""
        # Track the corners of the last image from where the prediction shows them
        index = np.flatnonzero(self.map.active)
        guess = self.map.predict_pixels(se3.inverse(self._world_from_last), predicted)
        corners = self.settings.corners
        pixels, is_found = corners.track(last.grey, image.grey, self.map.pixels[index], guess)
        # Resection by those that have a point
        has_point = is_found & self.map.triangulated[index]
        points = self.map.points[index[has_point]]
        rays = self.map.rays(pixels[has_point])
        localised = self.settings.resection.resect(points, rays, predicted, self.map.noise)
        if localised is None:
            return self._localise_from_keyframe(image, index[is_found], pixels[is_found])
        cam_from_world, is_inlier = localised
        is_found[has_point] = is_inlier  # outliers of the pose end here
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
        assert self._keyframe is not None
        # A bad image is bridged, and the map stays
        if self._is_bad_image(index):
            return None
        # Without a motion that most tracks share, the image is bridged, too
        in_keyframe = self.map.observed[-1, index]
        index = index[in_keyframe]
        pixels = pixels[in_keyframe]
        motion = self._motion_since_keyframe(index, pixels)
        if motion is None:
            return None
        # A translation with parallax initialises the next map
        min_left = self.settings.min_reference_fraction * self.map.observed[-1].sum()
        few_left = motion.inliers.sum() < min_left
        initialises = motion.has_translation and self._has_parallax(motion, few_left)
        # The map ends, and with it the unit of length
        if self.map.triangulated.any():
            self.map.keep_newest_only()
            self.segment += 1
        # The baseline defines the unit: 1 at first, then as if the speed had not changed. Without
        # a next map the camera only rotates.
        elapsed_s = max(image.time_s - self._keyframe.time_s, 1e-6)
        baseline = 1.0
        if self._speed_per_s is not None:
            baseline = self._speed_per_s * elapsed_s
        cam_from_keyframe = motion.b_from_a.copy()
        cam_from_keyframe[:3, 3] *= baseline if initialises else 0.0
        cam_from_world = cam_from_keyframe @ self.map.keyframes[-1].cam_from_world
        inliers = motion.inliers
        tracks = self._move(image, index[inliers], pixels[inliers], cam_from_world)
        if initialises:
            self._initialise_map(image, cam_from_keyframe, elapsed_s)
        elif few_left:
            self._start_from(image)  # a new reference, for the next motions
        return tracks

    def _is_bad_image(self, index: IntArray) -> bool:
        """Return whether the image is bad and not the map, given the tracks [M] that were found.

        Few tracks of the map were found, or their points contradict it. The map is to blame if
        image after image contradicts it.
        """
        settings = self.settings
        has_map = self.map.triangulated.any()
        if has_map and len(index) < settings.min_found_fraction * self.map.active.sum():
            return True
        is_bridgeable = self._num_bridged < settings.max_bridged
        num_points = self.map.triangulated[index].sum()
        return is_bridgeable and num_points >= settings.resection.min_inliers

    def _motion_since_keyframe(self, index: IntArray, pixels: FloatArray) -> TwoView | None:
        """Estimate two-view motion from the newest keyframe; None with too few inliers."""
        settings = self.settings
        rays_in_keyframe = self.map.rays(self.map.observations[-1, index])
        rays = self.map.rays(pixels)
        motion = settings.two_view.estimate(rays_in_keyframe, rays, self.map.noise)
        min_inliers = max(settings.min_start_points, settings.min_start_fraction * len(index))
        if motion is None or motion.inliers.sum() < min_inliers:
            return None
        return motion

    def _initialise_map(
        self, image: Image, cam_from_keyframe: FloatArray, elapsed_s: float
    ) -> None:
        """Initialise a map with the last localised image, given its motion since the keyframe.

        Earlier images that waited for a map are localised in it.
        """
        # The speed comes from the whole motion, since the last pose was a rotation only
        self._twist_per_s = se3.log(se3.inverse(cam_from_keyframe)) / elapsed_s
        self._add_keyframe(image)
        self._localise_waiting()

    def _has_parallax(self, motion: TwoView, few_left: bool) -> bool:
        """Return whether a motion has enough parallax for a map; less is enough if it is late."""
        min_parallax = self.settings.min_last_chance_parallax * self.map.noise
        if not few_left:
            min_parallax = max(min_parallax, self.settings.keyframes.min_start_parallax)
        return motion.parallax > min_parallax

    def _bridge_or_restart(self, image: Image, world_from_cam: FloatArray) -> None:
        """Continue the motion to an image that was not localised.

        It starts a new map if it is the first image, or if too many have been bridged.
        """
        self._num_bridged += 1
        is_lost = self._num_bridged > self.settings.max_bridged
        starts = (self._last is None or is_lost) and self._restart(image, world_from_cam)
        self._append(world_from_cam, tracked=starts and self._num_bridged == 1, starts=starts)

    def _append(
        self,
        world_from_cam: FloatArray,
        *,
        tracked: bool = True,
        starts: bool = False,  # a segment
        waiting: Tracks | None = None,
    ) -> None:
        """Store the pose of an image relative to the newest keyframe."""
        keyframe = self.map.keyframes[-1]
        pose = RelativePose(
            tracked,
            tracked or starts,
            self.segment,
            keyframe,
            keyframe.cam_from_world @ world_from_cam,
            waiting,
        )
        self._poses.append(pose)

    def _move(
        self,
        image: Image,
        index: IntArray,
        pixels: FloatArray,
        cam_from_world: FloatArray,
    ) -> Tracks:
        """Make this image the last localised one, in which the tracks [M] are at pixels [M, 2]."""
        # All other tracks end
        self.map.pixels[:] = np.nan
        self.map.pixels[index] = pixels
        # The last motion, which predicts the next one
        world_from_cam = se3.inverse(cam_from_world)
        if self._last is not None:
            elapsed_s = max(image.time_s - self._last.time_s, 1e-6)
            last_from_cam = se3.inverse(self._world_from_last) @ world_from_cam
            self._twist_per_s = se3.log(last_from_cam) / elapsed_s
        self._last = image
        self._world_from_last = world_from_cam
        return self.map.track_ids[index], pixels

    def _keyframe_is_due(self) -> bool:
        """Return whether the last image has enough parallax or few of the keyframe's tracks."""
        policy = self.settings.keyframes
        observed = self.map.observed[-1]
        num_shared = (self.map.active & observed).sum()
        parallax = self.map.parallax(se3.inverse(self._world_from_last))
        min_parallax = max(policy.min_parallax, policy.min_parallax_deviations * self.map.noise)
        return bool(
            parallax > min_parallax or num_shared < policy.min_shared_fraction * observed.sum()
        )

    def _add_keyframe(self, image: Image) -> None:
        """Add the last localised image to the map."""
        assert self._keyframe is not None
        policy = self.settings.keyframes
        world = self.map
        cam_from_world = se3.inverse(self._world_from_last)
        moves = world.parallax(cam_from_world) > policy.min_start_parallax
        # Triangulate tracks with the new keyframe, and adjust the window
        world.add_keyframe(cam_from_world)
        before, now = world.keyframes[-2:]
        world.triangulate()
        if world.is_full or (len(world.keyframes) - 1) % policy.adjust_every == 0:
            world.adjust(num_fixed=2 if world.is_full else 1)
        self._world_from_last = se3.inverse(now.cam_from_world)
        # Motion since the keyframe before: for the scale, and for the unit of the next map
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
        # New corners where the image has no tracks
        self._start_tracks(image)

    def _restart(self, image: Image, world_from_cam: FloatArray) -> bool:
        """Start a new segment from an image, and return whether it has enough corners."""
        if len(image.corners) < self.settings.min_start_points:
            return False
        self.map.clear()
        self.segment += 1
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
            # Tracks of the image that now have a point
            ids, pixels = pose.waiting
            pose.waiting = None
            _, observed, index = np.intersect1d(ids, self.map.track_ids, return_indices=True)
            has_point = self.map.triangulated[index]
            points = self.map.points[index[has_point]]
            rays = self.map.rays(pixels[observed[has_point]])
            # Resection near the pose without translation, which stays if this fails
            guess = se3.inverse(pose.keyframe_from_cam) @ pose.keyframe.cam_from_world
            localised = self.settings.resection.resect(points, rays, guess, self.map.noise)
            if localised is not None:
                cam_from_world, _ = localised
                pose.keyframe_from_cam = pose.keyframe.cam_from_world @ se3.inverse(cam_from_world)
