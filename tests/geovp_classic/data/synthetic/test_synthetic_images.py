"""Solids, depth, light and noise of the synthetic street."""

import numpy as np
import numpy.typing as npt
import pytest

from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.data.synthetic.rendering import Optics, Rendering, render_drive
from geovp_classic.data.synthetic.roads import Journey, Roads, from_bends
from geovp_classic.data.synthetic.solids import RayCaster, Solids, joined
from geovp_classic.data.synthetic.street import MANOEUVRES, Street, Weather, build_street
from geovp_classic.data.synthetic.textures import Texture
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import ByteArray, FloatArray, Intrinsics

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
    columns = (frame, taper, is_round, [Texture.PLAIN] * 3, [tint] * 3)
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
    optics: Optics = CLEAN,
) -> Rendering:
    """Render a world from one camera pose."""
    poses = np.repeat(UP_1M[None], len(times_s), axis=0)
    return render_drive(world, poses, camera, times_s, optics)


def images(rendering: Rendering) -> ByteArray:
    """Return frames [T, H, W, 3] without noise."""
    return (255 * np.sqrt(np.clip(rendering.light, 0, 1)) + 0.5).astype(np.uint8)


@pytest.mark.parametrize("is_round", [False, True])
def test_rays_agree_with_dense_steps_through_the_solids(is_round: bool) -> None:
    """In steps of 1 cm, the first point inside one of 12 moved solids is the first hit."""
    rng = np.random.default_rng(is_round)
    left, right, rear, front = taper = (0.1, 0.3, 0.2, 0.4)
    one = solid((-0.5, -0.4, -0.8), (0.5, 0.4, 0.8), taper=taper, is_round=is_round)
    twists = np.column_stack([rng.uniform(-3, 3, (12, 3)), rng.normal(size=(12, 3))])
    solids = joined([one.moved(pose) for pose in se3.exp(twists)])
    origin = np.array([0.0, 0.0, -9.0])
    directions = rng.uniform(-4, 4, (200, 3)) - origin
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    lengths, numbers, _ = RayCaster(solids).cast(origin, directions)

    steps_m = np.arange(0, 20, 0.01)
    points = origin + steps_m[:, None] * directions[:, None]  # [N, steps, 3]
    first = []
    for world_from_local in solids.world_from_local:
        x, y, z = np.moveaxis(se3.transform(np.linalg.inv(world_from_local), points), -1, 0)
        low = 1 - y  # distance from the top
        is_inside = (y > 0) & (low > 0)
        is_inside &= (left * low < x) & (x < 1 - right * low)
        is_inside &= (rear * low < z) & (z < 1 - front * low)
        if is_round:
            is_inside = (x - 0.5) ** 2 + (y - 0.5) ** 2 + (z - 0.5) ** 2 < 0.25
        first.append(np.where(is_inside.any(axis=1), steps_m[is_inside.argmax(axis=1)], np.inf))
    is_hit = np.isfinite(first).any(axis=0)
    assert 20 < is_hit.sum() < 190
    np.testing.assert_allclose(lengths[is_hit], np.min(first, axis=0)[is_hit], atol=0.0101)
    assert (numbers == np.argmin(first, axis=0))[is_hit].mean() > 0.97
    assert np.isinf(lengths[~is_hit]).mean() > 0.9  # steps miss edges


def test_depth_shows_the_ground_plane_the_wall_and_the_sky() -> None:
    depth = render(small_world()).depths[0]
    down = pinhole.rays(CAMERA)[..., 1]
    ground = np.where(down > 1 / 20, 1.0 / np.maximum(down, 1e-9), np.inf)  # 1 m below the eye
    wall = np.where((down > -2 / 20) & (down <= 1 / 20), 20.0, np.inf)  # 1 m below to 2 m above
    np.testing.assert_allclose(depth, np.minimum(ground, wall), rtol=1e-5)
    assert np.isinf(depth[0]).all()


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
    rendering = render(small_world(True, low_sun), camera=camera)
    # the floor 61 / 6.5 = 9.4 m ahead, and 13 / 6.5 = 2 m right and left
    shadow, floor = ((0, 38, 76), (0, 38, 50))
    assert rendering.moving[shadow]
    assert not rendering.moving[floor]
    assert rendering.light[shadow].sum() < 0.6 * rendering.light[floor].sum()


def test_noise_and_exposure_have_the_given_amplitudes() -> None:
    clips = [  # of the camera that stands at a crossing
        Synthetic(num_frames=40, size_px=(24, 16), noise=noise, exposure_drift=drift)[7]
        for noise, drift in ((0.0, 0.0), (3.0, 0.0), (0.0, 0.1))
    ]
    still, noisy, drifting = (clip.frames.astype(float) for clip in clips)
    is_unclipped = (still > 20) & (still < 235)
    difference = (noisy - still)[is_unclipped]
    assert difference.std() == pytest.approx((3.0**2 + 1 / 6) ** 0.5, rel=0.02)  # rounded twice
    is_static = np.ptp(still, axis=0) == 0
    assert is_static.mean() > 0.5
    is_static &= is_unclipped[0] & (drifting < 235).all(axis=0)
    gain = (drifting / still)[:, is_static].mean(axis=1)
    assert 0.02 < gain.std() < 0.1  # half of 10 %, for light under the square root
    assert np.abs(np.diff(gain)).max() < 0.04


def poses_of(manoeuvre: str, seed: int = 0, **settings: float) -> FloatArray:
    """Return world_from_cam [60, 4, 4] of a drive of six seconds."""
    data = Synthetic(seed=seed, num_frames=60, size_px=(1, 1), **settings)
    return data[list(MANOEUVRES).index(manoeuvre)].trajectory.world_from_cam


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
def test_streets_repeat_and_their_road_is_free(manoeuvre: str) -> None:
    world, again = build_street(1, manoeuvre), build_street.__wrapped__(1, manoeuvre)
    for values, same in zip(world.static, again.static, strict=True):
        np.testing.assert_array_equal(values, same)
    times_s = np.arange(0, 6, 0.5)
    poses = poses_of(manoeuvre, 1)[::5]
    rendering = render_drive(world, poses, CAMERA.resized(32, 32), times_s, Optics())
    assert rendering.depths.min() > 1.2  # never inside an object
    assert 0.05 < np.isinf(rendering.depths).mean() < 0.5
    assert (rendering.depths < 40).mean() > 0.3
