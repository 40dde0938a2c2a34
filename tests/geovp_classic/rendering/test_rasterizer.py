"""The compiled rasteriser against a slow one that tests every pixel with every patch."""

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.geometry.epipolar import Epipolar
from geovp_classic.rendering.patches import Patches, PatchModel, concatenate
from geovp_classic.rendering.rasterizer import NO_INDEX
from geovp_classic.rendering.source import Source
from geovp_classic.types import BoolArray, FloatArray, Intrinsics

CAMERA = Intrinsics(40.0, 44.0, 19.5, 15.5, 40, 32)
SOURCE_CAMERA = Intrinsics(12.0, 12.0, 5.5, 4.5, 12, 10)
SOURCE = Source(np.zeros((10, 12, 3), np.uint8), SOURCE_CAMERA, np.eye(4))
MODEL = PatchModel()


def corner(
    pixel: FloatArray, q: float, slope: FloatArray, offset: FloatArray, epipolar: Epipolar
) -> FloatArray:
    """Return (x, y, inverse depth, z) of one corner; no slope leads beyond infinity."""
    steepness = MODEL.half_px * np.abs(slope).sum()
    flatter = min(1.0, q / steepness if steepness > 0 else 1.0)
    corner_q = q + flatter * slope @ offset
    point = epipolar.infinity @ [*(pixel + offset), 1.0] + corner_q * epipolar.epipole
    return np.array([*(point[:2] / point[2]), corner_q / point[2], point[2]])


def slow_rasterise(
    cloud: Patches, sources: list[Source], pose: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return inverse depth [H, W], -1 for none, and pixels away from all outlines [H, W]."""
    depth = np.full((CAMERA.height_px, CAMERA.width_px), -1.0)
    is_clear = np.ones(depth.shape, bool)
    column, row = np.meshgrid(np.arange(CAMERA.width_px), np.arange(CAMERA.height_px))
    offsets = MODEL.half_px * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    for n in range(len(cloud.source)):
        source = sources[cloud.source[n]]
        cam_from_source = se3.inverse(pose) @ source.world_from_source
        epipolar = Epipolar.of(source.camera, cam_from_source, CAMERA)
        patch = cloud.pixels[n], cloud.inverse_depth[n], cloud.slope[n]
        x, y, q, z = np.array([corner(*patch, offset, epipolar) for offset in offsets]).T
        if z.min() < 1e-3:
            continue
        plane = np.linalg.lstsq(np.column_stack([x, y, np.ones(4)]), q, rcond=None)[0]
        value = np.clip(plane[0] * column + plane[1] * row + plane[2], q.min(), q.max())
        along_x = np.roll(x, -1) - x
        along_y = np.roll(y, -1) - y
        sides = along_x * (row[..., None] - y) - along_y * (column[..., None] - x)
        is_inside = (sides >= 0).all(axis=-1) | (sides <= 0).all(axis=-1)
        depth = np.where(is_inside & (value > depth), value, depth)
        is_clear &= (np.abs(sides) > 1e-4 * np.hypot(along_x, along_y)).all(axis=-1)
    return depth, is_clear


def test_views_match_the_slow_rasteriser() -> None:
    rng = np.random.default_rng(0)
    clouds = []
    sources = []
    for number, twist in enumerate([np.zeros(6), np.array([0.5, 0.1, -0.3, 0.05, -0.1, 0.2])]):
        inverse_depth = rng.uniform(0.02, 0.5, (10, 12))
        inverse_depth[:3] = 0  # sky
        is_known = rng.random((10, 12)) < 0.9
        clouds.append(MODEL.from_depth_map(inverse_depth, is_known, number))
        sources.append(Source(SOURCE.frame, SOURCE_CAMERA, se3.exp(twist)))
    cloud = concatenate(clouds)
    twists = [
        [0, 0, 0.5, 0, 0, 0],
        [0.3, 0, 1.5, 0.1, 0.3, 0.1],
        [0, 0, -2, 0, 0, 0],
        [0, 0, 3, 0, 3, 0],
    ]
    poses = se3.exp(np.array(twists, float))
    rendered, winner = MODEL.rasterise(cloud, sources, poses, CAMERA)
    np.testing.assert_array_equal(winner == NO_INDEX, rendered < 0)
    for step, pose in enumerate(poses):
        expected, is_clear = slow_rasterise(cloud, sources, pose)
        assert is_clear.mean() > 0.9
        np.testing.assert_array_equal((rendered[step] >= 0)[is_clear], (expected >= 0)[is_clear])
        error = np.abs(rendered[step] - expected)[is_clear]
        # The plane through four corners is not unique where these are not coplanar.
        assert (error < 1e-3 * (1 + np.abs(expected[is_clear]))).mean() > 0.97
    assert (rendered[:3] >= 0).mean() > 0.3


def patches_at_the_centre(*inverse_depths: float) -> Patches:
    count = len(inverse_depths)
    return Patches(
        np.array([[5.5, 4.5]] * count, np.float32),
        np.array(inverse_depths, np.float32),
        np.zeros((count, 2), np.float32),
        np.zeros(count, np.int32),
    )


def test_the_sky_is_behind_everything_and_too_near_patches_are_left_out() -> None:
    poses = se3.compose(np.eye(3), np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.9999]]))
    _, winner = MODEL.rasterise(patches_at_the_centre(0.0, 0.5), [SOURCE], poses, CAMERA)
    assert winner[0, 15, 19] == 1
    assert winner[1, 15, 19] == 0  # the other patch, at 2 m, is 0.1 mm in front of the camera


def test_coarse_views_show_the_same_with_fewer_patches() -> None:
    camera = Intrinsics(100.0, 100.0, 49.5, 39.5, 100, 80)
    source = Source(np.zeros((80, 100, 3), np.uint8), camera, np.eye(4))
    inverse_depth = np.where(np.arange(100) < 60, 0.1, 0.5) + np.zeros((80, 1))
    cloud = MODEL.from_depth_map(inverse_depth, np.ones((80, 100), bool), 0)
    poses = se3.compose(np.eye(3), np.array([[0.0, 0, 0], [0, 0, 1.0]]))
    fine, _ = MODEL.rasterise(cloud, [source], poses, camera)
    coarse, _ = MODEL.rasterise(cloud, [source], poses, camera.resized(10, 8))
    assert (coarse[0] > 0).all()
    # The middle of a coarse pixel lies between two fine ones.
    is_same = (fine[:, 4::10, 4::10] == fine[:, 5::10, 5::10]) & (coarse > 0)
    assert is_same.mean() > 0.8
    np.testing.assert_allclose(coarse[is_same], fine[:, 4::10, 4::10][is_same], rtol=1e-5)
