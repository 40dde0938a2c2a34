"""Observation of a clip: screening, scene mask and grey images, computed once per stream."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeVar

import cv2
import numpy as np

from geovp_classic.errors import BadData, Incompatible
from geovp_classic.geometry import pinhole
from geovp_classic.observation.camera_fixed import CameraFixedDetection
from geovp_classic.observation.frame_screening import FrameScreening
from geovp_classic.observation.scene_mask import SceneMasking, Window, read_mask, scene_window
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Context,
    ExtraView,
    Intrinsics,
    Observations,
    PrivilegedInput,
    Trajectory,
)

ImageStream = Literal["crop", "full"]
View = TypeVar("View", Context, ExtraView)


@dataclass(frozen=True)
class Observed:
    """A context reduced to the scene, and the masks of what was removed."""

    context: Context  # with observations
    mask: BoolArray  # [H, W], non-scene pixels of the crop
    # [H, W], the same with what the uncropped frames alone show not to be the scene
    mask_with_full: BoolArray
    original: Context  # as it was given

    def crop_mask(self, needs: PrivilegedInput) -> BoolArray:
        """Return the non-scene pixels [H, W] of the crop.

        Uncropped frames, where they are a privileged input, may show an ego vehicle that the crop
        does not.
        """
        return self.mask_with_full if PrivilegedInput.FULL_FRAMES in needs else self.mask


@dataclass(frozen=True)
class Observer:
    """Frame screening, the scene mask and grey images of both image streams of a clip."""

    screening: FrameScreening = FrameScreening()
    masking: SceneMasking = SceneMasking()
    # None: no pixels are taken for camera-fixed.
    camera_fixed: CameraFixedDetection | None = CameraFixedDetection()
    # Image file or array [H, W], nonzero where no scene is shown. It is of the uncropped frames if
    # the clip has them, else of the frames, in any size.
    mask: Path | BoolArray | None = None
    # whether it adds to the detected camera-fixed pixels or replaces them
    mask_mode: Literal["add", "replace"] = "add"
    # Of the height and the width that the mask must leave free. Set by hand.
    min_scene_fraction: float = 0.25
    # Resolution of uncropped frames over that of the crop: KITTI's has 1.44 times the pixels of a
    # crop of 256. On 03 [0, 180), 1.5 instead of 1 brings .33 dB and -.009 LPIPS.
    max_full_scale: float = 1.5

    def observe(self, context: Context) -> Observed:
        """Return the context reduced to the scene, with observations of its streams.

        Observations of the crop depend on the crop alone, so that no component sees more than its
        own privileged inputs. Raise BadData for an unsuitable mask of the user.
        """
        # What shows no scene: detected in each stream, and drawn by the user.
        full = context.full
        whole = (full or context).intrinsics
        drawn = np.zeros((whole.height_px, whole.width_px), bool)
        if isinstance(self.mask, np.ndarray):
            drawn = pinhole.resize_mask(self.mask, whole.size_px)
        elif self.mask is not None:
            drawn = read_mask(self.mask, whole.height_px, whole.width_px)
        greys = _greys(context.frames)
        mask, is_usable = self.scene(greys)
        mask |= _warped(drawn, whole, context.intrinsics)
        mask_with_full = mask

        # The crop, its camera and everything per pixel, reduced to the scene. The window excludes
        # bars and hoods; masked pixels inside it remain marked.
        window = self._window(mask)
        reduced = _windowed(context, window)
        for field in ("past_depths", "future_frames"):
            images = getattr(context, field)
            if images is not None:
                reduced = replace(reduced, **{field: images[:, *window]})
        camera = reduced.intrinsics
        observations = Observations(
            reduced.frames,
            greys[:, *window],
            is_usable,
            camera,
            mask[window],
            _fractions(window, mask),
        )
        reduced = replace(reduced, observations=observations)
        # The same of the uncropped frames, at the resolution that pays.
        if full is not None:
            full_mask, full_usable = self.scene(_greys(full.frames))
            full_mask |= drawn
            if not mask.any():
                mask_with_full = _warped(full_mask, whole, context.intrinsics)
            full_window = self._window(full_mask)
            full = _windowed(full, full_window)
            future_full = context.future_full
            observed_full = self.full_observations(
                full, camera, full_usable, full_mask[full_window]
            )
            reduced = replace(
                reduced,
                full=full,
                future_full=future_full and _windowed(future_full, full_window),
                full_observations=replace(observed_full, window=_fractions(full_window, full_mask)),
            )
        return Observed(reduced, mask, mask_with_full, context)

    def scene(
        self,
        greys: ByteArray,  # [P, H, W]
    ) -> tuple[BoolArray, BoolArray]:
        """Return the detected mask [H, W] of non-scene pixels, and which frames [P] are usable."""
        content = self.masking.content_window(greys)
        inside = np.ascontiguousarray(greys[:, *content])
        is_usable = self.screening.usable(inside)
        mask = np.ones(greys.shape[1:], bool)
        mask[content] = False
        if self.camera_fixed is not None and (self.mask is None or self.mask_mode == "add"):
            mask[content] = self.camera_fixed.detect(inside[is_usable])
        return mask, is_usable

    def _window(self, mask: BoolArray) -> Window:
        """Return the rows and columns of the scene; raise BadData if a drawn mask hides them."""
        rows, columns = scene_window(mask)
        height, width = mask[rows, columns].shape
        min_height, min_width = self.min_scene_fraction * np.array(mask.shape)
        if height < min_height or width < min_width:
            raise BadData(
                f"mask {self.mask} leaves {width}x{height} of {mask.shape[1]}x{mask.shape[0]} "
                "pixels: give one that leaves a quarter of the height and the width"
            )
        return rows, columns

    def full_observations(
        self,
        full: ExtraView,
        crop: Intrinsics,
        is_usable: BoolArray,
        mask: BoolArray,  # [H', W'], pixels that do not show the scene
    ) -> Observations:
        """Return uncropped frames at up to `max_full_scale` times the resolution of the crop."""
        native = full.intrinsics
        scale = np.clip(native.fx_px / crop.fx_px, 1, self.max_full_scale)
        width_px = max(1, round(native.width_px * scale * crop.fx_px / native.fx_px))
        height_px = max(1, round(native.height_px * scale * crop.fy_px / native.fy_px))
        camera = native.resized(width_px, height_px)
        frames = np.stack([pinhole.resize(frame, camera.size_px) for frame in full.frames])
        mask = pinhole.resize_mask(mask, camera.size_px)
        return Observations(frames, _greys(frames), is_usable, camera, mask)


def stream_needs(frames: ImageStream) -> PrivilegedInput:
    """Return the privileged input that an image stream is."""
    return PrivilegedInput.FULL_FRAMES if frames == "full" else PrivilegedInput.NONE


def observations_of(context: Context, frames: ImageStream) -> Observations:
    """Return the observations of one image stream: those of the context, or computed now.

    Raise Incompatible if the uncropped frames, or depths for them, are missing.
    """
    view: Context | ExtraView | None = context
    observations = context.observations
    if frames == "full":
        view = context.full
        observations = context.full_observations
    if view is None:
        raise Incompatible(
            "uncropped frames are asked for, the clip has none: use a data set that gives them"
        )
    if observations is not None:
        return observations
    observer = Observer()
    greys = _greys(view.frames)
    usable = observer.screening.usable(greys)
    unmasked = np.zeros(greys.shape[1:], bool)
    if isinstance(view, ExtraView):
        return observer.full_observations(view, context.intrinsics, usable, unmasked)
    return Observations(view.frames, greys, usable, view.intrinsics, unmasked)


def future_greys(context: Context, frames: ImageStream) -> ByteArray:
    """Return the grey future images [F, H, W] of one image stream.

    Raise Incompatible if they, or the uncropped frames, are missing.
    """
    if frames == "full" and context.future_full is not None:
        size_px = observations_of(context, "full").intrinsics.size_px
        return _greys([pinhole.resize(frame, size_px) for frame in context.future_full.frames])
    if frames == "crop" and context.future_frames is not None:
        return _greys(context.future_frames)
    raise Incompatible(
        f"future images ({frames}) are asked for, the clip has none: use a data set that gives them"
    )


def recent(
    context: Context,
    past: Trajectory,
    frames: ImageStream,
    num_frames: int,
) -> tuple[Context, Trajectory]:
    """Return the last `num_frames` usable frames of one stream as a context, and their poses."""
    observations = observations_of(context, frames)
    if frames == "full" and context.past_depths is not None:
        raise Incompatible(
            "recorded depth covers the crop only: estimate depth for uncropped frames"
        )
    # Counted from the end: the last frame has rank 1.
    rank = np.cumsum(observations.is_usable[::-1])[::-1]
    steps = observations.is_usable & (rank <= num_frames)
    recent = replace(
        context,
        frames=observations.frames,
        intrinsics=observations.intrinsics,
        observations=observations,
    )
    return recent.observed(steps), past[steps]


def _greys(frames: Iterable[ByteArray]) -> ByteArray:
    """Return the grey images [N, H, W] of frames [H, W, 3]."""
    return np.stack([pinhole.grey8(frame) for frame in frames])


def _fractions(window: Window, mask: BoolArray) -> tuple[float, float, float, float]:
    """Return left, top, right and bottom of a window as fractions of the whole image."""
    rows, columns = window
    height, width = mask.shape
    return (
        columns.start / width,
        rows.start / height,
        columns.stop / width,
        rows.stop / height,
    )


def _windowed(view: View, window: Window) -> View:
    """Return a context or an extra view with its frames and camera cropped."""
    rows, columns = window
    frames = view.frames[:, rows, columns]
    height_px, width_px = frames.shape[1:3]
    camera = view.intrinsics.cropped(columns.start, rows.start, width_px, height_px)
    return replace(view, frames=frames, intrinsics=camera)


def _warped(mask: BoolArray, camera: Intrinsics, other: Intrinsics) -> BoolArray:
    """Return a camera's mask [H, W] as another camera at the same place sees it."""
    other_from_this = other.matrix @ np.linalg.inv(camera.matrix)
    grey, nearest = mask.astype(np.uint8), cv2.INTER_NEAREST
    return cv2.warpAffine(grey, other_from_this[:2], other.size_px, flags=nearest) > 0
