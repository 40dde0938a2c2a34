"""Images of small made-up worlds whose depths and colours are known, and of the street itself."""

import cv2
import numpy as np
import pytest

from geovp_classic.data.synthetic.drive import (
    CAMERA_HEIGHT_M,
    Journey,
    Manoeuvre,
    Speed,
    expose,
    square_camera,
    wide_camera,
    world_from_camera,
)
from geovp_classic.data.synthetic.images import Texture
from geovp_classic.data.synthetic.mesh import WHITE, box, joined, sheet
from geovp_classic.data.synthetic.render import Rendering, render_drive
from geovp_classic.data.synthetic.roads import Terrain, straight
from geovp_classic.data.synthetic.shading import AMBIENT, Optics, Weather
from geovp_classic.data.synthetic.street import Street, build_street
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics

FLAT = Terrain(np.zeros(1), np.zeros((1, 2)), np.zeros(1))
NOON = Weather(
    to_sun=np.array([0.0, -1.0, 0.0], dtype=np.float32),
    sun=np.full(3, 0.5, dtype=np.float32),
    cloud_shift=np.zeros(2, dtype=np.float32),
)
CLEAN = Optics(haze_per_m=0.0, gloss=0.0, blur_px=0.0)
CAMERA = square_camera((64, 64))
UP_1M = se3.compose(np.eye(3), np.array([0.0, -1.0, 0.0]))[
    None
]  # 1 m above the ground, level, towards +z
ROAD = straight((0.0, 0.0), 0.0, 100.0)


def made_up_street(with_car: bool = False) -> Street:
    """A floor, a wall 20 m ahead that is 3 m high, and perhaps a box that drives towards +x 10 m
    ahead.
    """
    floor = sheet(
        [[(-90, 0, 90), (90, 0, 90)], [(-90, 0, -90), (90, 0, -90)]], Texture.PLAIN, WHITE
    )
    wall = sheet(
        [[(-90, -3, 20), (90, -3, 20)], [(-90, 0, 20), (90, 0, 20)]], Texture.PLAIN, (0.5, 0.1, 0.1)
    )
    car = box((-1, -2, -1), (1, 0, 1), Texture.PLAIN, (0.1, 0.1, 0.6))
    across = Journey(
        straight((0.0, 10.0), np.pi / 2, 100.0), Speed([0.0], [2.0]), start_m=0.0, right_m=0.0
    )
    ego = Journey(ROAD, Speed([0.0], [0.0]), 0.0)
    return Street(joined([floor, wall]), [(car, across)] if with_car else [], FLAT, NOON, ego)


def images(rendering: Rendering) -> ByteArray:
    """Frames [T, H, W, 3] without noise."""
    return expose(rendering.light, rendering.light.shape[2], np.random.default_rng(0), 0.0, 0.0)


def camera_of(
    street: Street, times_s: FloatArray, seed: int = 0, bounce: float = 1.0
) -> FloatArray:
    """world_from_cam [T, 4, 4] of a level mount."""
    return world_from_camera(street.ego, street.terrain, times_s, seed, 0.0, 0.0, bounce)


@pytest.fixture(scope="module")
def street() -> Street:
    return build_street(3, Manoeuvre.ACCELERATE)


def test_depth_is_the_ground_plane_the_wall_and_the_sky() -> None:
    depth = render_drive(made_up_street(), UP_1M, CAMERA, np.zeros(1), Optics()).depths[0]
    rays = pinhole.rays(CAMERA)
    down = rays[..., 1]
    ground = np.where(down > 1 / 20, 1.0 / np.maximum(down, 1e-9), np.inf)  # a metre below the eye
    wall = np.where(
        (down > -2 / 20) & (down <= 1 / 20), 20.0, np.inf
    )  # from 1 m below to 2 m above it
    np.testing.assert_allclose(depth, np.minimum(ground, wall), rtol=1e-5)
    assert np.isinf(depth[0]).all()


