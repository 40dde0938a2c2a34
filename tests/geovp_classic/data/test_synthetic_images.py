"""Solids, textures, light and images of the synthetic street."""

import dataclasses

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from geovp_classic.data.synthetic import Synthetic, textures
from geovp_classic.data.synthetic.manoeuvres import MANOEUVRES
from geovp_classic.data.synthetic.rendering import Optics, Rendering, render_drive
from geovp_classic.data.synthetic.roads import Journey, Roads, from_bends
from geovp_classic.data.synthetic.solids import RayCaster, Solids, box_planes, joined
from geovp_classic.data.synthetic.street import Street, build_street
from geovp_classic.data.synthetic.textures import SIZE, Texture
from geovp_classic.data.synthetic.weather import Weather
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import BoolArray, ByteArray, Clip, FloatArray, Intrinsics

NOON = Weather(np.array([0.0, -1.0, 0.0]), sun=np.full(3, 0.5), cloud_shift=np.zeros(2))
CLEAN = Optics(haze_per_m=0.0, gloss=0.0, blur_px=0.0)
CAMERA = Intrinsics(489 / 4, 489 / 4, 31.5, 31.5, 64, 64)
UP_1M = se3.compose(np.eye(3), np.array([0.0, -1.0, 0.0]))  # 1 m above the ground, towards +z
PATH = from_bends([(100.0, 0.0)])


def solid(
    low: npt.ArrayLike,
    high: npt.ArrayLike,
    tint: npt.ArrayLike = (1, 1, 1),
    taper: tuple[float, ...] = (0.0,) * 4,
    is_round: bool = False,
) -> Solids:
    """Return one plain solid between two corners [3]."""
    frame = np.diag([*np.subtract(high, low), 1.0])
    frame[:3, 3] = low
    columns = (frame, box_planes(taper), is_round, [Texture.PLAIN] * 3, [tint] * 3)
    return Solids(*(np.array([column]) for column in columns))


def small_world(with_car: bool = False, weather: Weather = NOON) -> Street:
    """Return a floor, a wall of 3 m 20 m ahead, and a box that drives towards +x 10 m ahead."""
    floor = solid((-90, 0, -90), (90, 1, 90))
    wall = solid((-90, -3, 20), (90, 0, 21), (0.5, 0.1, 0.1))
    box = solid((-1, -2, -1), (1, 0, 1), (0.1, 0.1, 0.6))
    across = from_bends([(100.0, 0.0)], start=(0.0, 10.0), start_yaw_deg=90.0)
    traffic = [(box, Journey(across, 0.0, 0.0, [2.0]))] if with_car else []
    ego = Journey(PATH, 0.0, 1.65, [0.0])
    return Street(joined([floor, wall]), traffic, Roads([PATH]), weather, ego)


def render(
    world: Street,
    times_s: FloatArray = np.zeros(1),  # noqa: B008
    camera: Intrinsics = CAMERA,
    world_from_cam: FloatArray = UP_1M,
    optics: Optics = CLEAN,
) -> Rendering:
    """Render a world from one camera pose."""
    poses = np.repeat(world_from_cam[None], len(times_s), axis=0)
    return render_drive(world, poses, camera, times_s, optics)


def images(rendering: Rendering) -> ByteArray:
    """Return frames [T, H, W, 3] without noise."""
    return (255 * np.sqrt(np.clip(rendering.light, 0, 1)) + 0.5).astype(np.uint8)


@pytest.fixture(scope="module")
def street() -> Street:
    return build_street(3, "accelerate")


