"""Moving things: drawn where they have got to, hidden by what is nearer, and kept out of what
stands.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from geovp_classic.dynamic_objects.sprites import DynamicScene, Sprite, mask_out
from geovp_classic.geometry import se3
from geovp_classic.types import BoolArray, FloatArray, Intrinsics, Views

CAMERA = Intrinsics(60.0, 60.0, 32.0, 24.0, 65, 49)
DEPTH = 6.0


def board(
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0), source: FloatArray | None = None
) -> Sprite:
    """A red board over columns 30 to 34 and rows 22 to 26 of a grey image: 0.5 x 0.5 at z = 6."""
    frame = np.full((49, 65, 3), 90, np.uint8)
    mask = np.zeros((49, 65), dtype=bool)
    mask[22:27, 30:35] = True
    frame[mask] = [200, 10, 10]
    return Sprite(
        frame, mask, CAMERA, np.eye(4) if source is None else source, DEPTH, np.array(velocity)
    )


@dataclass(frozen=True)
class Wall:
    """A blue wall that every camera sees at the same depth; covered as told."""

    depth: float
    covered: bool = True

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        size = (len(world_from_cam), intrinsics.height_px, intrinsics.width_px)
        frames = np.tile(np.array([0, 0, 250], np.uint8), (*size, 1))
        depths = np.full(size, self.depth if self.covered else 0, np.float32)
        return Views(frames, np.full(size, self.covered), depths)


def ahead(*shifts: tuple[float, float, float]) -> FloatArray:
    return se3.compose(np.eye(3), np.array(shifts, dtype=float))


def red(frame: FloatArray) -> BoolArray:
    return np.asarray((frame[..., 0] > 150) & (frame[..., 2] < 60))


def test_a_board_is_seen_as_it_was_from_where_it_was_seen() -> None:
    views = DynamicScene(Wall(10.0), (board(),), 0.0).view(np.eye(4)[None], np.array([0.1]), CAMERA)
    np.testing.assert_array_equal(red(views.frames[0]), board().mask)
    np.testing.assert_allclose(views.depths[0][board().mask], DEPTH, rtol=1e-6)
    np.testing.assert_allclose(views.depths[0][~board().mask], 10.0)
    assert (views.frames[0][~board().mask] == [0, 0, 250]).all()


def test_it_moves_with_its_own_velocity() -> None:
    # 1 m/s to the right for 0.5 s at z = 6 with f = 60: 5 pixels; twice the time, twice as far.
    views = DynamicScene(Wall(10.0), (board((1.0, 0.0, 0.0)),), 0.0).view(
        ahead((0, 0, 0), (0, 0, 0)), np.array([0.5, 1.0]), CAMERA
    )
    for frame, shift_px in zip(views.frames, (5, 10), strict=True):
        np.testing.assert_array_equal(red(frame), np.roll(board().mask, shift_px, axis=1))


def test_it_grows_as_it_comes_nearer() -> None:
    # The camera 2 m on and the board 1 m nearer within the second: from z = 6 to 3. Its outer
    # pixels are 4 apart, and
    # then 8: 9 x 9 pixels are more than half covered.
    views = DynamicScene(Wall(10.0), (board((0.0, 0.0, -1.0)),), 0.0).view(
        ahead((0, 0, 2)), np.array([1.0]), CAMERA
    )
    assert red(views.frames[0]).sum() == 81
    np.testing.assert_allclose(views.depths[0][red(views.frames[0])], 3.0, rtol=1e-6)


def test_a_board_that_keeps_the_cameras_speed_stays_in_its_place() -> None:
    views = DynamicScene(Wall(30.0), (board((0.0, 0.0, 8.0)),), 0.0).view(
        ahead((0, 0, 4), (0, 0, 8)), np.array([0.5, 1.0]), CAMERA
    )
    for frame in views.frames:
        np.testing.assert_array_equal(red(frame), board().mask)


def test_what_stands_nearer_hides_it_and_what_was_invented_does_not() -> None:
    now, times_s = np.eye(4)[None], np.array([0.1])
    assert not red(
        DynamicScene(Wall(5.0), (board(),), 0.0).view(now, times_s, CAMERA).frames[0]
    ).any()
    # The road at its foot may be a little nearer than its flat image.
    assert red(DynamicScene(Wall(5.95), (board(),), 0.0).view(now, times_s, CAMERA).frames[0]).any()
    invented = DynamicScene(Wall(5.0, covered=False), (board(),), 0.0).view(now, times_s, CAMERA)
    np.testing.assert_array_equal(red(invented.frames[0]), board().mask)
    np.testing.assert_array_equal(invented.covered[0], board().mask)


def test_the_nearer_of_two_boards_wins_in_any_order() -> None:
    far = replace(board(), depth=8.0, frame=np.full((49, 65, 3), 90, np.uint8))
    for things in ((far, board()), (board(), far)):
        views = DynamicScene(Wall(10.0), things, 0.0).view(np.eye(4)[None], np.array([0.1]), CAMERA)
        np.testing.assert_array_equal(red(views.frames[0]), board().mask)


@pytest.mark.parametrize("shift", [(0, 0, 5.9), (0, 0, 20), (100, 0, 0), (0, -90, 0)])
def test_too_near_behind_or_beside_it_is_not_drawn(shift: tuple[float, float, float]) -> None:
    assert board().render(ahead(shift)[0], CAMERA, 0.0) is None
    views = DynamicScene(Wall(10.0), (board(),), 0.0).view(ahead(shift), np.array([0.1]), CAMERA)
    assert not red(views.frames[0]).any()


def test_looking_back_it_is_not_drawn() -> None:
    about = se3.exp(np.array([0, 0, 0, 0, np.pi, 0]))
    assert board().render(about, CAMERA, 0.0) is None


def test_the_window_changes_nothing() -> None:
    # A turned camera of another size sees in its window what it sees in the whole image.
    turned = se3.exp(np.array([0.3, -0.1, 0.5, 0.02, 0.15, 0.05]))
    wide = Intrinsics(80.0, 70.0, 50.0, 30.0, 101, 61)
    layer = board().render(turned, wide, 0.2)
    whole = np.zeros((61, 101))
    whole[layer.window] = layer.opacity
    assert 0 < (layer.opacity > 0).sum() < layer.opacity.size < whole.size
    points = DEPTH * np.stack(
        [(np.array([30, 34]) - 32) / 60, (np.array([22, 26]) - 24) / 60, np.ones(2)], -1
    )
    cam = se3.transform(se3.inverse(turned), points)  # two opposite corners of the board
    u, v = 80 * cam[:, 0] / cam[:, 2] + 50, 70 * cam[:, 1] / cam[:, 2] + 30
    for column, row in zip(np.rint(u).astype(int), np.rint(v).astype(int), strict=True):
        assert whole[row, column] > 0.1
    rows, columns = np.nonzero(whole > 0.5)
    assert abs(columns.mean() - u.mean()) < 0.5
    assert abs(rows.mean() - v.mean()) < 0.5


def test_the_street_is_cut_where_things_were_then() -> None:
    # Half a second earlier the board was 5 pixels further left; half-covered pixels go as well.
    inverse_depths, confidence = np.full((2, 49, 65), 0.1), np.ones((2, 49, 65))
    things = (board((1.0, 0.0, 0.0)),)
    depths, trust, where = mask_out(
        things, inverse_depths, confidence, ahead((0, 0, 0), (0, 0, 0)), np.array([-0.5, 0])
    )
    for step, shift_px in enumerate((-5, 0)):
        expected = np.zeros((49, 65), dtype=bool)
        expected[22:27, 30 + shift_px : 35 + shift_px] = True
        np.testing.assert_array_equal(where[step], expected)
        np.testing.assert_array_equal(trust[step] == 0, expected)
        np.testing.assert_allclose(depths[step][expected], 1 / DEPTH)  # it hid what was behind
        np.testing.assert_allclose(depths[step][~expected], 0.1)
    assert (inverse_depths == 0.1).all()
    assert (confidence == 1).all()


def test_without_things_nothing_is_cut() -> None:
    depths, confidence = np.full((2, 49, 65), 0.1), np.ones((2, 49, 65))
    same, trust, where = mask_out(
        (), depths, confidence, ahead((0, 0, 0), (0, 0, 1)), np.array([-0.1, 0])
    )
    np.testing.assert_array_equal(same, depths)
    np.testing.assert_array_equal(trust, confidence)
    assert not where.any()
