"""The fused cloud: the last frame stays, and earlier ones add what it does not show."""

from typing import Any

import cv2
import numpy as np
import pytest

from geovp_classic.depth.given import Given
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole, se3
from geovp_classic.inpainters.blank import Blank
from geovp_classic.renderers.depth_fusion import DepthFusion
from geovp_classic.rendering.fusion import close_cracks, fuse, hidden_from, smooth
from geovp_classic.rendering.patches import PatchModel
from geovp_classic.rendering.rasterizer import NO_INDEX
from geovp_classic.rendering.source import Source
from geovp_classic.types import Context, FloatArray, Intrinsics, Trajectory

CAMERA = Intrinsics(60, 60, 31.5, 23.5, 64, 48)
PLAIN: dict[str, Any] = {
    "inpainter": Blank(),
    "detail": None,
    "dynamic_objects": None,
    "exposure": None,
}


def wall(world_from_cam: FloatArray, distance: float = 8.0) -> tuple[FloatArray, FloatArray]:
    """Return image [H, W, 3] and inverse depth [H, W] of a smooth wall at z = distance."""
    directions = pinhole.rays(CAMERA) @ world_from_cam[:3, :3].T
    reach = (distance - world_from_cam[2, 3]) / directions[..., 2]
    place = world_from_cam[:3, 3] + reach[..., None] * directions
    paint = 128 + 60 * np.sin(1.3 * place[..., 0]) + 50 * np.cos(1.7 * place[..., 1])
    return np.repeat(paint[..., None], 3, axis=2).astype(np.uint8), 1 / reach


def drive(x: list[float], z: list[float]) -> FloatArray:
    return se3.compose(np.eye(3), np.stack([x, np.zeros_like(x), z], axis=-1))


def context_of(poses: FloatArray, num_past: int) -> tuple[Context, Trajectory]:
    images, inverse = zip(*(wall(pose) for pose in poses[:num_past]), strict=True)
    times_s = np.arange(len(poses)) * 0.1
    past = Trajectory(poses[:num_past], times_s[:num_past], True)
    depths = (1 / np.stack(inverse)).astype(np.float32)
    return Context(np.stack(images), times_s, CAMERA, past=past, past_depths=depths), past


def test_a_wall_is_seen_from_nearer() -> None:
    poses = drive([0, 0, 0, 0], [0.0, 0.5, 1.0, 2.0])
    context, past = context_of(poses, 3)
    scene = DepthFusion(Given(), **PLAIN).reconstruct(context, past)
    views = scene.view(poses[3:], context.times_s[3:], CAMERA)
    assert views.covered.all()
    np.testing.assert_allclose(views.depths[0], 6.0, rtol=1e-4)
    assert np.abs(views.frames[0].astype(int) - wall(poses[3])[0]).mean() < 1.5


def test_an_earlier_frame_shows_what_left_the_last_one() -> None:
    # The camera slides 3 m to the right and back: 3 m at 8 m are 22.5 of the 64 columns.
    poses = drive([0.0, 3.0, 0.0], [0, 0, 0])
    context, past = context_of(poses, 2)
    views = {}
    for num_frames in (1, 2):
        scene = DepthFusion(Given(), **PLAIN, num_frames=num_frames).reconstruct(context, past)
        views[num_frames] = scene.view(poses[2:], context.times_s[2:], CAMERA)
    assert views[2].covered.all()
    assert views[1].covered.mean() == pytest.approx(1 - 22.5 / 64, abs=0.02)
    assert np.abs(views[2].frames[0].astype(int) - wall(poses[2])[0]).mean() < 1.5


@pytest.mark.parametrize(("factor", "is_added"), [(2, False), (1, False), (0.5, True)])
def test_earlier_surfaces_are_added_only_behind_later_ones(factor: float, is_added: bool) -> None:
    poses = drive([0, 0], [0, 0])
    sources = [Source(wall(pose)[0], CAMERA, pose) for pose in poses]
    last = wall(poses[1])[1]
    is_known = np.ones((2, *last.shape), bool)
    is_known[1, 1, 2:4] = False  # pixels of the last frame that may not become patches
    cloud, used = fuse(sources, np.stack([factor * last, last]), is_known, 0.1, PatchModel())
    assert len(cloud) == (1 + is_added) * last.size - 2
    assert used == ([1, 0] if is_added else [1])
    columns, rows = cloud.pixels[cloud.source == 0].astype(int).T
    assert not ((rows == 1) & (columns >= 2) & (columns < 4)).any()