@pytest.mark.parametrize("is_round", [False, True])
def test_rays_agree_with_dense_steps_through_the_solids(is_round: bool) -> None:
    """In steps of 1 cm, the first point inside a moved solid is the first hit."""
    rng = np.random.default_rng(is_round)
    taper = (0.1, 0.3, 0.2, 0.4)
    solids = []
    for _ in range(12):
        middle = rng.uniform(-3, 3, 3)
        size = rng.uniform(0.5, 2.0, 3)
        moved = se3.exp(np.array([*middle, *rng.normal(size=3)]))
        solids.append(solid(-size / 2, size / 2, taper=taper, is_round=is_round).moved(moved))
    origin = np.array([0.0, 0.0, -9.0])
    directions = rng.uniform(-4, 4, (200, 3)) - origin
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    lengths, numbers, _ = RayCaster(joined(solids)).cast(origin, directions)
    steps_m = np.arange(0, 20, 0.01)
    points = origin + steps_m[:, None] * directions[:, None]  # [N, steps, 3]
    expected = np.full((12, 200), np.inf)
    for number, each in enumerate(solids):
        local = se3.transform(np.linalg.inv(each.world_from_local[0]), points.reshape(-1, 3))
        x, y, z = local.T
        if is_round:
            inside = np.square(local - 0.5).sum(axis=-1) < 0.25
        else:
            height = 1 - y
            inside = (height > 0) & (y > 0)
            inside &= (x > taper[0] * height) & (x < 1 - taper[1] * height)
            inside &= (z > taper[2] * height) & (z < 1 - taper[3] * height)
        inside = inside.reshape(points.shape[:2])
        first = steps_m[inside.argmax(axis=-1)]
        expected[number] = np.where(inside.any(axis=-1), first, np.inf)
    is_hit = np.isfinite(expected.min(axis=0))
    assert 40 < is_hit.sum() < 190
    np.testing.assert_allclose(lengths[is_hit], expected.min(axis=0)[is_hit], atol=0.0101)
    agree = numbers[is_hit] == expected.argmin(axis=0)[is_hit]
    assert agree.mean() > 0.97
    assert np.isinf(lengths[~is_hit]).mean() > 0.9  # steps miss edges


def test_a_large_footprint_shows_the_mean_of_a_texture() -> None:
    for texture in (Texture.GRASS, Texture.ROAD, Texture.LEAVES):
        mean = textures.mip_maps()[0][texture].mean(axis=(0, 1)) / 255
        for sides in ((np.array([[8.0, 0.0]]), 8.0), (np.array([[8.0, 8.0]]), 0.5)):
            colour = textures.sample(
                texture, np.array([[0.3, 0.8]]), sides[0], np.array([sides[1]])
            )
            np.testing.assert_allclose(colour[0], mean, atol=0.04)


def test_a_small_footprint_shows_a_bilinear_texel() -> None:
    image = textures.mip_maps()[0][Texture.BRICK] / 255
    uv = np.array([[(100 + 0.75) / SIZE, (SIZE + 0.5) / SIZE]])  # row 0 of the next tile
    colour = textures.sample(Texture.BRICK, uv, np.zeros((1, 2)), np.zeros(1))
    np.testing.assert_allclose(colour[0], 0.75 * image[0, 100] + 0.25 * image[0, 101], atol=1e-9)


def test_textures_have_contrast_and_untinted_parts() -> None:
    for texture in set(Texture) - {Texture.GROUND}:
        image = textures.mip_maps()[0][texture] / 255
        assert image[..., :3].std() > 0.005, texture.name
        is_partly_tinted = texture.name.endswith(("_WINDOWS", "_SIDE", "_NOSE", "_TAIL"))
        assert is_partly_tinted <= (image[..., 3].min() == 0.0)


def test_depth_shows_the_ground_plane_the_wall_and_the_sky() -> None:
    depth = render(small_world()).depths[0]
    down = pinhole.rays(CAMERA)[..., 1]
    ground = np.where(down > 1 / 20, 1.0 / np.maximum(down, 1e-9), np.inf)  # 1 m below the eye
    wall = np.where((down > -2 / 20) & (down <= 1 / 20), 20.0, np.inf)  # 1 m below to 2 m above
    np.testing.assert_allclose(depth, np.minimum(ground, wall), rtol=1e-5)
    assert np.isinf(depth[0]).all()


