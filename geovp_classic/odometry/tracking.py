"""Follow one camera image by image: two-view start, location on a sliding map, bundle adjustment at keyframes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.geometry.two_view import two_view
from geovp_classic.odometry.features import FrontEnd, Look
from geovp_classic.odometry.lens import Lens
from geovp_classic.odometry.resection import resect
from geovp_classic.odometry.self_calibration import RadialEstimate
from geovp_classic.odometry.windowed_map import IndexArray, WindowedMap
from geovp_classic.types import BoolArray, ByteArray, FloatArray

MIN_INLIERS = 12
MIN_INLIER_SHARE = 0.4
MIN_START_POINTS = 30
MIN_START_SHARE = 0.5
MIN_LEFT_SHARE = 0.3  # of the points that a map may start from; with fewer left, new ones are taken
MIN_FOUND_SHARE = 0.5  # of the points, to believe that the map is wrong rather than the image
MAX_MISSED = 4  # images in a row that may be bridged before the map is given up
MAX_UNSETTLED = 60  # images whose poses may still change
COAST_S = 1.0  # for so long after a lost map, nobody believes that a moving camera suddenly stands


@dataclass(frozen=True)
class Pace:
    """How often keyframes are made, and how many are kept and adjusted together."""

    window: int = 8
    keyframe_parallax: float = 0.025  # median shift since the last keyframe that rotation leaves unexplained, on z = 1
    start_parallax: float = 0.004  # the same between the two images that a map starts from
    keyframe_share: float = 0.6  # a keyframe is due when fewer of the last one's points are left
    max_bundle_points: int = 300
    adjust_every: int = 1  # keyframes from one bundle adjustment to the next


@dataclass
class Record:
    """One image's pose as motion from a keyframe, so that it improves when the keyframe does."""

    serial: int  # of the keyframe
    keyframe_from_cam: FloatArray  # [4, 4]
    tracked: bool


@dataclass(frozen=True)
class KeyframePair:
    """The last two keyframes."""

    before: ByteArray  # [H, W]
    now: ByteArray  # [H, W]
    before_from_now: FloatArray  # [4, 4]
    radial: float  # of the lens, as believed now


@dataclass(frozen=True)
class Sight:
    """Where the followed points went in one image."""

    ids: IndexArray  # [M]
    pixels: FloatArray  # [M, 2]
    good: BoolArray  # [M]


