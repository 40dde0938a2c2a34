"""The fused cloud: the last frame stays, earlier ones add what it hides, grain returns where it was
lost.
"""

import itertools
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pytest

from geovp_classic.depth.given import Given
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole, se3
from geovp_classic.inpainters.blank import Blank
from geovp_classic.inpainters.detail_transfer import DetailTransfer
from geovp_classic.renderers.depth_fusion import DepthFusion
from geovp_classic.rendering import patches
from geovp_classic.rendering.detail_transfer import BAND_EDGES, FrameDetail, _add
from geovp_classic.rendering.fusion import (
    _close_cracks,
    _hidden_from,
    _median_filter,
    fuse,
    remove_masked,
)
from geovp_classic.rendering.rasterizer import NO_INDEX, IndexArray
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Context,
    FloatArray,
    Intrinsics,
    Trajectory,
    Views,
)

CAMERA = Intrinsics(60, 60, 31.5, 23.5, 64, 48)
PLAIN: dict[str, Any] = {
    "inpainter": Blank(),
    "detail_strength": 0.0,
    "dynamic_objects": None,
    "exposure": None,
}


def wall(world_from_cam: FloatArray, distance: float = 8.0) -> tuple[FloatArray, FloatArray]:
    """Image [H, W, 3] and inverse depth [H, W] of a smoothly painted wall at z = distance."""
    directions = pinhole.rays(CAMERA) @ world_from_cam[:3, :3].T
    reach = (distance - world_from_cam[2, 3]) / directions[..., 2]
    place = world_from_cam[:3, 3] + reach[..., None] * directions
    paint = 128 + 60 * np.sin(1.3 * place[..., 0]) + 50 * np.cos(1.7 * place[..., 1])
    return np.repeat(paint[..., None], 3, axis=2).astype(np.uint8), 1 / reach


def drive(x: FloatArray, z: FloatArray) -> FloatArray:
    return se3.compose(np.eye(3), np.stack([x, np.zeros_like(x), z], axis=-1))


def context_of(poses: FloatArray, num_past: int) -> tuple[Context, Trajectory]:
    images, inverse = zip(*(wall(pose) for pose in poses[:num_past]), strict=True)
    times_s = np.arange(len(poses)) * 0.1
    past = Trajectory(poses[:num_past], times_s[:num_past], True)
    depths = (1 / np.stack(inverse)).astype(np.float32)
    return Context(np.stack(images), times_s, CAMERA, past=past, past_depths=depths), past


def test_a_wall_is_seen_as_it_is_from_nearer() -> None:
    poses = drive(np.zeros(4), np.array([0.0, 0.5, 1.0, 2.0]))
    context, past = context_of(poses, 3)
    scene = DepthFusion(Given(), **PLAIN).reconstruct(context, past)
    views = scene.view(poses[3:], context.times_s[3:], CAMERA)
    assert views.covered.all()
    np.testing.assert_allclose(views.depths[0], 6.0, rtol=1e-4)
    assert np.abs(views.frames[0].astype(int) - wall(poses[3])[0]).mean() < 1.5


def test_an_earlier_frame_shows_what_left_the_last_one() -> None:
    # Sliding 3 m to the right: looking back to the left shows what only the first frame saw.
    poses = drive(np.array([0.0, 3.0, 0.0]), np.zeros(3))
    context, past = context_of(poses, 2)
    both = (
        DepthFusion(Given(), **PLAIN)
        .reconstruct(context, past)
        .view(poses[2:], context.times_s[2:], CAMERA)
    )
    last = DepthFusion(Given(), **PLAIN, num_frames=1).reconstruct(context, past)
    assert both.covered.all()
    # 3 m at 8 m are 22.5 of the 64 columns.
    assert last.view(poses[2:], context.times_s[2:], CAMERA).covered.mean() == pytest.approx(
        1 - 22.5 / 64, abs=0.02
    )
    assert np.abs(both.frames[0].astype(int) - wall(poses[2])[0]).mean() < 1.5


def test_what_stands_in_front_of_a_later_frame_is_not_believed() -> None:
    poses = drive(np.zeros(2), np.zeros(2))
    sources = [patches.Source(wall(pose)[0], CAMERA, pose) for pose in poses]
    truth = wall(poses[1])[1]
    for wrong, added in (
        (truth * 2, 0),
        (truth, 0),
        (truth / 2, truth.size),
    ):  # in front, the same, behind
        cloud, used = fuse(
            sources, np.stack([wrong, truth]), np.ones((2, *truth.shape)), agreement=0.1
        )
        assert len(cloud) == truth.size + added
        assert len(used) == 1 + (added > 0)