def test_a_level_floor_at_noon_reflects_sun_and_sky() -> None:
    light = render(small_world()).light[0]
    ambient = np.array(NOON.ambient)
    assert light[-8:].mean() == pytest.approx(0.93**2 * (0.5 + ambient.mean()), rel=0.06)
    tint = np.array([0.25, 0.01, 0.01])  # squared; the upright wall gets three quarters of the sky
    wall = light[30].mean(axis=0)
    np.testing.assert_allclose(wall, 0.93**2 * ambient * 0.75 * tint, rtol=0.08)


def test_haze_hides_half_at_its_half_distance() -> None:
    hazy, clear = (
        render(small_world(), optics=dataclasses.replace(CLEAN, haze_per_m=haze_per_m)).light[
            0, 30, 32
        ]
        for haze_per_m in (np.log(2) / 20.0, 0.0)
    )
    np.testing.assert_allclose(hazy, 0.5 * clear + 0.5 * np.array(NOON.horizon), rtol=2e-3)


def test_the_sky_is_blue_above_pale_below_bright_at_the_sun_and_cloudy() -> None:
    to_sun = np.array([0.0, -0.6, 0.8])
    day, other = (Weather(side * to_sun, np.ones(3), np.zeros(2)) for side in (1, -1))
    rays = np.array([(0, -1, 0), (-1, 0, 0), to_sun])
    zenith, horizon, glow = day.sky_light(rays)
    np.testing.assert_allclose(horizon, day.horizon, atol=1e-4)
    assert zenith[2] > zenith[0]
    np.testing.assert_allclose(glow - other.sky_light(rays)[2], 0.35, atol=1e-6)
    rays = np.random.default_rng(2).normal(size=(500, 3)) * [1.0, 0.0, 1.0] + [0.0, -0.8, 0.0]
    sky = day.sky_light(rays / np.linalg.norm(rays, axis=-1, keepdims=True))
    assert np.ptp(sky[:, 2] / sky[:, 0]) > 0.5


def test_moving_objects_are_marked() -> None:
    rendering = render(small_world(with_car=True), np.array([0.0, 0.5, 60.0]))
    empty = render(small_world())
    is_box = rendering.depths[0] < empty.depths[0] - 0.01
    np.testing.assert_allclose(rendering.depths[0][20:30, 26:38], 9.0, rtol=1e-4)  # near face
    assert rendering.moving[0][is_box].all()
    assert not rendering.moving[2].any()  # the box has left
    np.testing.assert_array_equal(images(rendering)[2], images(empty)[0])
    columns = [np.nonzero(mask)[1].mean() for mask in rendering.moving[:2]]
    expected_px = 1.0 * CAMERA.fx_px / 9.5  # 2 m/s for 0.5 s, at 9 to 10 m
    assert columns[1] - columns[0] == pytest.approx(expected_px, rel=0.1)


def test_shadows_of_moving_objects_are_dark_and_marked() -> None:
    low_sun = Weather(np.array([-0.8, -0.6, 0.0]), NOON.sun, NOON.cloud_shift)
    camera = Intrinsics(61.0, 61.0, 63.5, 31.5, 128, 64)
    above = se3.compose(np.eye(3), np.array([0.0, -4.0, 0.0]))
    rendering = render(small_world(True, low_sun), camera=camera, world_from_cam=above)
    beside = np.array([[2.0, 4.0, 10.0], [-2.0, 4.0, 10.0]])  # on the floor, right and left
    pixels, _ = pinhole.project(beside, camera)
    column, row = np.round(pixels).astype(int).T
    assert rendering.moving[0, row, column].tolist() == [True, False]
    shadow, floor = rendering.light[0, row, column].sum(axis=-1)
    assert shadow < 0.6 * floor