class Tracker:
    """Poses of one camera in a world of its own unit; on hard images it bridges and says so, and never raises."""

    def __init__(self, front: FrontEnd, lens: Lens, pace: Pace, seed: int) -> None:
        """A tracker that has seen nothing yet."""
        self.front, self.pace, self.seed = front, pace, seed
        self.map = WindowedMap(lens, front.noise_px, pace.window)
        self.radial = RadialEstimate(lens.radial)
        self.world_from_cam: FloatArray = np.eye(4)  # of the last image, located or bridged
        self.num_starts = 0  # how often a map was started; each has a unit of length of its own
        self.new_pair: KeyframePair | None = None  # when the last image became a keyframe of a map
        self._keyframe_grey: ByteArray | None = None
        self._look: Look | None = None  # the last image that was located
        self._world_from_look: FloatArray = np.eye(4)
        self._twist_per_s: FloatArray = np.zeros(6)
        self._speed_per_s: float | None = None  # the last one that was not zero
        self._time_s, self._look_s, self._keyframe_s = 0.0, 0.0, 0.0
        self._coast_until_s = -np.inf
        self._missed = 0
        self._records: list[Record] = []
        self._waiting: list[tuple[Record, Sight]] = []
        self._settled: list[tuple[FloatArray, bool]] = []

    def push(self, grey: ByteArray, time_s: float) -> bool:
        """Take the next image [H, W]; whether its pose, now `world_from_cam`, was tracked rather than bridged."""
        look = self.front.look(grey)
        predicted = self.world_from_cam @ se3.exp(self._twist_per_s * (time_s - self._time_s))
        self._time_s, self.new_pair = time_s, None
        sight = self._located(look, predicted) if len(self.map) else None
        tracked = sight is not None
        self._missed = 0 if tracked else self._missed + 1
        if not tracked:
            self.world_from_cam = predicted
            if len(self.map) == 0 or self._missed > MAX_MISSED:
                tracked = self._begin(look) and self._missed == 1
        self._record(sight, tracked)
        return tracked

    def take_settled(self, *, all_of_them: bool = False) -> tuple[FloatArray, BoolArray]:
        """Poses [T, 4, 4] and marks [T] of the images since the last call that later ones cannot change."""
        if all_of_them:
            self._settle(self.map.newest_serial + 1)
        settled, self._settled = self._settled, []
        poses = np.array([pose for pose, _ in settled]).reshape(-1, 4, 4)
        return poses, np.array([tracked for _, tracked in settled], dtype=bool)

    def adjust_all(self) -> None:
        """One more bundle adjustment of the whole window, with only the first keyframe fixed."""
        self.map.adjust(1, self.pace.max_bundle_points)

    def _located(self, look: Look, predicted: FloatArray) -> Sight | None:
        """Locate the camera by the map, else by the newest keyframe alone."""
        assert self._look is not None
        index = np.flatnonzero(self.map.followed)
        guess = self.map.predicted(se3.inverse(self._world_from_look), se3.inverse(predicted))
        pixels, found = self.front.follow(self._look, look, self.map.pixels[index], guess)
        sight = Sight(self.map.ids[index], pixels, found)
        return self._by_map(look, sight, predicted) or self._by_keyframe(look, sight)

    def _by_map(self, look: Look, sight: Sight, predicted: FloatArray) -> Sight | None:
        index = self.map.index_of(sight.ids)
        known = sight.good & self.map.known[index]
        if known.sum() < MIN_INLIERS:
            return None
        cam_from_world, inliers = resect(
            self.map.points[index[known]],
            self.map.lens.rays(sight.pixels[known]),
            se3.inverse(predicted),
            self.map.noise,
            self.seed,
        )
        if inliers.sum() < MIN_INLIERS or inliers.mean() < MIN_INLIER_SHARE:
            return None
        good = sight.good.copy()
        good[known] = inliers
        sight = replace(sight, good=good)
        self._move(look, sight, cam_from_world)
        if self._keyframe_is_due():
            self._keyframe()
        return sight

    def _by_keyframe(self, look: Look, sight: Sight) -> Sight | None:
        """Stand or turn since the newest keyframe, or start a new map from it and this image."""
        map_was_good = self.map.known.any()
        if map_was_good and sight.good.mean() < MIN_FOUND_SHARE:
            return None
        seen = self.map.seen[-1, self.map.index_of(sight.ids)]
        shared = sight.good & np.isfinite(seen[:, 0])
        rays, rays_now = self.map.lens.rays(seen[shared]), self.map.lens.rays(sight.pixels[shared])
        motion = two_view(rays, rays_now, self.map.noise, self.seed)
        if motion.inliers.sum() < MIN_START_POINTS or motion.inliers.mean() < MIN_START_SHARE:
            return None
        few_left = motion.inliers.sum() < MIN_LEFT_SHARE * np.isfinite(self.map.seen[-1, :, 0]).sum()
        enough = 4 * self.map.noise if few_left else max(self.pace.start_parallax, 4 * self.map.noise)
        starts = motion.kind == "general" and motion.parallax > enough
        if not starts and not map_was_good and self._time_s < self._coast_until_s:
            return None
        good = sight.good & shared
        good[shared] = motion.inliers
        sight = replace(sight, good=good)
        if map_was_good:
            self._settle(self.map.newest_serial)
            self.map.keep_newest_only()
        cam_from_keyframe = motion.b_from_a.copy()
        cam_from_keyframe[:3, 3] *= self._baseline() if starts else 0.0
        self._move(look, sight, cam_from_keyframe @ self.map.cam_from_world[-1])
        if starts:
            self.num_starts += 1
            elapsed_s = max(self._time_s - self._keyframe_s, 1e-6)
            self._twist_per_s = se3.log(se3.inverse(cam_from_keyframe)) / elapsed_s
            self._keyframe()
            self._locate_waiting()
        elif few_left:
            self._new_reference()
        return sight

    def _baseline(self) -> float:
        """The length given to the first motion of a new map: the last speed goes on, else 1."""
        return 1.0 if self._speed_per_s is None else self._speed_per_s * (self._time_s - self._keyframe_s)

    def _move(self, look: Look, sight: Sight, cam_from_world: FloatArray) -> None:
        """The image is located; its points are followed from here."""
        index = self.map.index_of(sight.ids)
        self.map.pixels[index], self.map.followed[index] = sight.pixels, sight.good
        world_from_cam = se3.inverse(cam_from_world)
        elapsed_s = max(self._time_s - self._look_s, 1e-6)
        self._twist_per_s = se3.log(se3.inverse(self._world_from_look) @ world_from_cam) / elapsed_s
        self._look, self._look_s = look, self._time_s
        self._world_from_look = self.world_from_cam = world_from_cam

    def _keyframe_is_due(self) -> bool:
        seen = np.isfinite(self.map.seen[-1, :, 0])
        share = (self.map.followed & seen).sum() / max(1, int(seen.sum()))
        parallax = self.map.parallax(se3.inverse(self.world_from_cam))
        enough = max(self.pace.keyframe_parallax, 3 * self.map.noise)
        return bool(parallax > enough or share < self.pace.keyframe_share)

    def _keyframe(self) -> None:
        """Keep the last located image, place what can be placed now, adjust, and look for new points."""
        assert self._look is not None
        if len(self.map) == self.map.size:
            self._settle(self.map.first_serial + 1)
        moves = self.map.parallax(se3.inverse(self.world_from_cam)) > self.pace.start_parallax
        self.map.insert(se3.inverse(self.world_from_cam))
        self._calibrate()
        self.map.place()
        if self.map.newest_serial % self.pace.adjust_every == 0:
            self.map.adjust(2 if len(self.map) == self.map.size else 1, self.pace.max_bundle_points)
        self._world_from_look = self.world_from_cam = se3.inverse(self.map.cam_from_world[-1])
        self.map.add(self.front.fresh(self._look, self.map.pixels[self.map.followed]))
        before_from_now = self.map.cam_from_world[-2] @ self.world_from_cam
        if moves:
            self._speed_per_s = float(np.linalg.norm(before_from_now[:3, 3])) / (self._time_s - self._keyframe_s)
            self._coast_until_s = self._time_s + COAST_S
        assert self._keyframe_grey is not None
        self.new_pair = KeyframePair(self._keyframe_grey, self._look.grey, before_from_now, self.radial.mean)
        self._keyframe_grey, self._keyframe_s = self._look.grey, self._time_s

    def _calibrate(self) -> None:
        """Let the last two keyframes say what they can about the lens."""
        shared = np.isfinite(self.map.seen[-2:, :, 0]).all(axis=0)
        seen_a, seen_b = self.map.lens.seen_rays(self.map.seen[-2:, shared])
        now_from_before = self.map.cam_from_world[-1] @ se3.inverse(self.map.cam_from_world[-2])
        self.radial = self.radial.updated(seen_a, seen_b, now_from_before, self.map.noise)
        self.map.lens = replace(self.map.lens, radial=self.radial.mean)

    def _begin(self, look: Look) -> bool:
        """Start anew from this image, when it shows anything."""
        fresh = self.front.fresh(look, np.zeros((0, 2)))
        if len(fresh) < MIN_START_POINTS:
            return False
        self._settle(self.map.newest_serial + 1)
        self.map.clear()
        self.map.insert(se3.inverse(self.world_from_cam))
        self.map.add(fresh)
        self._look, self._look_s, self._keyframe_s = look, self._time_s, self._time_s
        self._keyframe_grey = look.grey
        self._world_from_look = self.world_from_cam
        return True

    def _new_reference(self) -> None:
        """Take the last located image as the keyframe that a map may start from; waiting images go on waiting."""
        assert self._look is not None
        waiting = {id(record) for record, _ in self._waiting}
        poses = [(record, self._pose(record)) for record in self._records if id(record) in waiting]
        self._records = [record for record in self._records if id(record) not in waiting]
        self._settle(self.map.newest_serial + 1)
        self.map.insert(se3.inverse(self.world_from_cam))
        self.map.keep_newest_only()
        self.map.add(self.front.fresh(self._look, self.map.pixels[self.map.followed]))
        self._keyframe_grey, self._keyframe_s = self._look.grey, self._time_s
        for record, pose in poses:
            record.serial, record.keyframe_from_cam = self.map.newest_serial, self.map.cam_from_world[-1] @ pose
            self._records.append(record)

    def _locate_waiting(self) -> None:
        """Images between the two that a map started from get their place on it."""
        for record, sight in self._waiting:
            index = self.map.index_of(sight.ids)
            use = sight.good & (index >= 0)
            use[use] = self.map.known[index[use]]
            keyframe = self.map.cam_from_world[record.serial - self.map.first_serial]
            guess = se3.inverse(record.keyframe_from_cam) @ keyframe
            rays = self.map.lens.rays(sight.pixels[use])
            pose, inliers = resect(self.map.points[index[use]], rays, guess, self.map.noise, self.seed)
            if inliers.sum() >= MIN_INLIERS:
                record.keyframe_from_cam = keyframe @ se3.inverse(pose)
        self._waiting = []

    def _record(self, sight: Sight | None, tracked: bool) -> None:
        if len(self.map) == 0:
            self._settled.append((self.world_from_cam, tracked))
            return
        record = Record(self.map.newest_serial, self.map.cam_from_world[-1] @ self.world_from_cam, tracked)
        self._records.append(record)
        if sight is not None and not self.map.known.any():
            self._waiting.append((record, sight))
        while len(self._records) > MAX_UNSETTLED:  # the camera stands, and no keyframe comes
            self._settle_first()

    def _settle(self, serial: int) -> None:
        """Images that hang on keyframes before this serial number are final."""
        while self._records and self._records[0].serial < serial:
            self._settle_first()

    def _settle_first(self) -> None:
        record = self._records.pop(0)
        self._settled.append((self._pose(record), record.tracked))
        self._waiting = [(other, sight) for other, sight in self._waiting if other is not record]

    def _pose(self, record: Record) -> FloatArray:
        """world_from_cam [4, 4] as known now."""
        keyframe = self.map.cam_from_world[max(0, record.serial - self.map.first_serial)]
        return se3.inverse(keyframe) @ record.keyframe_from_cam
