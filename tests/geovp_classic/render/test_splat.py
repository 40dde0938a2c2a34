from __future__ import annotations

import cv2
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from geovp_classic.geometry import pinhole, se3
from geovp_classic.render import splat
from geovp_classic.render.supersampling import Supersampled
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(20.0, 22.0, 11.6, 7.3, 24, 16)
IDENTITY = np.eye(4)[None]
RED, GREEN = np.array([200, 0, 0], np.uint8), np.array([0, 200, 0], np.uint8)
SIZE = np.array([0.1])


def point(x: float, y: float, z: float, w: float = 1.0) -> FloatArray:
    return np.array([[x, y, z, w]])


def slow_draw(corners_cam: FloatArray, camera: Intrinsics) -> FloatArray:
    """The obvious twin: every pixel's ray against every patch's plane; inverse depth [H, W], -1 for nothing."""
    rays = pinhole.rays(camera)
    nearest = np.full(rays.shape[:2], -1.0)
    for patch in corners_cam:
        if not (patch[:, 2] > 1e-3).all():
            continue
        outline, _ = pinhole.project(patch[:, :3], camera)
        origin, normal = patch[0, :3], np.cross(patch[1, :3] - patch[0, :3], patch[3, :3] - patch[0, :3])
        for row, column in np.ndindex(nearest.shape):
            if cv2.pointPolygonTest(outline.astype(np.float32)[:, None], (float(column), float(row)), True) > 1e-3:
                nearest[row, column] = max(nearest[row, column], rays[row, column] @ normal / (origin @ normal))
    return nearest


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_patches_are_drawn_as_by_meeting_rays_with_planes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centre = rng.uniform([-3, -2, 1.5], [3, 2, 9], (6, 3))
    across, down = rng.normal(size=(2, 6, 3))
    corners = np.stack([centre - across - down, centre + across - down, centre + across + down, centre - across + down])
    patches = np.concatenate([corners, np.ones((4, 6, 1))], axis=-1).transpose(1, 0, 2)
    drawn, winner = splat.draw(patches, CAMERA)
    expected = slow_draw(patches, CAMERA)
    assert ((winner == splat.NOTHING) == (drawn < 0)).all()
    clear = np.abs(drawn - expected) <= 1e-6 * np.abs(expected)
    assert (~clear).mean() < 0.01  # the twin leaves out pixels that an outline passes through
    empty = expected < 0  # there may be none at all
    assert np.count_nonzero(clear & empty) >= 0.9 * np.count_nonzero(empty)


def test_the_nearest_point_wins_whatever_the_order() -> None:
    near, far = point(0, 0, 2), point(0, 0, 4)
    for points, colours in (([near, far], [RED, GREEN]), ([far, near], [GREEN, RED])):
        views = splat.splat(np.concatenate(points), np.stack(colours), np.array([0.5, 0.5]), IDENTITY, CAMERA)
        assert (views.frames[0, 7, 12] == RED).all()
        assert views.depths[0, 7, 12] == 2.0


def test_a_point_covers_its_size_and_at_least_its_own_pixel() -> None:
    small = splat.splat(point(0, 0, 10), RED[None], np.array([0.0]), IDENTITY, CAMERA).covered[0]
    assert np.argwhere(small).tolist() == [[7, 12]]  # (u, v) = (11.6, 7.3)
    large = splat.splat(point(0, 0, 10), RED[None], np.array([2.0]), IDENTITY, CAMERA).covered[0]  # 4 x 4.4 pixels
    assert large.any(axis=0).sum() == 4
    assert large.any(axis=1).sum() == 4  # 5.1 to 9.5
    moved_closer = splat.splat(point(0, 0, 5), RED[None], np.array([2.0]), IDENTITY, CAMERA).covered[0]
    assert moved_closer.any(axis=0).sum() == 8


def test_the_sky_turns_with_the_camera_and_does_not_come_closer() -> None:
    sky = point(0.1, -0.1, 1.0, w=0.0)
    cameras = np.stack([np.eye(4), se3.compose(np.eye(3), np.array([5.0, -3.0, 40.0]))])
    views = splat.splat(sky, GREEN[None], SIZE, cameras, CAMERA)
    np.testing.assert_array_equal(views.covered[0], views.covered[1])
    assert np.isinf(views.depths[views.covered]).all()
    turned = se3.exp(np.array([0, 0, 0, 0, 0.1, 0]))[None]  # to the right: what is ahead moves left by 2 pixels
    ahead, aside = (
        seen.covered[0].any(axis=0) for seen in (views, splat.splat(sky, GREEN[None], SIZE, turned, CAMERA))
    )
    np.testing.assert_allclose(np.flatnonzero(ahead).mean() - np.flatnonzero(aside).mean(), 2.0, atol=0.5)


def test_things_stand_before_the_sky() -> None:
    points = np.concatenate([point(0, 0, 1, w=0.0), point(0, 0, 500)])
    views = splat.splat(points, np.stack([GREEN, RED]), np.array([2.0, 1.0]), IDENTITY, CAMERA)
    assert views.covered.all()  # the sky point is two radians wide
    assert (views.frames[0, 7, 12] == RED).all()
    assert (views.frames[0, 0, 0] == GREEN).all()


