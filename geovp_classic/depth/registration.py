"""Poses that the pictures agree with: given poses, improved until tracked corners meet, in the unit they came in.

Recorded poses can be wrong by more than a pixel from one frame to the next (GPS and gyroscopes are smooth over
hundreds of metres, not over ten), and a plane sweep needs a quarter of one. Corners of one reference picture are
followed to the others (Lucas & Kanade 1981; there and back again), and poses and inverse depths of the corners are
adjusted together (bundle adjustment, Triggs 2000), held by the given poses where the corners say nothing: those alone
know how long a metre is.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.depth.matching import TALL_PX
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import BoolArray, FloatArray, Intrinsics

MAX_CORNERS = 400  # in a square picture
MIDDLE = 1.6  # widths of the square; poses that fit corners farther out, too, fit what is shown less well
CORNER_QUALITY = 0.01
CORNER_SPACING = 0.025  # of the picture's height
WINDOW_PX = 15  # in pictures of up to TALL_PX rows; proportionally more in taller ones
RETURN_PX = 0.5  # a track is kept while following it back ends this near to where it came from
MIN_CORNERS = 30  # seen by at least one other frame; with fewer the given poses stay
ROBUST_PX = 0.5  # errors of this size count half (Cauchy)
# Poses are right to within these standard deviations or far off: all departures together count by Cauchy's function,
# so that poses the pictures agree with stay, and those that they contradict by pixels are let go.
ROTATION_RAD = 1.7e-4
SHIFT_SHARE = 7e-4  # of the distance from the reference
TRUST = 30.0  # squared departures beyond which given poses lose their hold
NUM_ROUNDS = 8
START_DAMPING = 1e-3
NEAR = 1e-3
DIRECTION_SHARE = 0.2  # of the longest distance from the reference; shorter ones have no sure direction
PERSISTENCE = 0.8  # of the directions' error that is expected of the future, too


@dataclass(frozen=True)
class Tracks:
    """Corners of a reference picture in all pictures."""

    pixels: FloatArray  # [P, N, 2]
    seen: BoolArray  # [P, N]


@dataclass(frozen=True)
class Registration:
    """Poses that fit the pictures, and how the given ones' directions of motion were turned against theirs."""

    world_from_cam: FloatArray  # [P, 4, 4]
    steering: FloatArray  # [3, 3], turns the given directions of motion, in the reference camera's frame


def registered(
    pictures: FloatArray,  # [P, H, W] float32 grey 0..255
    camera: Intrinsics,
    world_from_cam: FloatArray,  # [P, 4, 4]
    reference: int,
) -> Registration:
    """The poses after adjustment; that of the reference stays, and all do where too little is seen."""
    others = np.array([step for step in range(len(pictures)) if step != reference], dtype=int)
    source_from_reference = se3.inverse(world_from_cam[others]) @ world_from_cam[reference]
    if not (np.linalg.norm(source_from_reference[:, :3, 3], axis=1) > 0).any():
        return Registration(world_from_cam, np.eye(3))
    tracks = track(pictures, reference)
    kept = tracks.seen[others].any(axis=0)
    if kept.sum() < MIN_CORNERS:
        return Registration(world_from_cam, np.eye(3))
    rays = pinhole.unproject(tracks.pixels[reference, kept], np.ones(kept.sum()), camera)
    corners = Corners(rays, tracks.pixels[others][:, kept], tracks.seen[others][:, kept], camera, source_from_reference)
    reference_from_source = se3.inverse(adjust(corners))
    better = world_from_cam.copy()
    better[others] = world_from_cam[reference] @ reference_from_source
    return Registration(better, steering(se3.inverse(source_from_reference), reference_from_source))


def steering(
    given: FloatArray,  # [S, 4, 4], reference from source
    better: FloatArray,  # [S, 4, 4]
) -> FloatArray:
    """The rotation [3, 3] that the better directions of motion have against the given ones, as far as it will last.

    A recorded camera that looks a degree beside where it says it looks, or a height that drifts, turns every direction
    alike, the coming ones too.
    """
    was, now = given[:, :3, 3], better[:, :3, 3]
    length, length_now = np.linalg.norm(was, axis=1), np.linalg.norm(now, axis=1)
    sure = (length > DIRECTION_SHARE * length.max()) & (length_now > 0)
    if not sure.any():
        return np.eye(3)
    turns = np.cross(was[sure], now[sure]) / (length * length_now)[sure, None]
    return se3.exp(np.concatenate([np.zeros(3), PERSISTENCE * turns.mean(axis=0)]))[:3, :3]