def test_a_level_floor_at_noon_reflects_sun_and_sky() -> None:
    rendering = render_drive(made_up_street(), UP_1M, CAMERA, np.zeros(1), CLEAN)
    floor = rendering.light[0, -8:].mean()
    assert floor == pytest.approx(
        0.93**2 * (0.5 + AMBIENT.mean()), rel=0.06
    )  # PLAIN is 0.93 in display brightness
    wall = rendering.light[0, 30]  # upright: no sun from the zenith, three quarters of the sky
    np.testing.assert_allclose(
        wall.mean(axis=0), 0.93**2 * AMBIENT * 0.75 * np.array([0.25, 0.01, 0.01]), rtol=0.08
    )


def test_moving_things_are_marked_with_their_shadows_and_nothing_else() -> None:
    times_s = np.array([0.0, 0.5, 60.0])
    world = made_up_street(with_car=True)
    rendering = render_drive(world, np.repeat(UP_1M, 3, axis=0), CAMERA, times_s, Optics())
    empty = render_drive(made_up_street(), UP_1M, CAMERA, np.zeros(1), Optics())
    box = rendering.depths[0] < empty.depths[0] - 0.01
    np.testing.assert_allclose(
        rendering.depths[0][20:30, 26:38], 9.0, rtol=1e-4
    )  # the near face of the box
    assert rendering.moving[0][box].all()
    assert not rendering.moving[2].any()  # it has left
    np.testing.assert_array_equal(images(rendering)[2], images(empty)[0])
    shift_px = np.nonzero(rendering.moving[1])[1].mean() - np.nonzero(rendering.moving[0])[1].mean()
    assert shift_px == pytest.approx(
        1.0 * CAMERA.fx_px / 9.5, rel=0.1
    )  # 2 m/s for 0.5 s, at 9 to 10 m


def test_a_low_sun_throws_the_shadow_of_a_moving_thing_and_marks_it() -> None:
    low_sun = Weather(**(vars(NOON) | {"to_sun": np.array([-0.8, -0.6, 0.0], dtype=np.float32)}))
    world = Street(**(vars(made_up_street(with_car=True)) | {"weather": low_sun}))
    camera = Intrinsics(61.0, 61.0, 63.5, 31.5, 128, 64)
    above = se3.compose(np.eye(3), np.array([0.0, -4.0, 0.0]))[None]
    rendering = render_drive(world, above, camera, np.zeros(1), CLEAN)
    pixels, _ = pinhole.project(
        np.array([[2.0, 4.0, 10.0], [-2.0, 4.0, 10.0]]), camera
    )  # on the floor beside it
    (right_u, right_v), (left_u, left_v) = np.round(pixels).astype(int)
    assert rendering.moving[0, right_v, right_u]
    assert not rendering.moving[0, left_v, left_u]
    assert (
        rendering.light[0, right_v, right_u].sum() < 0.6 * rendering.light[0, left_v, left_u].sum()
    )


def test_edges_are_mixed_and_surfaces_are_not() -> None:
    """Where the rolled foot of the red wall meets the grey floor, pixels lie between; nowhere else
    below the sky.
    """
    roll = se3.exp(np.array([0, 0, 0, 0, 0, 0.1]))
    light = render_drive(made_up_street(), UP_1M @ roll, CAMERA, np.zeros(1), CLEAN).light[0, 28:]
    green = light[..., 1]
    wall, floor = green[0, 10], green[-1].mean()
    between = (green > 2 * wall) & (green < 0.85 * floor)
    assert 30 < between.sum() < 80  # the foot runs through all 64 columns
    assert between.sum(axis=0).max() <= 2


