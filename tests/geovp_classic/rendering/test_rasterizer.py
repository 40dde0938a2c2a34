"""The compiled drawing of patches against a slow twin that meets every pixel with every patch."""

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.rendering import patches, rasterizer
from geovp_classic.types import BoolArray, FloatArray, Intrinsics

CAMERA = Intrinsics(40.0, 44.0, 19.5, 15.5, 40, 32)
SOURCE_CAMERA = Intrinsics(12.0, 12.0, 5.5, 4.5, 12, 10)


def corner(
    pixel: FloatArray, q: float, slope: FloatArray, offset: FloatArray, a: FloatArray, b: FloatArray
) -> FloatArray:
    """(x, y, inverse depth, z) of one corner, slopes made flatter where they would lead behind
    infinity.
    """
    rise = rasterizer.HALF_PX * np.abs(slope).sum()
    here = q + (slope * min(1.0, q / rise if rise > 0 else 1.0)) @ offset
    seen = a @ [*(pixel + offset), 1.0] + here * b
    return np.array([*(seen[:2] / seen[2]), here / seen[2], seen[2]])


def slow_rasterise(
    cloud: patches.Patches, sources: list[patches.Source], pose: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Inverse depth [H, W], -1 for nothing, and where no outline passes close to the pixel's
    centre.
    """
    drawn, clear = (
        np.full((CAMERA.height_px, CAMERA.width_px), -1.0),
        np.ones((CAMERA.height_px, CAMERA.width_px), bool),
    )
    column, row = np.meshgrid(np.arange(CAMERA.width_px), np.arange(CAMERA.height_px))
    for n in range(len(cloud)):
        a, b = (one[0] for one in patches.projections(sources[cloud.source[n]], pose[None], CAMERA))
        offsets = rasterizer.HALF_PX * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        quad = [
            corner(cloud.pixels[n], cloud.inverse_depth[n], cloud.slope[n], offset, a, b)
            for offset in offsets
        ]
        x, y, q, z = np.array(quad).T
        if z.min() < rasterizer.NEAR_SHARE:
            continue
        plane = np.linalg.lstsq(np.column_stack([x, y, np.ones(4)]), q, rcond=None)[0]
        here = np.clip(plane[0] * column + plane[1] * row + plane[2], q.min(), q.max())
        along_x, along_y = np.roll(x, -1) - x, np.roll(y, -1) - y
        sides = along_x * (row[..., None] - y) - along_y * (column[..., None] - x)
        inside = (sides >= 0).all(axis=-1) | (sides <= 0).all(axis=-1)
        drawn = np.where(inside & (here > drawn), here, drawn)
        clear &= (np.abs(sides) > 1e-4 * np.hypot(along_x, along_y)).all(axis=-1)
    return drawn, clear


def cloud_of(rng: np.random.Generator) -> tuple[patches.Patches, list[patches.Source]]:
    """Two sources of uneven surfaces, the sky above, one of them behind the other."""
    parts, sources = [], []
    for number, twist in enumerate([np.zeros(6), np.array([0.5, 0.1, -0.3, 0.05, -0.1, 0.2])]):
        inverse_depth = rng.uniform(0.02, 0.5, (10, 12))
        inverse_depth[:3] = 0
        parts.append(patches.from_depth_map(inverse_depth, rng.random((10, 12)) < 0.9, number))
        sources.append(
            patches.Source(np.zeros((10, 12, 3), np.uint8), SOURCE_CAMERA, se3.exp(twist))
        )
    return patches.concatenate(parts), sources


def test_every_pixel_shows_what_the_slow_twin_finds() -> None:
    cloud, sources = cloud_of(np.random.default_rng(0))
    poses = se3.exp(
        np.array(
            [
                [0, 0, 0.5, 0, 0, 0],
                [0.3, 0, 1.5, 0.1, 0.3, 0.1],
                [0, 0, -2, 0, 0, 0],
                [0, 0, 3, 0, 3, 0.0],
            ]
        )
    )
    drawn, winner = patches.rasterise(cloud, sources, poses, CAMERA)
    for step, pose in enumerate(poses):
        expected, clear = slow_rasterise(cloud, sources, pose)
        assert clear.mean() > 0.9
        np.testing.assert_array_equal((drawn[step] >= 0)[clear], (expected >= 0)[clear])
        close = np.abs(drawn[step] - expected)[clear] < 1e-3 * (1 + np.abs(expected[clear]))
        assert (
            close.mean() > 0.97
        )  # a plane through four corners is not unique where these are not flat
        np.testing.assert_array_equal(winner[step] == rasterizer.NO_INDEX, drawn[step] < 0)
    assert (drawn[:3] >= 0).mean() > 0.3


def test_one_patch_covers_the_pixels_it_should() -> None:
    patch = patches.Patches(
        np.array([[5.5, 4.5]], np.float32),
        np.array([0.5], np.float32),
        np.zeros((1, 2), np.float32),
        np.zeros(1, np.int32),
    )
    source = patches.Source(np.zeros((10, 12, 3), np.uint8), SOURCE_CAMERA, np.eye(4))
    drawn, winner = patches.rasterise(patch, [source], np.eye(4)[None], CAMERA)
    # 1.04 pixels of f = 12 are 3.47 of f = 40 and 3.81 of f = 44, around (19.5, 15.5): 4 x 4 pixel
    # centres.
    assert np.argwhere(winner[0] == 0).tolist() == [
        [row, column] for row in range(14, 18) for column in range(18, 22)
    ]
    np.testing.assert_allclose(drawn[0, 14:18, 18:22], 0.5)


def test_sky_is_drawn_behind_everything_and_what_is_too_near_is_not() -> None:
    patch = patches.Patches(
        np.array([[5.5, 4.5]] * 2, np.float32),
        np.array([0.0, 0.5], np.float32),
        np.zeros((2, 2), np.float32),
        np.zeros(2, np.int32),
    )
    source = patches.Source(np.zeros((10, 12, 3), np.uint8), SOURCE_CAMERA, np.eye(4))
    poses = se3.compose(np.eye(3), np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.9999]]))
    _, winner = patches.rasterise(patch, [source], poses, CAMERA)
    assert winner[0, 15, 19] == 1
    assert winner[1, 15, 19] == 0  # at 2 m, it is 0.1 mm before the camera


def test_a_coarse_view_shows_all_that_a_part_of_the_patches_stands_for() -> None:
    camera = Intrinsics(100.0, 100.0, 49.5, 39.5, 100, 80)
    source = patches.Source(np.zeros((80, 100, 3), np.uint8), camera, np.eye(4))
    inverse_depth = np.where(np.arange(100) < 60, 0.1, 0.5) + np.zeros(
        (80, 1)
    )  # the right part is nearer
    cloud = patches.from_depth_map(inverse_depth, np.ones((80, 100), bool), 0)
    poses = se3.compose(np.eye(3), np.array([[0.0, 0, 0], [0, 0, 1.0]]))
    fine, _ = patches.rasterise(cloud, [source], poses, camera)
    coarse, winner = patches.rasterise(cloud, [source], poses, camera.resized(10, 8))
    assert (coarse[0] > 0).all()
    middles = (
        fine[:, 4::10, 4::10],
        fine[:, 5::10, 5::10],
    )  # the pixels around the middle of a coarse one
    same = middles[0] == middles[1]
    assert same.mean() > 0.8
    same &= coarse > 0
    assert same.mean() > 0.8  # beside a near surface a gap may be wider
    np.testing.assert_allclose(coarse[same], middles[0][same], rtol=1e-5)
    # The pixel of the source that a patch shows lies within five pixels of where the view, ten
    # times as coarse, has it
    shown = cloud.pixels[winner[0]]
    expected = np.stack(np.meshgrid(np.arange(10), np.arange(8)), axis=-1) * 10 + 4.5
    assert np.abs(shown - expected).max() <= 5