def track(
    pictures: FloatArray,  # [P, H, W]
    reference: int,
) -> Tracks:
    """Corners in the middle of the reference picture, followed frame by frame, back and forth, until they are lost."""
    grey = [np.ascontiguousarray(picture.astype(np.uint8)) for picture in pictures]
    height, width = grey[reference].shape
    wideness = float(np.clip(width / height, 1, MIDDLE))
    margin = max(0, round((width - MIDDLE * height) / 2))
    middle = np.zeros((height, width), np.uint8)
    middle[:, margin : width - margin] = 255
    count, spacing_px = int(MAX_CORNERS * wideness), CORNER_SPACING * height
    corners = cv2.goodFeaturesToTrack(grey[reference], count, CORNER_QUALITY, spacing_px, mask=middle)
    start = np.zeros((0, 2), np.float32) if corners is None else np.asarray(corners, np.float32).reshape(-1, 2)
    pixels = np.tile(start, (len(pictures), 1, 1))
    seen = np.zeros(pixels.shape[:2], dtype=bool)
    seen[reference] = True
    for steps in (range(reference - 1, -1, -1), range(reference + 1, len(pictures))):
        before = reference
        for step in steps:
            pixels[step], seen[step] = _follow(grey[before], grey[step], pixels[before], seen[before])
            before = step
    return Tracks(pixels.astype(np.float64), seen)


def _follow(before: FloatArray, after: FloatArray, pixels: FloatArray, seen: BoolArray) -> tuple[FloatArray, BoolArray]:
    if not seen.any():
        return pixels, seen
    side = int(WINDOW_PX * max(1, len(before) / TALL_PX)) | 1  # odd
    window = (side, side)
    there, found, _ = cv2.calcOpticalFlowPyrLK(before, after, pixels, pixels.copy(), winSize=window)
    back, returned, _ = cv2.calcOpticalFlowPyrLK(after, before, there, pixels.copy(), winSize=window)
    close = np.linalg.norm(back - pixels, axis=-1) < RETURN_PX
    return np.asarray(there), seen & close & (np.asarray(found)[:, 0] > 0) & (np.asarray(returned)[:, 0] > 0)