def backward_warp(
    rendering: Rendering, camera: Intrinsics, poses: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """The last image made from the first by exact depth and poses, and where both show the same
    static surface.
    """
    depth, first = rendering.depths[-1].astype(np.float64), rendering.depths[0]
    solid = np.isfinite(depth)
    points = pinhole.unproject(pinhole.pixel_grid(camera), np.where(solid, depth, 1.0), camera)
    first_from_last = se3.inverse(poses[0]) @ poses[-1]
    pixels, seen_depth = pinhole.project(
        se3.transform(first_from_last, points.reshape(-1, 3)), camera
    )
    u, v = pixels.astype(np.float32).reshape(*depth.shape, 2).transpose(2, 0, 1)
    image = cv2.remap(images(rendering)[0].astype(np.float32), u, v, cv2.INTER_LINEAR)
    steps = [_smooth(1 / first), _smooth(1 / depth)]
    nearest = [
        cv2.remap(np.asarray(image, np.float32), u, v, cv2.INTER_NEAREST)
        for image in (1 / first, *steps[:1])
    ]
    inverse = 1 / seen_depth.reshape(depth.shape)
    same = solid & (np.abs(nearest[0] - inverse) < 0.02 * inverse) & (nearest[1] > 0) & steps[1]
    inside = (u >= 0) & (v >= 0) & (u <= camera.width_px - 1) & (v <= camera.height_px - 1)
    still = cv2.remap(rendering.moving[0].astype(np.float32), u, v, cv2.INTER_NEAREST) == 0
    return image, same & inside & still & ~rendering.moving[-1]


def _smooth(inverse_depth: FloatArray) -> BoolArray:
    """Pixels with no depth edge around them."""
    kernel = np.ones((3, 3))
    spread = cv2.dilate(inverse_depth, kernel) - cv2.erode(inverse_depth, kernel)
    return np.asarray(spread < 0.1 * inverse_depth)


@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(0.0, 0.0), (-4.0, 6.0)])
def test_exact_depth_and_poses_carry_one_image_into_the_next(
    street: Street, pitch_deg: float, roll_deg: float
) -> None:
    """At least 35 dB where both show the same static surface away from depth edges, half a metre
    on.
    """
    times_s = np.array([2.0, 2.1])
    camera = square_camera((192, 192))
    poses = world_from_camera(street.ego, street.terrain, times_s, 0, pitch_deg, roll_deg, 1.0)
    assert 0.4 < np.linalg.norm(np.diff(poses[:, :3, 3], axis=0)) < 0.8
    optics = Optics(haze_per_m=0.0, gloss=0.0, blur_px=0.8, finest_detail_m=0.3)
    rendering = render_drive(street, poses, camera, times_s, optics)
    image, same = backward_warp(rendering, camera, poses)
    error = (image[same] - images(rendering)[1][same]) ** 2
    assert same.mean() > 0.3
    assert 10 * np.log10(255**2 / error.mean()) > 35.0
    wrong = (images(rendering)[0][same].astype(float) - images(rendering)[1][same]) ** 2
    assert wrong.mean() > 4 * error.mean()  # not because nothing moved


def test_the_camera_rides_at_its_height_above_the_road(street: Street) -> None:
    times_s = np.arange(0, 6, 0.1)
    poses = camera_of(street, times_s)
    height_m = -poses[:, 1, 3] - street.terrain.height_m(poses[:, [0, 2], 3])
    np.testing.assert_allclose(height_m, CAMERA_HEIGHT_M, atol=0.03)
    calm = camera_of(street, times_s, bounce=0.0)
    height_m = -calm[:, 1, 3] - street.terrain.height_m(calm[:, [0, 2], 3])
    np.testing.assert_allclose(height_m, CAMERA_HEIGHT_M, atol=2e-3)  # along the slope's normal
    shaken_deg = np.rad2deg(se3.rotation_angle_rad(se3.inverse(calm) @ poses))
    assert 0.05 < shaken_deg.max() < 2.0


