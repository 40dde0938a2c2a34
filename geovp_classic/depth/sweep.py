"""Inverse depth of one frame from the frames around it: plane sweep, semi-global aggregation, sub-plane refinement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.depth import aggregation, matching, viewpoints
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Intrinsics


@dataclass(frozen=True)
class Smoothness:
    """What a step between neighbouring pixels costs, where 255 is the cost of windows that don't correlate."""

    small_step: float = 5.0  # to the next hypothesis
    large_step: float = 100.0  # to any other
    edge_contrast: float = 10.0  # grey values 0..255 across which a large step costs half


@dataclass(frozen=True)
class Swept:
    """What a sweep found for one frame."""

    inverse_depth: FloatArray  # [H, W] float32
    cost: FloatArray  # [H, W] float32; 0 = the windows are equal, 1 = they don't correlate
    step: FloatArray  # [H, W] float32; the distance between hypotheses there


def sweep(
    pictures: FloatArray,  # [P, H, W] float32 grey 0..255
    camera: Intrinsics,
    world_from_cam: FloatArray,  # [P, 4, 4]
    reference: int,
    sources: Sequence[int],  # at least one, at a distance from the reference
    num_planes: int = 48,
    smoothness: Smoothness | None = None,
) -> Swept:
    """The inverse depth of the reference picture, in the poses' unit."""
    smoothness = smoothness or Smoothness()
    source_from_reference = se3.inverse(world_from_cam[list(sources)]) @ world_from_cam[reference]
    planes = viewpoints.hypotheses(source_from_reference, camera, num_planes)
    infinity_from_pixel = camera.matrix @ source_from_reference[:, :3, :3] @ np.linalg.inv(camera.matrix)
    epipoles = source_from_reference[:, :3, 3] @ camera.matrix.T
    picture = pictures[reference]
    costs = matching.sweep_costs(picture, pictures[list(sources)], infinity_from_pixel, epipoles, planes)
    sums = aggregation.aggregate(costs, picture, smoothness.small_step, smoothness.large_step, smoothness.edge_contrast)
    inverse_depth, cost = aggregation.winners(sums, costs, planes)
    inverse_depth = np.asarray(cv2.medianBlur(inverse_depth, 5), np.float32)
    step = np.interp(inverse_depth, planes, np.gradient(planes)).astype(np.float32)
    return Swept(inverse_depth, cost.astype(np.float32) / matching.WORST, step)