def test_edges_are_averaged_and_surfaces_are_not() -> None:
    """Pixels lie between only where the rolled foot of the red wall meets the grey floor."""
    roll = se3.exp(np.array([0, 0, 0, 0, 0, 0.1]))
    green = render(small_world(), world_from_cam=UP_1M @ roll).light[0, 28:, :, 1]
    wall, floor = green[0, 10], green[-1].mean()
    between = (green > 2 * wall) & (green < 0.85 * floor)
    assert 30 < between.sum() < 80  # the foot runs through all 64 columns
    assert between.sum(axis=0).max() <= 2


@pytest.mark.parametrize("blur_px", [0.3, 2.0])
def test_the_lens_keeps_light_and_spreads_it(blur_px: float) -> None:
    """A crop of the wide image is the image of the narrow camera, and blur only smooths."""
    wide = CAMERA.cropped(-16, 0, 96, 64)
    sharp = render(small_world()).light[0]
    blur = dataclasses.replace(CLEAN, blur_px=blur_px)
    blurred = render(small_world(), optics=blur).light[0]
    whole = render(small_world(), camera=wide, optics=blur).light[0]
    np.testing.assert_allclose(whole[:, 16:80], blurred, atol=1e-9)
    assert blurred.mean() == pytest.approx(sharp.mean(), rel=0.01)
    assert np.abs(np.diff(blurred, axis=0)).max() < np.abs(np.diff(sharp, axis=0)).max()


def test_noise_and_exposure_have_the_given_amplitudes() -> None:
    still, noisy, drifting = (
        waiting(noise=noise, exposure_drift=drift).frames.astype(float)
        for noise, drift in ((0.0, 0.0), (3.0, 0.0), (0.0, 0.1))
    )
    is_unclipped = (still > 20) & (still < 235)
    difference = (noisy - still)[is_unclipped]
    assert difference.std() == pytest.approx((3.0**2 + 1 / 6) ** 0.5, rel=0.02)  # rounded twice
    is_static = np.ptp(still, axis=0) == 0
    assert is_static.mean() > 0.5
    is_static &= is_unclipped[0] & (drifting < 235).all(axis=0)
    gain = (drifting / still)[:, is_static].mean(axis=1)
    assert 0.02 < gain.std() < 0.1  # half of 10 %, for light under the square root
    assert np.abs(np.diff(gain)).max() < 0.04


def waiting(**settings: float) -> Clip:
    """Return the clip of the camera that stands at a crossing."""
    return Synthetic(num_frames=40, size_px=(24, 16), **settings)[7]


def poses_of(manoeuvre: str, seed: int = 0, **settings: float) -> FloatArray:
    """Return world_from_cam [60, 4, 4] of a drive of six seconds."""
    data = Synthetic(seed=seed, num_frames=60, size_px=(1, 1), **settings)
    return data[list(MANOEUVRES).index(manoeuvre)].trajectory.world_from_cam


