"""Observation of a clip: screening, scene mask and grey images, computed once per stream."""

from dataclasses import dataclass, field, replace
from typing import Literal

import cv2
import numpy as np

from geovp_classic.errors import Incompatible
from geovp_classic.geometry import pinhole
from geovp_classic.observation.followed_vehicle import (
    FollowedVehicle,
    FollowedVehicleDetector,
)
from geovp_classic.observation.frame_screening import FrameScreening
from geovp_classic.observation.scene_mask import (
    SceneMasking,
    Window,
    scene_window,
)
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Context,
    ExtraView,
    FloatArray,
    Intrinsics,
    Observations,
    PrivilegedInput,
    Trajectory,
)

Stream = Literal["crop", "full"]


@dataclass(frozen=True)
class Observed:
    """A context reduced to the scene, and the masks of what was removed."""

    context: Context  # with observations
    mask: BoolArray  # [H, W], non-scene pixels of the crop
    full_mask: BoolArray | None  # [H', W'], the same of the uncropped frames
    vehicle: FollowedVehicle | None  # within the scene window of the crop
    original: Context  # as it was given

    def only(self, needs: PrivilegedInput) -> Context:
        """Return the observed context with the given privileged inputs alone."""
        return self.context.only(needs)

    def hidden_mask(self, needs: PrivilegedInput) -> BoolArray:
        """Return the pixels [H, W] of the last frame with the ego or a followed vehicle or bars."""
        mask = self.crop_mask(needs).copy()
        if self.vehicle is not None:
            mask[scene_window(self.mask)] |= self.vehicle.mask
        return mask

    def crop_mask(self, needs: PrivilegedInput) -> BoolArray:
        """Return the non-scene pixels [H, W] of the crop.

        Uncropped frames, where they are a privileged input, may show an ego vehicle that the crop
        does not.
        """
        full = (
            self.original.full if PrivilegedInput.FULL_FRAMES in needs else None
        )
        if self.mask.any() or self.full_mask is None or full is None:
            return self.mask
        return (
            _warped(self.full_mask, full.intrinsics, self.original.intrinsics)
            > 0
        )


@dataclass(frozen=True)
class Observer:
    """Frame screening, the scene mask and grey images of both image streams of a clip."""

    screening: FrameScreening = field(default_factory=FrameScreening)
    masking: SceneMasking = field(default_factory=SceneMasking)
    followed_vehicle: FollowedVehicleDetector = field(
        default_factory=FollowedVehicleDetector
    )
    max_full_scale: float = (
        1.5  # resolution of uncropped frames over that of the crop
    )
    inpaint_radius_px: float = (
        3.0  # of the pixels of a followed vehicle (Telea 2004)
    )

    def observe(self, context: Context) -> Observed:
        """Return the context reduced to the scene, with observations of its streams.

        Observations of the crop depend on the crop alone, so that no component sees more than its
        own privileged inputs.
        """
        greys = _greys(context.frames)
        mask, is_usable = self.scene(context.frames, greys)
        window = scene_window(mask)
        greys = greys[:, *window]
        frames = context.frames[:, *window]
        future_frames, future_full = context.future_frames, context.future_full
        if future_frames is not None:
            future_frames = future_frames[:, *window]
        camera = _windowed(context.intrinsics, window)
        vehicle = self.followed_vehicle.detect(greys)
        full, full_mask, full_usable = context.full, None, None
        if full is not None:
            full_mask, full_usable = self.scene(
                full.frames, _greys(full.frames)
            )
            full_window = scene_window(full_mask)
            full = _windowed_view(full, full_window)
            if future_full is not None:
                future_full = _windowed_view(future_full, full_window)
        if vehicle is not None:
            masks = _vehicle_masks(vehicle, context)
            frames = self._inpainted(frames, masks)
            greys = _greys(frames)
            if full is not None:
                warped = [
                    _warped(mask, camera, full.intrinsics) for mask in masks
                ]
                full = replace(
                    full, frames=self._inpainted(full.frames, warped)
                )
        observations = Observations(frames, greys, is_usable, camera)
        reduced = replace(
            context,
            frames=frames,
            intrinsics=camera,
            past_depths=None
            if context.past_depths is None
            else context.past_depths[:, *window],
            full=full,
            future_frames=future_frames,
            future_full=future_full,
            observations=observations,
        )
        if full is not None and full_usable is not None:
            full_observations = self._full_observations(
                full, camera, full_usable
            )
            reduced = replace(reduced, full_observations=full_observations)
        return Observed(reduced, mask, full_mask, vehicle, context)

    def stream(self, context: Context, frames: Stream) -> Observations:
        """Return the observations of one image stream: those of the context, or computed now.

        Raise Incompatible if the uncropped frames, or depths for them, are missing.
        """
        if frames == "crop":
            if context.observations is not None:
                return context.observations
            greys = _greys(context.frames)
            usable = self.screening.usable(greys)
            return Observations(
                context.frames, greys, usable, context.intrinsics
            )
        if context.full is None:
            raise Incompatible(
                "uncropped frames are asked for, the clip has none: use a data set that gives them"
            )
        if context.full_observations is not None:
            return context.full_observations
        usable = self.screening.usable(_greys(context.full.frames))
        return self._full_observations(context.full, context.intrinsics, usable)

    def future_greys(self, context: Context, frames: Stream) -> ByteArray:
        """Return the grey future images [F, H, W] of one image stream.

        Raise Incompatible if they, or the uncropped frames, are missing.
        """
        if frames == "full" and context.future_full is not None:
            view = context.future_full
            usable = np.ones(len(view), dtype=bool)
            return self._full_observations(
                view, context.intrinsics, usable
            ).greys
        if frames == "crop" and context.future_frames is not None:
            return _greys(context.future_frames)
        raise Incompatible(
            f"future images ({frames}) are asked for, the clip has none: use a data set that gives "
            "them"
        )

    def recent(
        self,
        context: Context,
        past: Trajectory,
        frames: Stream,
        num_frames: int,
    ) -> tuple[Context, Trajectory]:
        """Return the last usable frames of one stream as a context, and their poses."""
        stream = self.stream(context, frames)
        if frames == "full" and context.past_depths is not None:
            raise Incompatible(
                "recorded depth covers the crop only: estimate depth for uncropped frames"
            )
        steps = np.arange(context.num_past) >= context.num_past - num_frames
        steps &= stream.is_usable
        recent = replace(
            context,
            frames=stream.frames,
            intrinsics=stream.intrinsics,
            observations=stream,
        )
        return recent.observed(steps), past[steps]

    def scene(
        self, frames: ByteArray, greys: ByteArray
    ) -> tuple[BoolArray, BoolArray]:
        """Return the mask [H, W] of non-scene pixels, and which frames [P] are usable.

        Frames are [P, H, W, C], grey images [P, H, W].
        """
        content = self.masking.content_window(frames)
        greys = greys[:, *content]
        is_usable = self.screening.usable(np.ascontiguousarray(greys))
        mask = np.ones(frames.shape[1:3], bool)
        mask[content] = self.masking.ego_vehicle(greys[is_usable])
        return mask, is_usable

    def _full_observations(
        self, full: ExtraView, crop: Intrinsics, is_usable: BoolArray
    ) -> Observations:
        """Return uncropped frames at up to `max_full_scale` times the resolution of the crop."""
        native = full.intrinsics
        scale = np.clip(native.fx_px / crop.fx_px, 1, self.max_full_scale)
        width_px = max(
            1, round(native.width_px * scale * crop.fx_px / native.fx_px)
        )
        height_px = max(
            1, round(native.height_px * scale * crop.fy_px / native.fy_px)
        )
        frames = np.stack(
            [
                pinhole.resize(frame, (width_px, height_px))
                for frame in full.frames
            ]
        )
        camera = native.resized(width_px, height_px)
        return Observations(frames, _greys(frames), is_usable, camera)

    def _inpainted(
        self, frames: ByteArray, masks: list[ByteArray]
    ) -> ByteArray:
        """Return frames [P, H, W, 3] with masked pixels inpainted from around them."""
        radius_px = self.inpaint_radius_px
        pairs = zip(frames, masks, strict=True)
        return np.stack(
            [
                cv2.inpaint(np.array(f), mask, radius_px, cv2.INPAINT_TELEA)
                for f, mask in pairs
            ]
        )


