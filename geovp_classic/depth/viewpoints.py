"""Source frames for a plane sweep, and its inverse depths: both from the poses alone, whatever
their unit.
"""

import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import FloatArray, Intrinsics

MIN_OVERLAP = 0.4  # of the image, at infinity
GRID = 8  # pixels along each side at which parallax is worked out
HALVINGS = 4  # baselines of the sources: the longest, a half, a quarter, an eighth of it
NEAREST_SHIFT = (
    0.125  # of the image's shorter side, that the shortest baseline gives the nearest surfaces
)
MIN_PARALLAX_PX = 1.0  # less is noise, of the images or of the poses
TYPICAL = (
    0.75  # the quantile of the pixels' parallax that counts: forward motion has none at its centre
)


def choose_sources(
    world_from_cam: FloatArray,  # [P, 4, 4]
    reference: int,
    camera: Intrinsics,
) -> list[int]:
    """Steps whose distances from the reference step are near the longest one, a half, a quarter and
    an eighth of it.

    Steps that see less than MIN_OVERLAP of the image are left out. Empty when no step has any
    distance.
    """
    source_from_reference = se3.inverse(world_from_cam) @ world_from_cam[reference]
    baseline = np.linalg.norm(source_from_reference[:, :3, 3], axis=1)
    usable = (_overlap(source_from_reference, camera) >= MIN_OVERLAP) & (baseline > 0)
    usable[reference] = False
    steps = np.flatnonzero(usable)
    chosen: list[int] = []
    for halving in range(HALVINGS):
        left = [step for step in steps if step not in chosen]
        if left:
            wanted = baseline[steps].max() / 2**halving
            chosen.append(int(min(left, key=lambda step: abs(np.log(baseline[step] / wanted)))))
    return chosen


def hypotheses(
    source_from_reference: FloatArray,  # [S, 4, 4], S >= 1
    camera: Intrinsics,
    count: int,
) -> tuple[FloatArray, float]:
    """Increasing inverse depths [count], 0 (infinitely far) first, evenly spaced in parallax, and
    their spacing in px.

    Between two neighbours the source that sees most change sees the same number of pixels. The last
    one shifts the image of the nearest source by NEAREST_SHIFT of its shorter side.
    """
    baseline = np.linalg.norm(source_from_reference[:, :3, 3], axis=1)
    closest = source_from_reference[[int(np.argmin(baseline))]]
    fine = np.geomspace(1e-3, 1e3, 120) / baseline.max()
    wanted_px = NEAREST_SHIFT * min(camera.width_px, camera.height_px)
    reached = np.flatnonzero(_parallax_px(closest, camera, fine)[0] >= wanted_px)
    fine = np.concatenate([[0.0], fine[: reached[0] + 1] if len(reached) else fine])
    speed = np.diff(_parallax_px(source_from_reference, camera, fine), axis=1).max(axis=0)
    travelled = np.concatenate([[0.0], np.cumsum(np.maximum(speed, 1e-9))])
    return np.interp(np.linspace(0, travelled[-1], count), travelled, fine), float(
        travelled[-1] / (count - 1)
    )


def shows_parallax(
    parallax_px: FloatArray,  # [H, W], as found for each pixel
) -> bool:
    """Whether the images show that the camera moved: the quarter of the pixels that moved most did
    so visibly.
    """
    return bool(np.quantile(parallax_px, TYPICAL) >= MIN_PARALLAX_PX)


def _parallax_px(
    source_from_reference: FloatArray, camera: Intrinsics, inverse_depths: FloatArray
) -> FloatArray:
    """How far [S, N] points at the inverse depths are shifted from where they'd be at infinity, at
    a TYPICAL pixel.

    Typical of the central square, so that what lies beside it does not coarsen what lies in it. At
    most the image's width, which also stands for points that come to lie behind the source.
    """
    around = (min(camera.width_px, camera.height_px) - 1) * np.linspace(-0.5, 0.5, GRID)
    steps_u, steps_v = (camera.width_px - 1) / 2 + around, (camera.height_px - 1) / 2 + around
    pixels = np.stack(np.meshgrid(steps_u, steps_v), axis=-1).reshape(-1, 2)
    rays = pinhole.unproject(pixels, np.ones(len(pixels)), camera)
    directions = (rays @ np.swapaxes(source_from_reference[:, :3, :3], -1, -2))[
        :, None
    ]  # [S, 1, G, 3]
    away = (
        inverse_depths[:, None, None] * source_from_reference[:, None, None, :3, 3]
    )  # [S, N, 1, 3]
    there, _ = pinhole.project(directions + away, camera)
    shift = np.linalg.norm(there - pinhole.project(directions, camera)[0], axis=-1)
    bounded = np.where(shift < camera.width_px, shift, camera.width_px)  # NaN is not less either
    return np.quantile(bounded, TYPICAL, axis=-1, method="nearest")


def _overlap(source_from_reference: FloatArray, camera: Intrinsics) -> FloatArray:
    """The share [S] of the image that the sources see of points at infinity."""
    edge_u, edge_v = (
        np.linspace(0, camera.width_px - 1, GRID),
        np.linspace(0, camera.height_px - 1, GRID),
    )
    pixels = np.stack(np.meshgrid(edge_u, edge_v), axis=-1).reshape(-1, 2)
    rays = pinhole.unproject(pixels, np.ones(len(pixels)), camera)
    there, _ = pinhole.project(rays @ np.swapaxes(source_from_reference[:, :3, :3], -1, -2), camera)
    last = np.array([camera.width_px - 1, camera.height_px - 1])
    return np.asarray(((there >= 0) & (there <= last)).all(axis=-1).mean(axis=-1))
