"""Depth of a street that can be worked out on paper, from its images and poses."""

import dataclasses
import tracemalloc

import numpy as np
import pytest

from geovp_classic.depth.multiview import Multiview
from geovp_classic.depth.viewpoints import PlaneSpacing
from geovp_classic.errors import BadData
from geovp_classic.types import BoolArray, Context, FloatArray, Intrinsics, Trajectory
from tests.geovp_classic.boxed_street import observe, straight


def _away_from_epipole(shape: tuple[int, int]) -> BoolArray:
    v, u = np.mgrid[: shape[0], : shape[1]]
    return np.hypot(u - 63.5, v - 55) > 24


def estimate(
    context: Context, past: Trajectory, multiview: Multiview | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return inverse depth and confidence [H, W] of the last frame."""
    inverse_depths, confidence = (multiview or Multiview()).inverse_depths(context, past)
    return inverse_depths[-1], confidence[-1]


def test_depth_of_a_street_seen_while_driving() -> None:
    context, past, truth = observe(straight())
    inverse_depth, confidence = estimate(context, past)
    errors = np.abs(inverse_depth / truth[-1] - 1)
    away = _away_from_epipole(errors.shape)
    is_wrong = errors > 0.25
    assert np.median(errors[away]) < 0.02
    assert is_wrong[away].mean() < 0.07
    assert confidence.min() >= 0
    assert confidence.max() <= 1
    assert confidence[is_wrong].mean() < 0.6 * confidence[~is_wrong].mean()


def test_tall_images_are_swept_over_more_planes() -> None:
    context, past, _ = observe(straight(2))
    planes: list[int] = []

    class CountedSpacing(PlaneSpacing):
        def spaced(
            self, poses: FloatArray, camera: Intrinsics, num_planes: int
        ) -> tuple[FloatArray, float]:
            planes.append(num_planes)
            return super().spaced(poses, camera, num_planes)

    for tall_px in (56, 112, 224):  # the images have 112 rows
        multiview = Multiview(num_planes=20, tall_px=tall_px, spacing=CountedSpacing())
        multiview.inverse_depths(context, past)
    assert planes == [40, 20, 20]


def test_frames_must_be_observed() -> None:
    context, past, _ = observe(straight(num=3))
    with pytest.raises(BadData, match="at least one frame"):
        Multiview(frames=())
    with pytest.raises(BadData, match="of 3 observed"):
        estimate(context, past, Multiview(frames=(-4,)))


def test_noisy_poses_of_a_stationary_camera_show_no_parallax() -> None:
    context, past, _ = observe(straight(step=0.0))
    noisy = past.world_from_cam.copy()
    noisy[:, :3, 3] += np.random.default_rng(0).normal(0, 1e-3, (len(past), 3))
    _, confidence = estimate(context, dataclasses.replace(past, world_from_cam=noisy))
    assert not confidence.any()


def test_a_flat_sky_is_farther_than_the_houses_beside_it() -> None:
    context, past, _ = observe(straight(yaw_rad=0.02))
    frames = context.frames.copy()
    frames[:, :40, 30:-30] = 230
    inverse_depth, _ = estimate(dataclasses.replace(context, frames=frames), past)
    # Without the extra cost of near planes, parts of the sky are at 9 m.
    assert inverse_depth[8:30, 40:-40].max() < 1 / 50


def test_a_noisy_sky_is_infinitely_far_and_the_houses_beside_it_are_not() -> None:
    context, past, truth = observe(straight())
    frames = context.frames.copy()
    sky = frames[:, :40, 30:-30]
    noise = np.random.default_rng(0).normal(0, 1, sky.shape[:3])[..., None]
    sky[:] = np.rint(220 + noise)
    context = dataclasses.replace(context, frames=frames)
    inverse_depth, _ = estimate(context, past)
    # Planes beside infinity, which are beyond 200 m, remain in few pixels.
    assert (inverse_depth[:30, 40:-40] == 0).mean() > 0.98
    assert inverse_depth[:30, 40:-40].max() < 1 / 200
    beside = np.s_[:30, :24]
    assert np.median(np.abs(inverse_depth[beside] / truth[-1][beside] - 1)) < 0.05
    assert (inverse_depth[beside] > 0).all()
    guessed, _ = estimate(context, past, Multiview(max_sky_lead=0))
    assert (guessed[:30, 40:-40] > 0).mean() > 0.05


def test_the_memory_of_a_sweep_is_bounded() -> None:
    # 128 x 112 pixels and 96 planes are 1.4 million costs, of 5 bytes with their path sums: 6.9 MB.
    context, past, truth = observe(straight())
    bounded = Multiview(num_planes=48, tall_px=56, max_costs=400_000)  # 2 MB
    estimate(context, past, bounded)  # compiles
    tracemalloc.start()
    inverse_depth, _ = estimate(context, past, bounded)
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak_bytes < 2e6 + 2e6  # with the images, and the depth maps of six frames
    errors = np.abs(inverse_depth / truth[-1] - 1)
    assert np.median(errors[_away_from_epipole(errors.shape)]) < 0.05
