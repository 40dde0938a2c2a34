"""Source frames and planes of a plane sweep, both chosen from the poses alone, in any unit."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import FloatArray, Intrinsics


@dataclass(frozen=True)
class SourceSelection:
    """Frames at halved distances from the reference: a long baseline is accurate, a short one is
    unambiguous (Okutomi & Kanade 1993).
    """

    # At the longest usable distance, a half, a quarter and an eighth of it: with ten frames, the
    # eighth is the neighbour.
    num_sources: int = 4
    # Of the image that a source sees, at infinity. Set by hand.
    min_overlap_fraction: float = 0.4

    def choose(
        self,
        world_from_cam: FloatArray,  # [P, 4, 4]
        reference: int,
        camera: Intrinsics,
    ) -> list[int]:
        """Return the steps of the sources; none where the camera did not move."""
        source_from_reference = se3.inverse(world_from_cam) @ world_from_cam[reference]
        baselines = np.linalg.norm(source_from_reference[:, :3, 3], axis=1)
        overlaps = _overlap_fraction(source_from_reference, camera)
        is_usable = (overlaps >= self.min_overlap_fraction) & (baselines > 0)
        is_usable[reference] = False
        candidates = np.flatnonzero(is_usable).tolist()
        # For each halved distance, the frame whose baseline is nearest to it in logarithm.
        sources: list[int] = []
        max_baseline = baselines[is_usable].max(initial=0)
        for halvings in range(min(self.num_sources, len(candidates))):
            errors = np.abs(np.log(baselines[candidates] * 2**halvings / max_baseline))
            sources.append(candidates.pop(int(np.argmin(errors))))
        return sources


@dataclass(frozen=True)
class PlaneSpacing:
    """Planes from infinity to the nearest surfaces, at even steps of parallax.

    Parallax is that of a typical pixel of the central square: with forward motion it is zero at
    the centre, and much larger outside the square of wide images.
    """

    # The nearest plane shifts the image of the nearest source by this part of its shorter side.
    # Set by hand.
    max_shift_fraction: float = 0.125
    # Less parallax is noise, of the images or of the poses: the camera counts as stationary.
    min_parallax_px: float = 1.0
    # Quantile of the pixels' parallax that is typical. Set by hand: with forward motion, many
    # pixels of the square are too near to the epipole.
    typical_quantile: float = 0.75
    # Inverse depths times the longest baseline that are tried, and their number: from a parallax
    # that no image shows to the camera itself, at steps of 12 %.
    fine_range: tuple[float, float] = (1e-3, 1e3)
    num_fine: int = 120

    def spaced(
        self,
        source_from_reference: FloatArray,  # [S, 4, 4], S >= 1
        camera: Intrinsics,
        num_planes: int,
    ) -> tuple[FloatArray, float]:
        """Return increasing inverse depths [N], the first one 0, and their step of parallax in
        pixels of the source that sees most of it.
        """
        # Fine inverse depths, to where the nearest source sees the largest shift.
        baselines = np.linalg.norm(source_from_reference[:, :3, 3], axis=1)
        nearest = source_from_reference[[int(np.argmin(baselines))]]
        fine = np.geomspace(*self.fine_range, self.num_fine) / baselines.max()
        max_shift_px = self.max_shift_fraction * min(camera.width_px, camera.height_px)
        is_shifted = self._parallax_px(nearest, camera, fine)[0] >= max_shift_px
        if is_shifted.any():
            fine = fine[: np.argmax(is_shifted) + 1]
        fine = np.concatenate([[0.0], fine])
        # A step counts as the source sees it that sees most of it. Planes are even in the sum of
        # these steps.
        steps_px = np.diff(self._parallax_px(source_from_reference, camera, fine), axis=1)
        steps_px = np.maximum(steps_px.max(axis=0), 1e-9)
        parallax_px = np.concatenate([[0.0], np.cumsum(steps_px)])
        even_px = np.linspace(0, parallax_px[-1], num_planes)
        return np.interp(even_px, parallax_px, fine), float(even_px[1])

    def has_parallax(
        self,
        parallax_px: FloatArray,  # [H, W], measured
    ) -> bool:
        """Return whether the images show that the camera moved."""
        return bool(np.quantile(parallax_px, self.typical_quantile) >= self.min_parallax_px)

    def _parallax_px(
        self,
        source_from_reference: FloatArray,
        camera: Intrinsics,
        inverse_depths: FloatArray,
    ) -> FloatArray:
        """Return the typical shifts [S, N] from infinity to the inverse depths [N].

        They are at most the width of the image, as for points that lie behind a source.
        """
        side_px = min(camera.width_px, camera.height_px)
        rays = _grid_rays(camera, side_px, side_px)
        rotations = np.swapaxes(source_from_reference[:, :3, :3], -1, -2)
        directions = (rays @ rotations)[:, None]  # [S, 1, G, 3]
        positions = source_from_reference[:, None, None, :3, 3]  # [S, 1, 1, 3]
        points = directions + inverse_depths[:, None, None] * positions  # [S, N, G, 3]
        near_pixels, _ = pinhole.project(points, camera)
        far_pixels, _ = pinhole.project(directions, camera)
        shifts_px = np.linalg.norm(near_pixels - far_pixels, axis=-1)
        shifts_px = np.fmin(shifts_px, camera.width_px)  # NaN becomes the width
        return np.quantile(shifts_px, self.typical_quantile, axis=-1, method="nearest")


def _overlap_fraction(source_from_reference: FloatArray, camera: Intrinsics) -> FloatArray:
    """Return the fractions [S] of the image that the sources see of points at infinity."""
    rays = _grid_rays(camera, camera.width_px, camera.height_px)
    rotations = np.swapaxes(source_from_reference[:, :3, :3], -1, -2)
    pixels, _ = pinhole.project(rays @ rotations, camera)
    last = np.array([camera.width_px - 1, camera.height_px - 1])
    is_inside = ((pixels >= 0) & (pixels <= last)).all(axis=-1)
    return is_inside.mean(axis=-1)


def _grid_rays(camera: Intrinsics, width_px: int, height_px: int, num: int = 8) -> FloatArray:
    """Return the rays [num * num, 3] of a grid in a central window of the image."""
    steps = np.linspace(-0.5, 0.5, num)
    u = (camera.width_px - 1) / 2 + (width_px - 1) * steps
    v = (camera.height_px - 1) / 2 + (height_px - 1) * steps
    pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    return pinhole.unproject(pixels, np.ones(len(pixels)), camera)