def stream(context: Context, frames: Stream) -> Observations:
    """Return the observations of one image stream of a context; see `Observer.stream`."""
    return Observer().stream(context, frames)


def future_greys(context: Context, frames: Stream) -> ByteArray:
    """Return the future images of one stream in grey; see `Observer.future_greys`."""
    return Observer().future_greys(context, frames)


def scene_window_of(greys: ByteArray) -> Window:
    """Return the rows and columns of grey images [P, H, W] that show the scene."""
    return scene_window(Observer().scene(greys[..., None], greys)[0])


def recent(
    context: Context, past: Trajectory, frames: Stream, num_frames: int
) -> tuple[Context, Trajectory]:
    """Return the last usable frames of one stream and their poses; see `Observer.recent`."""
    return Observer().recent(context, past, frames, num_frames)


def _greys(frames: ByteArray) -> ByteArray:
    return np.stack([pinhole.grey8(frame) for frame in frames])


def _vehicle_masks(
    vehicle: FollowedVehicle, context: Context
) -> list[ByteArray]:
    """Return the followed vehicle's mask [H, W] in each observed frame."""
    past_s = context.times_s[: context.num_past]
    fractions = back_fractions(past_s, past_s[0], past_s[-1])
    mask = vehicle.mask.astype(np.uint8)
    return [vehicle.moved(mask, fraction) for fraction in fractions]


def back_fractions(
    times_s: FloatArray, first_s: float, last_s: float
) -> FloatArray:
    """Return fractions [F] of the way from the last observed time back to the first."""
    return (last_s - times_s) / (last_s - first_s)


def _windowed(camera: Intrinsics, window: Window) -> Intrinsics:
    rows, columns = window
    width_px = columns.stop - columns.start
    return camera.cropped(
        columns.start, rows.start, width_px, rows.stop - rows.start
    )


def _windowed_view(view: ExtraView, window: Window) -> ExtraView:
    camera = _windowed(view.intrinsics, window)
    return replace(view, frames=view.frames[:, *window], intrinsics=camera)


def _warped(
    mask: BoolArray | ByteArray, camera: Intrinsics, other: Intrinsics
) -> ByteArray:
    """Return a camera's mask [H, W] as another camera at the same place sees it."""
    other_from_this = other.matrix @ np.linalg.inv(camera.matrix)
    size_px = (other.width_px, other.height_px)
    image = mask.astype(np.uint8)
    return np.asarray(
        cv2.warpAffine(
            image, other_from_this[:2], size_px, flags=cv2.INTER_NEAREST
        ),
        np.uint8,
    )