def test_the_mount_pitches_and_rolls_the_camera(street: Street) -> None:
    level, mounted = (
        world_from_camera(street.ego, street.terrain, np.zeros(1), 0, pitch, roll, 1.0)
        for pitch, roll in ((0, 0), (5.0, 3.0))
    )
    turn = (se3.inverse(level) @ mounted)[0]
    assert np.rad2deg(np.arcsin(-turn[1, 2])) == pytest.approx(5.0)  # looks up: -y
    np.testing.assert_allclose(turn[:3, 3], 0.0, atol=1e-9)
    assert np.rad2deg(se3.rotation_angle_rad(turn)) == pytest.approx(np.hypot(5.0, 3.0), abs=0.05)


def test_the_square_camera_is_the_middle_of_the_wide_one() -> None:
    square, wide = square_camera((256, 256)), wide_camera((256, 256))
    assert (wide.width_px, wide.height_px) == (848, 256)
    assert wide.cropped((848 - 256) // 2, 0, 256, 256) == square
    assert 2 * np.rad2deg(np.arctan(0.5 * square.width_px / square.fx_px)) == pytest.approx(
        29.3, abs=0.1
    )


def test_the_camera_is_never_inside_anything() -> None:
    camera = square_camera((24, 24))
    for manoeuvre in (Manoeuvre.WINDING, Manoeuvre.RIGHT_TURN):
        world = build_street(1, manoeuvre)
        times_s = np.arange(0, 6, 0.5)
        depths = render_drive(world, camera_of(world, times_s, 1), camera, times_s, Optics()).depths
        assert depths.min() > 1.2


def test_streets_are_full_of_things_and_open_to_the_sky(street: Street) -> None:
    times_s = np.array([0.0, 3.0])
    rendering = render_drive(
        street, camera_of(street, times_s), square_camera((96, 96)), times_s, Optics()
    )
    sky = np.isinf(rendering.depths).mean()
    near = (rendering.depths < 40).mean()
    assert 0.05 < sky < 0.5
    assert near > 0.3
    assert 60 < images(rendering).mean() < 170
    assert images(rendering).reshape(-1, 3).std(axis=0).min() > 30


def test_noise_and_exposure_are_what_they_say() -> None:
    light = np.full((40, 16, 24, 3), 0.25, dtype=np.float32)  # byte 127.5
    still = expose(light, 24, np.random.default_rng(0), noise=0.0, exposure_drift=0.0)
    assert (still == 128).all()
    noisy = expose(light, 24, np.random.default_rng(0), noise=3.0, exposure_drift=0.0)
    assert noisy.astype(float).std() == pytest.approx((3.0**2 + 1 / 12) ** 0.5, rel=0.02)
    drifting = expose(light, 24, np.random.default_rng(0), noise=0.0, exposure_drift=0.1)
    brightness = drifting.mean(axis=(1, 2, 3))
    assert 3.0 < brightness.std() < 12.0  # half of 10 % of 127, for light under the square root
    assert np.abs(np.diff(brightness)).max() < 4.0


@pytest.mark.parametrize("blur_px", [0.3, 0.8, 2.0])
def test_the_lens_keeps_light_and_spreads_it(blur_px: float) -> None:
    """A crop of the wide image is the image of the narrow camera, and blur only smooths."""
    wide = CAMERA.cropped(-16, 0, 96, 64)
    sharp, blurred = (
        render_drive(
            made_up_street(), UP_1M, CAMERA, np.zeros(1), Optics(0.0, 0.0, spread_px)
        ).light[0]
        for spread_px in (0.0, blur_px)
    )
    whole = render_drive(
        made_up_street(), UP_1M, wide, np.zeros(1), Optics(0.0, 0.0, blur_px)
    ).light[0]
    np.testing.assert_array_equal(whole[:, 16:80], blurred)
    assert blurred.mean() == pytest.approx(sharp.mean(), rel=0.01)
    assert np.abs(np.diff(blurred, axis=0)).max() < np.abs(np.diff(sharp, axis=0)).max()