@dataclass(frozen=True)
class Corners:
    """What is adjusted to: corners of the reference in the other frames."""

    rays: FloatArray  # [N, 3], z = 1, in the reference
    pixels: FloatArray  # [S, N, 2]
    seen: BoolArray  # [S, N]
    camera: Intrinsics
    given: FloatArray  # [S, 4, 4], source from reference

    def errors(self, inverse_depth: FloatArray, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Reprojection errors [S, N, 2] in units of ROBUST_PX and points over their depth [S, N, 3]."""
        points = self.rays @ np.swapaxes(poses[:, :3, :3], -1, -2) + inverse_depth[:, None] * poses[:, None, :3, 3]
        there, _ = pinhole.project(np.where(self._valid(points), points, [0.0, 0.0, 1.0]), self.camera)
        off = np.where(self._valid(points), there - self.pixels, 0.0)
        return off / ROBUST_PX, points

    def _valid(self, points: FloatArray) -> BoolArray:
        return np.asarray(self.seen & (points[..., 2] > NEAR))[..., None]

    def departure(self, poses: FloatArray) -> FloatArray:
        """How far the poses have left the given ones [S, 6], in standard deviations."""
        return se3.log(poses @ se3.inverse(self.given)) * self.precision

    @property
    def precision(self) -> FloatArray:
        """One over the standard deviations of the given poses [S, 6]."""
        distance = np.linalg.norm(self.given[:, :3, 3], axis=1)
        shift = SHIFT_SHARE * np.maximum(distance, SHIFT_SHARE * distance.max())
        return np.concatenate([np.tile(1 / shift[:, None], 3), np.full((len(shift), 3), 1 / ROTATION_RAD)], axis=1)

    def cost(self, inverse_depth: FloatArray, poses: FloatArray) -> float:
        """The sum to be made small: Cauchy's function of the errors, and the squared departure."""
        off, _ = self.errors(inverse_depth, poses)
        return float(
            np.log1p((off**2).sum(axis=-1)).sum() + TRUST * np.log1p((self.departure(poses) ** 2).sum() / TRUST)
        )


def adjust(corners: Corners) -> FloatArray:
    """The poses [S, 4, 4] of least cost (Levenberg 1944, Marquardt 1963)."""
    poses, damping = corners.given, START_DAMPING
    inverse_depth = _triangulated(corners)
    cost = corners.cost(inverse_depth, poses)
    for _ in range(NUM_ROUNDS):
        twists, deeper = _step(corners, inverse_depth, poses, damping)
        trial_poses, trial_depth = se3.exp(twists) @ poses, np.maximum(inverse_depth + deeper, 0)
        trial_cost = corners.cost(trial_depth, trial_poses)
        damping = damping / 5 if trial_cost < cost else damping * 10
        if trial_cost < cost:
            poses, inverse_depth, cost = trial_poses, trial_depth, trial_cost
    return poses


def _triangulated(corners: Corners) -> FloatArray:
    """Inverse depths [N] from the given poses: (u, v) (a_z + q b_z) = (a + q b)_xy solved for q, at least 0."""
    matrix = corners.camera.matrix
    a = corners.rays @ np.swapaxes(matrix @ corners.given[:, :3, :3], -1, -2)  # [S, N, 3]
    b = (corners.given[:, :3, 3] @ matrix.T)[:, None]
    factor = (corners.pixels * b[..., 2:] - b[..., :2]) * corners.seen[..., None]
    wanted = a[..., :2] - corners.pixels * a[..., 2:]
    square = (factor**2).sum(axis=(0, 2))
    return np.maximum((factor * wanted).sum(axis=(0, 2)) / np.maximum(square, 1e-12), 0)


def _step(
    corners: Corners, inverse_depth: FloatArray, poses: FloatArray, damping: float
) -> tuple[FloatArray, FloatArray]:
    """Twists [S, 6] of the poses and changes [N] of the inverse depths; these are eliminated (Schur complement)."""
    off, points = corners.errors(inverse_depth, poses)
    count = len(poses)
    weight = corners._valid(points)[..., 0] / (1 + (off**2).sum(axis=-1))  # [S, N]
    by_twist, by_depth = _derivatives(corners, points, inverse_depth, poses)
    h_twist = np.einsum("sn,snki,snkj->sij", weight, by_twist, by_twist)
    held = 1 / (1 + (corners.departure(poses) ** 2).sum() / TRUST)
    h_twist += held * np.stack([np.diag(p) for p in corners.precision**2])
    h_twist[:, range(6), range(6)] *= 1 + damping
    h_depth = np.einsum("sn,snk,snk->n", weight, by_depth, by_depth) * (1 + damping) + 1e-12
    mixed = np.einsum("sn,snki,snk->nsi", weight, by_twist, by_depth).reshape(-1, 6 * count)
    g_twist = np.einsum("sn,snki,snk->si", weight, by_twist, off) + held * corners.precision * corners.departure(poses)
    g_depth = np.einsum("sn,snk,snk->n", weight, by_depth, off)
    whole = -(mixed / h_depth[:, None]).T @ mixed
    for s in range(count):
        whole[6 * s : 6 * s + 6, 6 * s : 6 * s + 6] += h_twist[s]
    twists = np.linalg.solve(whole, mixed.T @ (g_depth / h_depth) - g_twist.ravel())
    return twists.reshape(count, 6), -(g_depth + mixed @ twists) / h_depth


def _derivatives(
    corners: Corners, points: FloatArray, inverse_depth: FloatArray, poses: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Of the errors: by the poses' twists (from the left) [S, N, 2, 6], and by the inverse depths [S, N, 2]."""
    x, y, z = np.moveaxis(points, -1, 0)
    z = np.maximum(z, NEAR)
    fx, fy = corners.camera.fx_px / ROBUST_PX / z, corners.camera.fy_px / ROBUST_PX / z
    zero = np.zeros_like(z)
    by_point = np.stack([fx, zero, -fx * x / z, zero, fy, -fy * y / z], axis=-1).reshape(*z.shape, 2, 3)
    by_shift = by_point * inverse_depth[:, None, None]
    by_rotation = -by_point @ se3.cross_matrix(points)
    by_depth = (by_point @ poses[:, None, :3, 3:])[..., 0]
    return np.concatenate([by_shift, by_rotation], axis=-1), by_depth
