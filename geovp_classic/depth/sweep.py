"""Inverse depth of one frame from others: plane sweep, semi-global aggregation, ground prior,
completion.
"""

import threading
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.depth import aggregation, completion, matching, viewpoints
from geovp_classic.depth.correlation import CostArray
from geovp_classic.geometry import se3
from geovp_classic.geometry.ground_plane import clamp_to_ground, fit_ground, floating_mask
from geovp_classic.types import FloatArray, Intrinsics

TALL_PX = 256  # rows; taller images are swept over more planes
SMALL_STEP, LARGE_STEP, EDGE_CONTRAST = 5, 100.0, 20.0  # see aggregation.aggregate
SPECKLE_SHARE = (
    0.0045  # of the image; smaller islands of depth are wrong matches more often than objects
)
FLOATING_SHARE = 0.027  # larger ones are still wrong where they float low over the road
LARGE_BYTES = 2**25  # beyond which glibc gives memory back to the system at once
SURE_LEAD = 75.0  # the lead over all rivals with full confidence


@dataclass(frozen=True)
class GroundPrior:
    """No surface lies below the ground plane, unless the images contradict it."""

    excess: float = (
        40.0  # largest extra cost of lying on a near road, where the best depth is below it
    )


class _Memory(threading.local):
    """The large volumes of this thread's last sweep, for the next one: getting new ones takes as
    long as filling them.

    Small ones are left to the allocator, which keeps freed memory up to twice the largest piece
    that it saw freed.
    """

    volumes: tuple[CostArray, aggregation.SumArray] | None = None

    def of(self, shape: tuple[int, ...]) -> tuple[CostArray, aggregation.SumArray]:
        if self.volumes is not None and self.volumes[0].shape == shape:
            return self.volumes
        self.volumes = None  # before others are made
        made = np.empty(shape, np.uint8), np.empty(shape, np.uint16)
        if made[0].nbytes > LARGE_BYTES:
            self.volumes = made
        return made


_memory = _Memory()
np.empty(
    LARGE_BYTES - 2**13, np.uint8
)  # made and freed: what a clip gives back stays with the process for the next one


def sweep(
    images: FloatArray,  # [P, H, W] float32 grey 0..255
    camera: Intrinsics,
    world_from_cam: FloatArray,  # [P, 4, 4]
    reference: int,
    sources: Sequence[int],  # at least one, at a distance from the reference
    num_planes: int = 48,
    prior: GroundPrior | None = None,
) -> tuple[FloatArray, FloatArray] | None:
    """Inverse depth and confidence [H, W] of the reference image, float32, in the poses' unit; None
    without parallax.

    Confidence is 0 where other depths fit as well, and 1 where none does.
    """
    source_from_reference = se3.inverse(world_from_cam[list(sources)]) @ world_from_cam[reference]
    planes, step_px = viewpoints.hypotheses(source_from_reference, camera, num_planes)
    infinity_from_pixel = (
        camera.matrix @ source_from_reference[:, :3, :3] @ np.linalg.inv(camera.matrix)
    )
    epipoles = source_from_reference[:, :3, 3] @ camera.matrix.T
    image = images[reference]
    volumes = _memory.of((*image.shape, num_planes))
    costs = matching.sweep_costs(
        image, images[list(sources)], infinity_from_pixel, epipoles, planes, volumes[0]
    )
    sums = aggregation.aggregate(costs, image, SMALL_STEP, LARGE_STEP, EDGE_CONTRAST, volumes[1])
    levels, lead, least = aggregation.winners(sums)
    levels = np.asarray(cv2.medianBlur(levels, 5), np.float32)
    if not viewpoints.shows_parallax(levels * step_px):
        return None
    inverse_depth: FloatArray = np.interp(levels, np.arange(num_planes), planes).astype(np.float32)
    ground = None if prior is None else fit_ground(inverse_depth, camera)
    if prior is not None and ground is not None:
        road = ground.inverse_depth(camera)
        below = inverse_depth < road
        level = np.interp(road[below], planes, np.arange(num_planes))
        allowed = prior.excess * ground.confidence(road[below])
        below[below] = aggregation.excess(sums, least, level, below) < allowed
        inverse_depth = clamp_to_ground(inverse_depth, ground, camera, below)
        levels[below] = np.interp(inverse_depth[below], planes, np.arange(num_planes))
    islands = completion.speckles(levels, SPECKLE_SHARE)
    if ground is not None:
        islands |= floating_mask(
            inverse_depth, ground, camera, completion.speckles(levels, FLOATING_SHARE) & ~islands
        )
    inverse_depth = completion.fill_from_background(inverse_depth, ~islands)
    unseen = matching.UNSEEN + matching.far_prior(num_planes)
    sure = ~islands
    sure[costs[..., 0] == unseen[0]] &= (costs[costs[..., 0] == unseen[0]] != unseen).any(axis=-1)
    confidence = np.where(sure, np.clip(lead / SURE_LEAD, 0, 1), 0).astype(np.float32)
    return inverse_depth.astype(np.float32), confidence
