"""The ground plane, fitted in inverse depth, where every plane is linear in the image."""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.geometry import pinhole
from geovp_classic.types import BoolArray, FloatArray, Intrinsics

NUM_TRIALS = 80
NUM_ROUNDS = 4
STRIDE_PX = 4  # of the pixels of the lower half that are used
CLOSE = 0.05  # relative difference of inverse depths that counts as on the plane
MIN_SHARE = 0.2  # of the lower half that must lie on it
MIN_UPRIGHT = 0.9  # cosine between its normal and the camera's y axis
FLOATING_HEIGHTS = (0.3, 1.5)  # camera heights above the road between which no object floats
LEVEL_HEIGHTS = 4.0  # camera heights: up to this distance a road is a plane
HORIZON_HEIGHTS = 20.0  # camera heights: ground farther away is not changed


@dataclass(frozen=True)
class GroundPlane:
    """The plane normal . point = height in the camera's frame, y down."""

    normal: FloatArray  # [3], unit length, pointing down
    height: float  # of the camera above it, in the poses' unit

    def inverse_depth(self, camera: Intrinsics) -> FloatArray:
        """Inverse depth [H, W] float32 of the plane; negative above its horizon."""
        return (pinhole.rays(camera) @ self.normal / self.height).astype(np.float32)

    def confidence(
        self,
        inverse_depth: FloatArray,  # [H, W] of the plane
    ) -> FloatArray:
        """Confidence [H, W] that the road lies on the plane; 0 above the horizon.

        It is 1 up to LEVEL_HEIGHTS and falls with the square of the distance beyond.
        """
        nearness: FloatArray = np.clip(LEVEL_HEIGHTS * self.height * inverse_depth, 0, 1)
        return nearness**2


def fit_ground(
    inverse_depth: FloatArray,  # [H, W]
    camera: Intrinsics,
    seed: int = 0,
) -> GroundPlane | None:
    """The plane that most of the image's lower half lies on (RANSAC, then least squares); None
    without such a one.
    """
    half = camera.height_px // 2
    rays = pinhole.rays(camera)[half::STRIDE_PX, ::STRIDE_PX].reshape(-1, 3)
    found = inverse_depth[half::STRIDE_PX, ::STRIDE_PX].reshape(-1).astype(np.float64)
    triples = np.random.default_rng(seed).integers(0, len(found), (NUM_TRIALS, 3))
    corners = rays[triples]
    solvable = np.abs(np.linalg.det(corners)) > 1e-6
    planes = np.linalg.solve(corners[solvable], found[triples][solvable][..., None])[
        ..., 0
    ]  # normal / height
    planes = planes[_upright(planes)]
    if not len(planes):
        return None
    plane = planes[np.argmax(_on_plane(planes, rays, found).sum(axis=1))]
    for _ in range(NUM_ROUNDS):
        weight = _on_plane(plane[None], rays, found)[0] / np.maximum(
            rays @ plane, 1e-12
        )  # relative errors
        plane = np.linalg.lstsq(rays * weight[:, None], found * weight, rcond=None)[0]
    if not _upright(plane[None])[0] or _on_plane(plane[None], rays, found).mean() < MIN_SHARE:
        return None
    size = float(np.linalg.norm(plane))
    return GroundPlane(plane / size, 1 / size)


def clamp_to_ground(
    inverse_depth: FloatArray,  # [H, W]
    ground: GroundPlane,
    camera: Intrinsics,
    allowed: BoolArray,  # [H, W]; where the images do not contradict the ground
) -> FloatArray:
    """The inverse depth [H, W] with no surface below the ground, where `allowed`."""
    plane = ground.inverse_depth(camera)
    near = plane * ground.height > 1 / HORIZON_HEIGHTS
    return np.where(near & allowed & (inverse_depth < plane), plane, inverse_depth)


def floating_mask(
    inverse_depth: FloatArray,  # [H, W]
    ground: GroundPlane,
    camera: Intrinsics,
    islands: BoolArray,  # [H, W], surfaces that are cut off from all around
) -> BoolArray:
    """Which islands [H, W] float low over the road: wrong matches, or objects that come towards the
    camera.

    Oncoming objects shift along epipolar lines like nearer static ones, so that their foot seems to
    float.
    """
    height = ground.height
    above = 1 - height * ground.inverse_depth(camera) / np.maximum(
        height * inverse_depth, 1e-9
    )  # in camera heights
    count, labels = cv2.connectedComponents(islands.astype(np.uint8), connectivity=4)
    floating = np.zeros(islands.shape, dtype=bool)
    for label in range(1, count):
        island = labels == label
        lowest, highest = np.percentile(above[island], (10, 90))
        if FLOATING_HEIGHTS[0] < lowest and highest < FLOATING_HEIGHTS[1]:
            floating |= island
    return floating


def _upright(planes: FloatArray) -> BoolArray:
    """Which planes [N, 3] the camera stands upright above."""
    upright: BoolArray = planes[:, 1] > np.maximum(
        MIN_UPRIGHT * np.linalg.norm(planes, axis=1), 1e-12
    )
    return upright


def _on_plane(planes: FloatArray, rays: FloatArray, found: FloatArray) -> BoolArray:
    """Which points [M] lie on which planes [N], nearer than the horizon: [N, M].

    Farther points would draw the plane to the foot of upright objects.
    """
    expected = planes @ rays.T
    near = expected * HORIZON_HEIGHTS > np.linalg.norm(planes, axis=1, keepdims=True)
    on_plane: BoolArray = near & (np.abs(expected - found) < CLOSE * expected)
    return on_plane
