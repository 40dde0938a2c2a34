"""Multi-view depth from the observed frames and their poses.

Forward motion leaves no parallax around its own direction, the epipole: the longest baseline
decides there, the neighbours help, and pixels without any evidence come out far and uncertain.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.depth.aggregation import SemiGlobalAggregation
from geovp_classic.depth.completion import fill_from_background, find_islands, upper_part
from geovp_classic.depth.matching import WindowCorrelation
from geovp_classic.depth.viewpoints import PlaneSpacing, SourceSelection
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole, se3
from geovp_classic.observation import observations_of
from geovp_classic.types import (
    ByteArray,
    Context,
    FloatArray,
    Intrinsics,
    Observations,
    PrivilegedInput,
    Trajectory,
)


@dataclass(frozen=True)
class Multiview:
    """Plane sweep (Collins 1996) over the observed frames with the given poses, in their unit.

    A camera that did not move, or only turned, leaves depth unknown: the confidence is 0
    everywhere, and everything is infinitely far.
    """

    # Steps to estimate, counted from the end when negative
    frames: tuple[int, ...] = (-1,)
    # For images of up to `tall_px` rows; proportionally more for taller ones. Chosen on train and
    # val, where 96 instead of 64 bring .02 to .10 dB and -.002 LPIPS.
    num_planes: int = 96
    tall_px: int = 256  # height of the crops for which settings were chosen
    sources: SourceSelection = SourceSelection()
    spacing: PlaneSpacing = PlaneSpacing()
    matching: WindowCorrelation = WindowCorrelation()
    aggregation: SemiGlobalAggregation = SemiGlobalAggregation()
    # Width of the median filter of planes, that of the matched windows.
    median_px: int = 5
    # Islands of depth up to this part of the image are wrong matches more often than objects. Set
    # by hand: 300 pixels of 256x256.
    max_speckle_fraction: float = 0.0045
    # Planes between neighbours of one surface: one more than a small step of the aggregation.
    max_speckle_step: float = 2.0
    # Larger images are swept at a lower resolution. A cost takes five bytes with its path sums: 1.3
    # GB, of which 1280x720 needs nearly all. Sweeps of three clips of train and val at .68 of their
    # resolution change views by +.02 dB and -.006 LPIPS.
    max_costs: int = 2**28
    # Cost by which all rivals are worse at confidence 1. Set by hand: .3 of ZNCC.
    confident_lead: float = 75.0
    # Cost by which infinity may be worse in the sky: .08 of ZNCC. Chosen among 10, 20 and 40 on
    # KITTI's train and val and the videos of other cameras.
    max_sky_lead: float = 20.0

    needs = PrivilegedInput.NONE

    def __post_init__(self) -> None:
        # A winner has rivals beside its neighbours.
        min_planes = 2 * self.aggregation.num_neighbours + 2
        if not self.frames or self.num_planes < min_planes:
            raise BadData(
                f"multiview: frames {self.frames} and num_planes {self.num_planes}, expected at "
                f"least one frame and at least {min_planes} planes"
            )

    def inverse_depths(self, context: Context, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        """Return inverse depth [P, H, W] and confidence [P, H, W], float32; 0 for other frames.

        Confidence is 0 where other depths fit as well. BadData for frames that were not observed.
        """
        num_past = len(context.frames)
        if not all(-num_past <= frame < num_past for frame in self.frames):
            raise BadData(
                f"multiview: frames {self.frames} of {num_past} observed ones: choose from "
                f"-{num_past} to -1"
            )
        observations = observations_of(context, "crop")
        greys, camera = self._bounded(observations)
        inverse_depths = np.zeros(context.frames.shape[:3], np.float32)
        confidence = np.zeros_like(inverse_depths)
        poses = past.world_from_cam
        for frame in self.frames:
            step = frame % num_past
            sources = self.sources.choose(poses, step, camera)
            if not sources:
                continue  # no parallax
            source_from_reference = se3.inverse(poses[sources]) @ poses[step]
            depth_map = self._sweep(greys[step], greys[sources], source_from_reference, camera)
            if depth_map is not None:
                inverse_depths[step] = _enlarged(depth_map[0], context.intrinsics)
                confidence[step] = _enlarged(depth_map[1], context.intrinsics)
        confidence[:, observations.mask] = 0  # no part of the scene
        return inverse_depths, confidence

    def _bounded(self, observations: Observations) -> tuple[ByteArray, Intrinsics]:
        """Return grey images [P, H, W] that need at most `max_costs` costs, and their camera."""
        camera = observations.intrinsics
        num_costs = camera.width_px * camera.height_px * self._num_planes(camera)
        if num_costs <= self.max_costs:
            return observations.greys, camera
        # The number of planes is proportional to the height, too.
        scale = (self.max_costs / num_costs) ** (1 / 3)
        size_px = (int(scale * camera.width_px), int(scale * camera.height_px))
        greys = np.stack([pinhole.resize(grey, size_px) for grey in observations.greys])
        return greys, camera.resized(*size_px)

    def _num_planes(self, camera: Intrinsics) -> int:
        return round(self.num_planes * max(1, camera.height_px / self.tall_px))

    def _sweep(
        self,
        image: ByteArray,  # [H, W] grey
        sources: ByteArray,  # [S, H, W] grey
        source_from_reference: FloatArray,  # [S, 4, 4]
        camera: Intrinsics,
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return inverse depth and confidence [H, W] of an image; None without parallax."""
        num_planes = self._num_planes(camera)
        planes, step_px = self.spacing.spaced(source_from_reference, camera, num_planes)
        intrinsics = camera.matrix
        rotations = source_from_reference[:, :3, :3]
        infinity_from_pixel = intrinsics @ rotations @ np.linalg.inv(intrinsics)
        epipoles = source_from_reference[:, :3, 3] @ intrinsics.T

        # The plane of each pixel.
        costs, is_seen = self.matching.costs(image, sources, infinity_from_pixel, epipoles, planes)
        sums = self.aggregation.aggregate(costs, image)
        rough_levels, lead, lead_over_infinity = self.aggregation.winners(sums)
        levels = np.asarray(cv2.medianBlur(rough_levels, self.median_px))
        if not self.spacing.has_parallax(levels * step_px):
            return None
        inverse_depth: FloatArray = np.interp(levels, np.arange(num_planes), planes)

        # Islands of wrong matches are filled, and confidence is 0 there.
        is_wrong = find_islands(levels, self.max_speckle_fraction, self.max_speckle_step)
        confidence = (~is_wrong & is_seen) * np.clip(lead / self.confident_lead, 0, 1)
        inverse_depth = fill_from_background(inverse_depth, ~is_wrong)

        # Clouds have arbitrary depths. Sky is what infinity explains about as well, up to the
        # upper border; planes beside infinity explain as well what is just far.
        is_sky = upper_part(lead_over_infinity < self.max_sky_lead)
        inverse_depth[is_sky & (levels > self.aggregation.num_neighbours)] = 0
        return inverse_depth, confidence.astype(np.float32)


def _enlarged(depth_map: FloatArray, camera: Intrinsics) -> FloatArray:
    """Return a depth map in the size of the camera, with the values of the nearest pixels.

    Interpolation would put pixels between two surfaces.
    """
    nearest = cv2.INTER_NEAREST_EXACT
    return np.asarray(cv2.resize(depth_map, camera.size_px, interpolation=nearest))