def test_looking_back_or_from_nowhere_shows_nothing_and_breaks_nothing() -> None:
    context, past = context_of(drive(np.zeros(3), np.arange(3.0)), 2)
    scene = DepthFusion(Given(), inpainter=Blank()).reconstruct(context, past)
    about = se3.exp(np.array([0, 0, 0, 0, np.pi, 0]))
    beyond = se3.compose(np.eye(3), np.array([0.0, 0, 20]))
    views = scene.view(np.stack([about, beyond]), np.array([0.3, 0.4]), CAMERA)
    assert not views.covered.any()
    assert (views.depths == 0).all()


def test_the_sky_turns_but_does_not_come_nearer() -> None:
    sky = np.zeros((48, 64))
    image = np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8)
    source = patches.Source(image, CAMERA, np.eye(4))
    cloud = patches.from_depth_map(sky, np.ones(sky.shape, bool), 0)
    ahead = se3.compose(np.eye(3), np.array([0.0, 0, 50]))
    drawn, winner = patches.rasterise(cloud, [source], ahead[None], CAMERA)
    np.testing.assert_array_equal(winner[0].ravel(), np.arange(sky.size))
    assert (drawn == 0).all()


def test_what_a_later_frame_hides_is_what_the_slow_twin_says() -> None:
    rng = np.random.default_rng(4)
    one, other = (
        patches.Source(np.zeros((48, 64, 3), np.uint8), CAMERA, se3.exp(np.array(twist)))
        for twist in ([0, 0, 0, 0, 0, 0], [0.4, 0.1, 0.9, 0.02, -0.1, 0.05])
    )
    own, there = rng.uniform(0, 0.5, (2, 48, 64)).astype(np.float32)
    pixels, ratio = patches.source_pixels(other, own, one.world_from_source, one.camera)
    expected = np.ones((48, 64), dtype=bool)
    for row, column in np.ndindex(48, 64):
        u, v = np.round(pixels[row, column]).astype(int)
        if ratio[row, column] > 0 and 0 <= u < 64 and 0 <= v < 48:
            expected[row, column] = own[row, column] / ratio[row, column] < there[v, u] * 0.9
    assert 0.2 < expected.mean() < 0.8
    np.testing.assert_array_equal(_hidden_from(other, there, one, own, 0.1), expected)


def test_dots_go_and_thin_things_stay() -> None:
    inverse_depth = np.full((20, 30), 0.1, np.float32)
    inverse_depth[:, 20:22] = 0.4  # a pole
    plain = inverse_depth.copy()
    for row, column in ((5, 5), (9, 8), (10, 9), (15, 14)):
        inverse_depth[row, column] = 0.11
    number = np.zeros((20, 30), np.int32)
    number[12:, 12:] = 1  # beside it all stays
    number[:3, :3] = NO_INDEX
    inverse_depth[2, 2] = plain[2, 2] = -1
    plain[13, 12] = inverse_depth[13, 12] = 0.3
    np.testing.assert_array_equal(_median_filter(inverse_depth, number), plain)


def test_detail_is_added_only_where_magnification_removed_it() -> None:
    rng = np.random.default_rng(1)
    observed = rng.integers(60, 200, (48, 64, 3), dtype=np.uint8)
    flat = np.full_like(observed, 128)
    times = np.ones((48, 64), np.float32)
    detail = FrameDetail.of(observed)
    np.testing.assert_array_equal(detail.add_to(observed, times), observed)
    times[:, 32:] = 3.0
    blurred = pinhole.resize(pinhole.resize(observed, (16, 12)), (64, 48))
    roughness = np.abs(np.diff(detail.add_to(blurred, times).astype(int), axis=1)).mean(axis=(0, 2))
    before = np.abs(np.diff(blurred.astype(int), axis=1)).mean(axis=(0, 2))
    assert roughness[36:].mean() > 1.5 * before[36:].mean()
    np.testing.assert_allclose(roughness[:28], before[:28])
    # Where nothing is to be seen, little is invented: the contrast of what is there bounds the
    # grain.
    assert np.abs(detail.add_to(flat, times).astype(int) - 128).mean() < 5


@dataclass(frozen=True)
class Kept:
    """A fill that hands out an array which it keeps."""

    frames: ByteArray

    def inpaint(self, views: Views, last: ByteArray) -> ByteArray:
        return self.frames


