"""Depth from the observed frames and where the camera was: what the past alone tells about the shape of the street.

Forward motion leaves no parallax around its own direction, the epipole: the longest baseline decides there, the
neighbours help, and what nothing decides comes out far and unsure. Nothing lies below the road.
"""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.depth import matching, viewpoints
from geovp_classic.depth.completion import complete
from geovp_classic.depth.confirmation import agreement
from geovp_classic.depth.refinement import refined
from geovp_classic.depth.smoothing import flattened
from geovp_classic.depth.sweep import Swept, sweep
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.geometry import pinhole, se3
from geovp_classic.geometry.ground_plane import Ground
from geovp_classic.types import ByteArray, Context, FloatArray, Grant, Intrinsics, Trajectory

WITNESS_STEPS = 3  # how far from a frame the one is whose depth must confirm it
WITNESS_SCALE = 0.5
AGREEMENT = 0.1  # relative difference of two frames' inverse depths


@dataclass(frozen=True)
class Multiview:
    """Plane sweep over the observed frames with the given poses, in whatever unit these have.

    Where the camera stood still or only turned, nothing is known: confidence is 0 everywhere and all is infinitely far,
    or lies on a level road at the recorded camera height when `with_camera_height` asks for that.
    """

    frames: tuple[int, ...] = (-1,)  # steps whose depth is wanted, counted from the end when negative
    num_planes: int = 64  # of a sweep over images of up to 256 rows; over taller ones proportionally more
    with_ground: bool = True  # nothing lies below the road that is found under the camera
    with_completion: bool = True  # unsure pixels follow sure ones that look like them, surfaces are smooth
    with_refinement: bool = True  # depths between the planes, by least squares against all other frames
    with_camera_height: bool = False  # without parallax: a level road at the recorded height

    def __post_init__(self) -> None:
        """Raise BadData for settings that give no depth."""
        if not self.frames or self.num_planes < 4:
            given = f"frames {self.frames} and num_planes {self.num_planes}"
            raise BadData(f"multiview: {given}, expected at least one frame and at least 4 planes")

    @property
    def needs(self) -> Grant:
        """Nothing beyond the frames, unless the camera's height is asked for."""
        return Grant.CAMERA_HEIGHT if self.with_camera_height else Grant.NONE

    def inverse_depths(self, context: Context, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        """Inverse depth [P, H, W] and confidence [P, H, W], float32; both are 0 for frames that are not wanted."""
        still = self._without_parallax(context, past)
        inverse_depths, confidence = depths_of_frames(self, context.frames, context.intrinsics, past, still)
        return inverse_depths, confidence

    def _without_parallax(self, context: Context, past: Trajectory) -> FloatArray:
        """The inverse depth [H, W] of a frame about which the others say nothing."""
        camera = context.intrinsics
        if not self.with_camera_height:
            return np.zeros((camera.height_px, camera.width_px), np.float32)
        if context.camera_height_m is None or not past.is_metric:
            raise Incompatible("multiview with camera height needs a recorded height and metric poses: leave it out")
        level = Ground(np.array([0.0, 1.0, 0.0]), context.camera_height_m)
        return np.maximum(level.inverse_depth(camera), 0)


def depths_of_frames(
    settings: Multiview,
    frames: ByteArray,  # [P, H, W, 3], of any size: the crop or the wide image
    camera: Intrinsics,
    past: Trajectory,  # [P]
    still: FloatArray,  # [H, W], the inverse depth where there is no parallax
) -> tuple[FloatArray, FloatArray]:
    """Inverse depth and confidence [P, H, W], float32, of the frames that the settings want; 0 for the others.

    BadData when a wanted frame was not observed.
    """
    images = np.stack([pinhole.grey(frame) for frame in frames])
    half = camera.resized(*(max(1, int(side * WITNESS_SCALE)) for side in (camera.width_px, camera.height_px)))
    small = np.stack([cv2.resize(p, (half.width_px, half.height_px), interpolation=cv2.INTER_AREA) for p in images])
    plain = dataclasses.replace(settings, num_planes=max(4, 2 * settings.num_planes // 3), with_ground=False)
    find_witness = functools.cache(lambda step: _swept(plain, small, half, past, step))
    inverse_depths, confidence = np.zeros((2, *images.shape), np.float32)
    for step in _wanted(settings.frames, len(frames)):
        swept = _swept(settings, images, camera, past, step)
        if swept is None:
            inverse_depths[step] = still
            continue
        inverse_depth, trust = swept.inverse_depth, swept.confidence
        other = step - WITNESS_STEPS if step >= WITNESS_STEPS else min(step + WITNESS_STEPS, len(frames) - 1)
        witness = find_witness(other) if other != step else None
        if witness is not None:
            other_from_cam = se3.inverse(past.world_from_cam[other]) @ past.world_from_cam[step]
            trust = trust * agreement(inverse_depth, camera, witness.inverse_depth, half, other_from_cam, AGREEMENT)
        if settings.with_completion:
            inverse_depth = flattened(complete(inverse_depth, trust, images[step]), trust, images[step])
        if settings.with_refinement:
            inverse_depth = refined(inverse_depth, images, camera, past.world_from_cam, step)
        inverse_depths[step], confidence[step] = inverse_depth, trust
    return inverse_depths, confidence


def _swept(settings: Multiview, images: FloatArray, camera: Intrinsics, past: Trajectory, step: int) -> Swept | None:
    sources = viewpoints.choose_sources(past.world_from_cam, step, camera)
    if not sources:
        return None
    poses, num_planes = past.world_from_cam, round(settings.num_planes * max(1, camera.height_px / matching.TALL_PX))
    return sweep(images, camera, poses, step, sources, num_planes, settings.with_ground)


def _wanted(frames: tuple[int, ...], num_past: int) -> list[int]:
    """The wanted steps as 0..P-1; BadData when there is no such step."""
    if not all(-num_past <= frame < num_past for frame in frames):
        raise BadData(f"multiview: frames {frames} of {num_past} observed ones: choose from -{num_past} to -1")
    return sorted({frame % num_past for frame in frames})