def test_looking_back_or_from_behind_the_wall_shows_nothing() -> None:
    context, past = context_of(drive([0, 0, 0], [0, 1, 2]), 2)
    scene = DepthFusion(Given(), inpainter=Blank()).reconstruct(context, past)
    backward = se3.exp(np.array([0, 0, 0, 0, np.pi, 0]))
    behind = se3.compose(np.eye(3), np.array([0.0, 0, 20]))
    views = scene.view(np.stack([backward, behind]), np.array([0.3, 0.4]), CAMERA)
    assert not views.covered.any()
    assert (views.depths == 0).all()


def test_hidden_pixels_match_a_loop_over_pixels() -> None:
    rng = np.random.default_rng(4)
    source, later = (
        Source(np.zeros((48, 64, 3), np.uint8), CAMERA, se3.exp(np.array(twist)))
        for twist in ([0, 0, 0, 0, 0, 0], [0.4, 0.1, 0.9, 0.02, -0.1, 0.05])
    )
    inverse_depth, later_depth = rng.uniform(0, 0.5, (2, 48, 64)).astype(np.float32)
    pixels, ratio = later.project(inverse_depth, source.world_from_source, CAMERA)
    expected = np.ones((48, 64), bool)
    for row, column in np.ndindex(48, 64):
        u, v = np.round(pixels[row, column]).astype(int)
        if ratio[row, column] > 0 and 0 <= u < 64 and 0 <= v < 48:
            in_later = inverse_depth[row, column] / ratio[row, column]
            expected[row, column] = in_later < later_depth[v, u] * 0.9
    assert 0.2 < expected.mean() < 0.8
    hidden = hidden_from(later, later_depth, source, inverse_depth, 0.1)
    assert (hidden == expected).mean() > 0.999  # OpenCV may round half a pixel the other way


def test_smoothing_removes_dots_and_keeps_lines() -> None:
    inverse_depth = np.full((20, 30), 0.1, np.float32)
    inverse_depth[:, 20:22] = 0.4  # a pole
    index = np.zeros((20, 30), np.int32)
    index[12:, 12:] = 1  # another source
    index[:3, :3] = NO_INDEX
    inverse_depth[2, 2] = -1
    inverse_depth[13, 12] = 0.3  # beside pixels of the other source
    expected = inverse_depth.copy()
    for row, column in ((5, 5), (9, 8), (10, 9), (15, 14)):
        inverse_depth[row, column] = 0.11
    np.testing.assert_array_equal(smooth(inverse_depth, index), expected)


@pytest.mark.parametrize("crack_px", [1, 3])
def test_cracks_take_the_farthest_neighbour_round_by_round(crack_px: int) -> None:
    rng = np.random.default_rng(crack_px)
    is_seen = rng.uniform(size=(20, 30)) > 0.3
    depth = np.where(is_seen, rng.uniform(size=is_seen.shape), np.inf).astype(np.float32)
    index = np.where(is_seen, rng.integers(0, 9, is_seen.shape), NO_INDEX).astype(np.int32)
    closed_depth, closed_index = close_cracks(np.where(is_seen, depth, -1), index, crack_px)

    kernel = np.ones((2 * crack_px + 1,) * 2, np.uint8)
    is_crack = cv2.morphologyEx(is_seen.astype(np.uint8), cv2.MORPH_CLOSE, kernel) > 0
    for _ in range(2 * crack_px):
        before = depth.copy()
        index_before = index.copy()
        for row, column in np.argwhere(is_crack & np.isinf(before)):
            neighbours = [
                (r, c)
                for r, c in (
                    (row - 1, column),
                    (row + 1, column),
                    (row, column - 1),
                    (row, column + 1),
                )
                if 0 <= r < 20 and 0 <= c < 30
            ]
            farthest = min(neighbours, key=lambda place: before[place])
            depth[row, column] = before[farthest]
            index[row, column] = index_before[farthest]
    np.testing.assert_array_equal(closed_depth, np.where(np.isinf(depth), -1, depth))
    np.testing.assert_array_equal(closed_index, index)
    assert (closed_index != NO_INDEX).mean() > is_seen.mean()


@pytest.mark.parametrize("settings", [{"num_frames": 0}, {"max_depth_difference": 1.5}])
def test_bad_settings_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(BadData, match=next(iter(settings))):
        DepthFusion(Given(), **settings)