@pytest.mark.parametrize("wrapped", [False, True], ids=["alone", "below-detail-transfer"])
def test_what_a_fill_keeps_is_not_written_to(wrapped: bool) -> None:
    poses = drive(np.zeros(4), np.array([0.0, 0.5, 1.0, 6.0]))
    context, past = context_of(poses, 3)
    frames = np.random.default_rng(1).integers(0, 255, (1, 48, 64, 3)).astype(np.uint8)
    fill = DetailTransfer(Kept(frames.copy())) if wrapped else Kept(frames.copy())
    scene = DepthFusion(Given(), inpainter=fill, dynamic_objects=None, exposure=None).reconstruct(
        context, past
    )
    shown = scene.view(poses[3:], context.times_s[3:], CAMERA).frames
    assert (shown != frames).any()
    kept = fill.colours if isinstance(fill, DetailTransfer) else fill
    np.testing.assert_array_equal(kept.frames, frames)  # type: ignore[attr-defined]


def test_detail_is_added_as_the_slow_twin_does() -> None:
    rng = np.random.default_rng(2)
    image, bands = rng.uniform(0, 255, (9, 7)), rng.normal(0, 40, (len(BAND_EDGES) - 1, 9, 7))
    times, own, other = (
        rng.uniform(0.5, 8, (9, 7)),
        rng.uniform(2, 20, (9, 7)),
        rng.uniform(2, 20, (9, 7)),
    )
    added = np.empty(image.shape, np.uint8)
    maps = [one.astype(np.float32) for one in (image, bands, times, own, other)]
    _add(*maps[:3], np.float32(0.7), (maps[3], maps[4]), added)
    gain = 0.7 * np.minimum(own / other, 1)
    for n, (first, last) in enumerate(itertools.pairwise(BAND_EDGES)):
        image += gain * np.clip((times - first) / (last - first), 0, 1) * bands[n]
    expected = np.clip(np.floor(image + 0.5), 0, 255)
    assert np.abs(added - expected).max() <= 1  # a half may be rounded either way
    assert (added == expected).mean() > 0.99


def test_settings_that_make_no_sense_are_refused() -> None:
    with pytest.raises(BadData, match="num_frames is 0"):
        DepthFusion(Given(), num_frames=0)
    with pytest.raises(BadData, match="agreement"):
        DepthFusion(Given(), agreement=1.5)


def _grown_slowly(
    depth: FloatArray, number: IndexArray, todo: BoolArray, rounds: int
) -> tuple[FloatArray, IndexArray]:
    for _ in range(rounds):
        before, numbers = depth.copy(), number.copy()
        for row, column in np.argwhere(todo & ~np.isfinite(before)):
            beside = [(row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)]
            known = [
                (before[p], numbers[p]) for p in beside if min(p) >= 0 and p[0] < 20 and p[1] < 30
            ]
            farthest = min(known, key=lambda pair: pair[0])
            if np.isfinite(farthest[0]):
                depth[row, column], number[row, column] = farthest
    return depth, number


@pytest.mark.parametrize("crack_px", [1, 3])
def test_cracks_close_as_the_slow_twin_says(crack_px: int) -> None:
    rng = np.random.default_rng(crack_px)
    seen = rng.uniform(size=(20, 30)) > 0.3
    depth, number = (
        rng.uniform(size=seen.shape).astype(np.float32),
        rng.integers(0, 9, seen.shape).astype(np.int32),
    )
    number[~seen] = NO_INDEX
    kernel = np.ones((2 * crack_px + 1,) * 2, np.uint8)
    cracks = (cv2.morphologyEx(seen.astype(np.uint8), cv2.MORPH_CLOSE, kernel) > 0) & ~seen
    expected = _grown_slowly(
        np.where(seen, depth, np.float32(np.inf)), number.copy(), cracks, 2 * crack_px
    )
    closed = _close_cracks(depth, number, crack_px)
    np.testing.assert_array_equal(closed[0], np.where(np.isfinite(expected[0]), expected[0], -1))
    np.testing.assert_array_equal(closed[1], expected[1])
    assert (closed[0] >= 0).mean() > seen.mean()


def test_patches_of_one_source_leave_the_cloud() -> None:
    known = np.ones((4, 5), dtype=bool)
    cloud = patches.concatenate(
        [patches.from_depth_map(np.full((4, 5), 0.2), known, number) for number in (0, 1)]
    )
    cut = np.zeros((4, 5), dtype=bool)
    cut[1, 2:4] = True
    left = remove_masked(cloud, 0, cut)
    assert len(left) == 40 - 2
    assert (left.source == 1).sum() == 20
    own = left.pixels[left.source == 0]
    assert not ((own[:, 1] == 1) & (own[:, 0] >= 2) & (own[:, 0] < 4)).any()
    assert remove_masked(cloud, 0, np.zeros((4, 5), dtype=bool)) is cloud
