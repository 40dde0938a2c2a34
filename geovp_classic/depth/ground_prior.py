"""Ground prior of a plane sweep: the road is a plane, and nothing lies below it."""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.depth.aggregation import SumArray, excess_cost
from geovp_classic.geometry.ground_plane import GroundFit, GroundPlane
from geovp_classic.types import BoolArray, FloatArray, Intrinsics


@dataclass(frozen=True)
class GroundPrior:
    """No surface lies below the ground plane, unless the images contradict it."""

    # Largest extra cost of a near road over the best depth, for a surface below the road.
    max_excess_cost: float = 40.0
    # Camera heights up to which a road is level. Beyond, the allowed cost falls with the square of
    # the distance.
    level_heights: float = 4.0
    # Islands of depth up to this part of the image are removed where they float over the road.
    max_floating_fraction: float = 0.027
    # Camera heights above the road between which no object floats.
    min_floating_heights: float = 0.3
    max_floating_heights: float = 1.5
    plane: GroundFit = GroundFit()

    def lift(
        self,
        inverse_depth: FloatArray,  # [H, W]
        sums: SumArray,  # [H, W, N], aggregated costs
        planes: FloatArray,  # [N], their inverse depths
        ground: GroundPlane,
        camera: Intrinsics,
    ) -> FloatArray:
        """Return the inverse depth [H, W] with surfaces below the road lifted onto it."""
        road = ground.inverse_depth(camera)
        is_below = ground.is_near(road) & (inverse_depth < road)
        road_below = road[is_below]
        levels = np.interp(road_below, planes, np.arange(len(planes)))
        certainty = (
            np.minimum(self.level_heights * ground.height * road_below, 1) ** 2
        )
        is_plausible = (
            excess_cost(sums[is_below], levels)
            < self.max_excess_cost * certainty
        )
        is_below[is_below] = is_plausible
        return np.where(is_below, road, inverse_depth)

    def floating(
        self,
        inverse_depth: FloatArray,  # [H, W]
        islands: BoolArray,  # [H, W], surfaces that are cut off from all around
        ground: GroundPlane,
        camera: Intrinsics,
    ) -> BoolArray:
        """Mask islands [H, W] that float low over the road.

        They are wrong matches or oncoming objects: these shift along epipolar lines like nearer
        static ones, so that their foot seems to float.
        """
        road = ground.inverse_depth(camera)
        heights = 1 - road / np.maximum(
            inverse_depth, 1e-9 / ground.height
        )  # camera heights
        is_floating = np.zeros(islands.shape, dtype=bool)
        num_labels, labels = cv2.connectedComponents(
            islands.astype(np.uint8), connectivity=4
        )
        for label in range(1, num_labels):
            island = labels == label
            lowest, highest = np.percentile(heights[island], (10, 90))
            if (
                lowest > self.min_floating_heights
                and highest < self.max_floating_heights
            ):
                is_floating |= island
        return is_floating