def backward_warp(
    rendering: Rendering, camera: Intrinsics, poses: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return the last image made from the first, and where both show the same static surface."""
    inverse = 1 / rendering.depths.astype(np.float64)  # first and last
    points = pinhole.rays(camera) / np.maximum(inverse[1], 1e-9)[..., None]
    first_from_last = se3.inverse(poses[0]) @ poses[1]
    in_first = se3.transform(first_from_last, points.reshape(-1, 3))
    pixels, depth = pinhole.project(in_first, camera)
    u, v = pixels.astype(np.float32).reshape(*inverse[1].shape, 2).transpose(2, 0, 1)
    expected = 1 / depth.reshape(inverse[1].shape)

    def warp(image: npt.ArrayLike, interpolation: int) -> FloatArray:
        return cv2.remap(np.asarray(image, np.float32), u, v, interpolation)

    is_same = np.abs(warp(inverse[0], cv2.INTER_NEAREST) - expected) < 0.02 * expected
    for number, is_static in enumerate(~rendering.moving):
        edges = cv2.dilate(inverse[number], np.ones((3, 3)))
        edges -= cv2.erode(inverse[number], np.ones((3, 3)))
        is_good = is_static & (edges < 0.1 * inverse[number])
        is_same &= is_good if number else warp(is_good, cv2.INTER_NEAREST) > 0
    return warp(images(rendering)[0], cv2.INTER_LINEAR), is_same


@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(0.0, 0.0), (-4.0, 6.0)])
def test_exact_depth_and_poses_warp_one_image_into_the_next(
    street: Street, pitch_deg: float, roll_deg: float
) -> None:
    """At least 35 dB on the same static surfaces away from depth edges, half a metre on."""
    times_s = np.array([2.0, 2.1])
    camera = CAMERA.resized(192, 192)
    poses = poses_of("accelerate", 3, pitch_deg=pitch_deg, roll_deg=roll_deg)[20:22]
    assert 0.4 < np.linalg.norm(np.diff(poses[:, :3, 3], axis=0)) < 0.8
    optics = Optics(haze_per_m=0.0, gloss=0.0, blur_px=0.8, finest_detail_m=0.3)
    rendering = render_drive(street, poses, camera, times_s, optics)
    warped, is_same = backward_warp(rendering, camera, poses)
    first, last = images(rendering).astype(float)
    error = np.square(warped - last)[is_same].mean()
    assert is_same.mean() > 0.3
    assert 10 * np.log10(255**2 / error) > 35.0
    assert np.square(first - last)[is_same].mean() > 4 * error  # the camera did move


def test_the_camera_keeps_its_height_and_the_mount_its_angles() -> None:
    shaken, calm, tilted = (
        poses_of("accelerate", **settings)
        for settings in ({}, {"bounce": 0.0}, {"pitch_deg": 5.0, "roll_deg": 3.0})
    )
    for poses, tolerance_m in ((shaken, 0.03), (calm, 1e-9)):
        np.testing.assert_allclose(-poses[:, 1, 3], 1.65, atol=tolerance_m)
    shaken_deg = np.rad2deg(se3.rotation_angle_rad(se3.inverse(calm) @ shaken))
    assert 0.05 < shaken_deg.max() < 2.0
    turn = (se3.inverse(shaken) @ tilted)[0]
    assert np.rad2deg(np.arcsin(-turn[1, 2])) == pytest.approx(5.0)  # looks up: -y
    assert np.rad2deg(se3.rotation_angle_rad(turn)) == pytest.approx(np.hypot(5.0, 3.0), abs=0.05)


@pytest.mark.parametrize("manoeuvre", ["winding", "right-turn"])
def test_streets_are_furnished_and_the_road_is_free(manoeuvre: str) -> None:
    world, again = build_street(1, manoeuvre), build_street.__wrapped__(1, manoeuvre)
    for values, same in zip(world.static, again.static, strict=True):
        np.testing.assert_array_equal(values, same)
    shown = np.bincount(world.static.textures.ravel(), minlength=len(Texture))
    assert (shown[[Texture.LEAVES, Texture.ROOF, Texture.CAR_SIDE, Texture.WHEEL]] > 10).all()
    times_s = np.arange(0, 6, 0.5)
    poses = poses_of(manoeuvre, 1)[::5]
    camera = CAMERA.resized(32, 32)
    rendering = render_drive(world, poses, camera, times_s, Optics())
    assert rendering.depths.min() > 1.2  # never inside an object
    assert 0.05 < np.isinf(rendering.depths).mean() < 0.5
    assert (rendering.depths < 40).mean() > 0.3
    frames = images(rendering)
    assert 60 < frames.mean() < 170
    assert frames.reshape(-1, 3).std(axis=0).min() > 30
    elevation_deg = np.rad2deg(np.arcsin(-world.weather.to_sun[1]))  # y points down
    assert 30.0 <= elevation_deg <= 55.0
