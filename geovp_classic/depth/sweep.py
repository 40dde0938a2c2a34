"""Inverse depth of one frame from the frames around it: plane sweep, semi-global aggregation, road, completion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.depth import aggregation, completion, matching, viewpoints
from geovp_classic.geometry import se3
from geovp_classic.geometry.ground_plane import Ground, afloat, fit_ground, lift
from geovp_classic.types import FloatArray, Intrinsics

SMALL_STEP, LARGE_STEP, EDGE_CONTRAST = 5.0, 100.0, 20.0  # see aggregation.aggregate
GROUND_EXCESS = 40.0  # what lying on a sure road may cost more than the best depth, where that is below the road
SPECKLE_SHARE = 0.0045  # of the image; smaller islands of depth are wrong matches more often than things
AFLOAT_SHARE = 0.027  # larger ones are still wrong where they hang low over the road
SURE_LEAD = 75.0  # a lead over all rivals that is worth full confidence


@dataclass(frozen=True)
class Swept:
    """What a sweep found for one frame."""

    inverse_depth: FloatArray  # [H, W] float32
    confidence: FloatArray  # [H, W] float32; 0 = as good as any other depth, 1 = no rival
    ground: Ground | None


def sweep(
    images: FloatArray,  # [P, H, W] float32 grey 0..255
    camera: Intrinsics,
    world_from_cam: FloatArray,  # [P, 4, 4]
    reference: int,
    sources: Sequence[int],  # at least one, at a distance from the reference
    num_planes: int = 48,
    with_ground: bool = True,
) -> Swept | None:
    """The inverse depth of the reference image, in the poses' unit; None when the images show no parallax."""
    source_from_reference = se3.inverse(world_from_cam[list(sources)]) @ world_from_cam[reference]
    planes, step_px = viewpoints.hypotheses(source_from_reference, camera, num_planes)
    infinity_from_pixel = camera.matrix @ source_from_reference[:, :3, :3] @ np.linalg.inv(camera.matrix)
    epipoles = source_from_reference[:, :3, 3] @ camera.matrix.T
    image = images[reference]
    costs = matching.sweep_costs(image, images[list(sources)], infinity_from_pixel, epipoles, planes)
    sums = aggregation.aggregate(costs, image, SMALL_STEP, LARGE_STEP, EDGE_CONTRAST)
    inverse_depth, lead = aggregation.winners(sums, planes)
    inverse_depth = np.asarray(cv2.medianBlur(inverse_depth, 5), np.float32)
    if not viewpoints.shows_parallax(np.interp(inverse_depth, planes, np.arange(num_planes)) * step_px):
        return None
    ground = fit_ground(inverse_depth, camera) if with_ground else None
    if ground is not None:
        road = ground.inverse_depth(camera)
        allowed = GROUND_EXCESS * ground.sureness(road)
        inverse_depth = lift(inverse_depth, ground, camera, aggregation.excess(sums, planes, road) < allowed)
    levels = np.interp(inverse_depth, planes, np.arange(num_planes))
    islands = completion.speckles(levels, SPECKLE_SHARE)
    if ground is not None:
        islands |= afloat(inverse_depth, ground, camera, completion.speckles(levels, AFLOAT_SHARE) & ~islands)
    inverse_depth = completion.fill_from_background(inverse_depth, ~islands)
    seen = ~(costs == matching.UNSEEN).all(axis=-1)
    confidence = np.where(seen & ~islands, np.clip(lead / SURE_LEAD, 0, 1), 0).astype(np.float32)
    return Swept(inverse_depth.astype(np.float32), confidence, ground)