def test_points_behind_the_camera_or_too_near_or_beside_the_image_are_not_seen() -> None:
    points = np.concatenate(
        [point(0, 0, -1), point(0, 0, 0), point(0, 0, 1e-4), point(9, 0, 1), point(0, 0, -1, w=0.0)]
    )
    views = splat.splat(points, np.tile(RED, (5, 1)), np.full(5, 0.5), IDENTITY, CAMERA)
    assert not views.covered.any()
    assert (views.frames == 0).all()
    assert (views.depths == 0).all()


def test_no_points_at_all_are_an_empty_view() -> None:
    nothing = splat.splat(
        np.zeros((0, 4)), np.zeros((0, 3), np.uint8), np.zeros(0), np.tile(IDENTITY, (3, 1, 1)), CAMERA
    )
    assert nothing.frames.shape == (3, 16, 24, 3)
    assert not nothing.covered.any()


def test_neighbouring_patches_leave_no_crack_and_do_not_overlap_wrongly() -> None:
    """A slanted plane cut into 40 x 40 patches covers its outline without a hole."""
    s = np.linspace(-1.5, 1.5, 41)
    x, y = np.meshgrid(s, s)
    plane = np.stack([x, y, 4 + x + 0.5 * y, np.ones_like(x)], axis=-1)
    corners = np.stack([plane[:-1, :-1], plane[:-1, 1:], plane[1:, 1:], plane[1:, :-1]], axis=2).reshape(-1, 4, 4)
    drawn, _ = splat.draw(corners, CAMERA)
    whole, _ = splat.draw(np.stack([plane[0, 0], plane[0, -1], plane[-1, -1], plane[-1, 0]])[None], CAMERA)
    np.testing.assert_allclose(drawn, whole, atol=1e-9)
    assert (whole > 0).sum() > 100


def squares(points: FloatArray, sizes: FloatArray, camera: Intrinsics) -> FloatArray:
    """Corners [N, 4, 4] of squares that face the camera at the origin."""
    half = sizes[:, None, None] / 2 * np.array([[-1, -1, 0, 0], [1, -1, 0, 0], [1, 1, 0, 0], [-1, 1, 0, 0]])
    return points[:, None] + half


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.01, 0.5))
def test_nearly_equal_depths_are_blended_as_by_the_slow_twin(seed: int, softness: float) -> None:
    rng = np.random.default_rng(seed)
    points = np.concatenate([rng.uniform([-2, -1.5, 3], [2, 1.5, 4], (12, 3)), np.ones((12, 1))], axis=1)
    colours, sizes = rng.integers(0, 256, (12, 3), dtype=np.uint8), rng.uniform(0.5, 2, 12)
    views = splat.splat(points, colours, sizes, IDENTITY, CAMERA, softness)
    alone = np.stack([splat.draw(square[None], CAMERA)[0] for square in squares(points, sizes, CAMERA)])  # [12, H, W]
    nearest = alone.max(axis=0)
    weight = np.where(alone > 0, np.maximum(1 - (1 - alone / nearest) / softness, 0), 0)
    with np.errstate(invalid="ignore"):
        mean = (weight[..., None] * colours[:, None, None]).sum(axis=0) / weight.sum(axis=0)[..., None]
    np.testing.assert_array_equal(views.covered[0], nearest > 0)
    np.testing.assert_allclose(views.frames[0][nearest > 0], mean[nearest > 0], atol=0.5 + 1e-9)
    assert (views.frames[0][nearest < 0] == 0).all()
    np.testing.assert_allclose(views.depths[0][nearest > 0], 1 / nearest[nearest > 0], rtol=1e-6)


def test_what_lies_clearly_behind_is_not_blended_and_the_sky_is() -> None:
    near, little, far = point(0, 0, 4), point(0, 0, 4.2), point(0, 0, 6)
    colours, sizes = np.stack([RED, GREEN, [0, 0, 200]]).astype(np.uint8), np.ones(3)
    frame = splat.splat(np.concatenate([near, little, far]), colours, sizes, IDENTITY, CAMERA, 0.1).frames[0, 7, 12]
    # 4 / 4.2 is smaller by 4.8 %: weight 0.524 beside 1.
    np.testing.assert_array_equal(frame, [np.round(200 / 1.524), np.round(200 * 0.524 / 1.524), 0])
    sky = np.concatenate([point(0, 0, 1, w=0.0), point(0, 0, 1, w=0.0)])
    views = splat.splat(sky, np.stack([RED, GREEN]), np.ones(2), IDENTITY, CAMERA, 0.1)
    np.testing.assert_array_equal(views.frames[0, 7, 12], [100, 100, 0])
    assert np.isinf(views.depths[0, 7, 12])


def test_points_are_a_scene_whose_edges_can_be_smooth() -> None:
    white = np.full((1, 3), 240, np.uint8)
    scene = splat.PointScene(point(0, 0, 10), white, np.array([2.0]))  # 4 x 4.4 pixels, 9.6 to 13.6 across
    hard = scene.view(IDENTITY, CAMERA)
    smooth = Supersampled(scene, 5).view(IDENTITY, CAMERA)
    assert set(np.unique(hard.frames)) == {0, 240}
    row = smooth.frames[0, 7, :, 0]
    assert row[11] == 240  # inside
    # The column 10 covers 9.5 to 10.5, of which 9.6 on is the square's: 0.9, four or five of five samples.
    assert row[10] in (192, 240)
    # The column 14 covers 13.5 to 14.5: 0.1 of it, none or one of five samples.
    assert row[14] in (0, 48)
    assert 0 < row[[10, 14]].astype(int).sum() < 480
    np.testing.assert_array_equal(smooth.covered, hard.covered)
