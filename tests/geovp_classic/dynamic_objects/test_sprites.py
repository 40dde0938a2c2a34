"""Sprites are rendered where they have moved to, hidden by nearer surfaces, and masked out of the
static scene.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from geovp_classic.dynamic_objects.sprites import DynamicScene, Sprite, mask_out
from geovp_classic.geometry import se3
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics, Views

CAMERA = Intrinsics(60.0, 60.0, 32.0, 24.0, 65, 49)
DEPTH = 6.0
Vector = tuple[float, float, float]


def board(velocity: Vector = (0.0, 0.0, 0.0)) -> Sprite:
    """Return a red board in columns 30 to 34 and rows 22 to 26: 0.5 x 0.5 at z = 6."""
    frame = np.full((49, 65, 3), 90, np.uint8)
    mask = np.zeros((49, 65), bool)
    mask[22:27, 30:35] = True
    frame[mask] = [200, 10, 10]
    return Sprite(frame, mask, CAMERA, np.eye(4), DEPTH, np.array(velocity))


@dataclass(frozen=True)
class Wall:
    """A blue wall that all cameras see at the same depth."""

    depth: float
    covered: bool = True

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        size = (len(world_from_cam), intrinsics.height_px, intrinsics.width_px)
        frames = np.tile(np.array([0, 0, 250], np.uint8), (*size, 1))
        depths = np.full(size, self.depth if self.covered else 0, np.float32)
        return Views(frames, np.full(size, self.covered), depths)


def ahead(*shifts: Vector) -> FloatArray:
    return se3.compose(np.eye(3), np.array(shifts, float))


def view(wall: Wall, sprite: Sprite, poses: FloatArray, *times_s: float) -> Views:
    return DynamicScene(wall, [sprite], 0.0).view(poses, np.array(times_s), CAMERA)


def is_red(frame: ByteArray) -> BoolArray:
    return np.asarray((frame[..., 0] > 150) & (frame[..., 2] < 60))


def test_the_last_pose_shows_the_board_as_observed() -> None:
    views = view(Wall(10.0), board(), ahead((0, 0, 0)), 0.1)
    mask = board().mask
    np.testing.assert_array_equal(is_red(views.frames[0]), mask)
    np.testing.assert_allclose(views.depths[0], np.where(mask, DEPTH, 10.0), rtol=1e-6)
    assert (views.frames[0][~mask] == [0, 0, 250]).all()


@pytest.mark.parametrize(
    ("velocity", "camera_z", "shifts_px"),
    [
        ((1.0, 0.0, 0.0), (0, 0), (5, 10)),  # 1 m/s at z = 6 with f = 60
        ((0.0, 0.0, 8.0), (4, 8), (0, 0)),  # at the speed of the camera
    ],
)
def test_a_board_moves_at_its_velocity(
    velocity: Vector, camera_z: tuple[float, float], shifts_px: tuple[int, int]
) -> None:
    poses = ahead(*((0, 0, z) for z in camera_z))
    views = view(Wall(30.0), board(velocity), poses, 0.5, 1.0)
    for frame, shift_px in zip(views.frames, shifts_px, strict=True):
        np.testing.assert_array_equal(is_red(frame), np.roll(board().mask, shift_px, axis=1))


def test_a_board_grows_as_it_approaches() -> None:
    # From z = 6 to 3: its outer pixels are 4 apart, and then 8, so that 9 x 9 are half covered.
    views = view(Wall(10.0), board((0.0, 0.0, -1.0)), ahead((0, 0, 2)), 1.0)
    mask = is_red(views.frames[0])
    assert mask.sum() == 81
    np.testing.assert_allclose(views.depths[0][mask], 3.0, rtol=1e-6)


@pytest.mark.parametrize(
    ("wall", "is_visible"),
    [
        (Wall(5.0), False),
        (Wall(5.95), True),  # the road at the foot of an object may be a little nearer
        (Wall(5.0, covered=False), True),  # inpainted pixels hide nothing
    ],
)
def test_nearer_surfaces_hide_the_board(wall: Wall, is_visible: bool) -> None:
    views = view(wall, board(), ahead((0, 0, 0)), 0.1)
    np.testing.assert_array_equal(is_red(views.frames[0]), board().mask & is_visible)
    np.testing.assert_array_equal(views.covered[0], (board().mask & is_visible) | wall.covered)


def test_the_nearer_of_two_boards_is_in_front_in_any_order() -> None:
    far = replace(board(), depth=8.0, frame=np.full((49, 65, 3), 90, np.uint8))
    for sprites in ([far, board()], [board(), far]):
        scene = DynamicScene(Wall(10.0), sprites, 0.0)
        views = scene.view(ahead((0, 0, 0)), np.array([0.1]), CAMERA)
        np.testing.assert_array_equal(is_red(views.frames[0]), board().mask)


@pytest.mark.parametrize(
    "twist", [(0, 0, 5.9, 0), (0, 0, 20, 0), (100, 0, 0, 0), (0, -90, 0, 0), (0, 0, 0, np.pi)]
)
def test_boards_too_near_or_out_of_view_are_not_rendered(
    twist: tuple[float, float, float, float],
) -> None:
    *shift, yaw = twist
    pose = se3.exp(np.array([*shift, 0, yaw, 0]))
    assert board().render(pose, CAMERA, 0.0) is None
    assert not is_red(view(Wall(10.0), board(), pose[None], 0.1).frames).any()


def test_a_turned_camera_sees_the_corners_where_they_project() -> None:
    turned = se3.exp(np.array([0.3, -0.1, 0.5, 0.02, 0.15, 0.05]))
    camera = Intrinsics(80.0, 70.0, 50.0, 30.0, 101, 61)
    layer = board().render(turned, camera, 0.2)
    assert layer is not None
    opacity = np.zeros((61, 101))
    opacity[layer.window] = layer.opacity
    assert 0 < (layer.opacity > 0).sum() < layer.opacity.size < opacity.size
    x = (np.array([30, 34]) - 32) / 60
    y = (np.array([22, 26]) - 24) / 60
    corners = DEPTH * np.stack([x, y, np.ones(2)], axis=-1)
    points = se3.transform(se3.inverse(turned), corners)
    u = 80 * points[:, 0] / points[:, 2] + 50
    v = 70 * points[:, 1] / points[:, 2] + 30
    assert (opacity[np.rint(v).astype(int), np.rint(u).astype(int)] > 0.1).all()
    rows, columns = np.nonzero(opacity > 0.5)
    assert abs(columns.mean() - u.mean()) < 0.5
    assert abs(rows.mean() - v.mean()) < 0.5


def test_objects_are_masked_out_where_they_were() -> None:
    # Half a second earlier the board was 5 pixels further left.
    inverse_depths = np.full((2, 49, 65), 0.1)
    poses = ahead((0, 0, 0), (0, 0, 0))
    sprites = [board((1.0, 0.0, 0.0))]
    depths, masks = mask_out(sprites, inverse_depths, poses, np.array([-0.5, 0]))
    for step, shift_px in enumerate((-5, 0)):
        expected = np.roll(board().mask, shift_px, axis=1)
        np.testing.assert_array_equal(masks[step], expected)
        np.testing.assert_allclose(depths[step], np.where(expected, 1 / DEPTH, 0.1))
    assert (inverse_depths == 0.1).all()
