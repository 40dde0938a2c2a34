"""Light of sun, sky, gloss and haze on a surface."""

import numpy as np

from geovp_classic.data.synthetic.ray_casting import Hits
from geovp_classic.data.synthetic.shading import Optics, Weather, shade
from geovp_classic.data.synthetic.textures import Texture
from geovp_classic.types import FloatArray

DAY = Weather(np.array([0.0, -0.6, 0.8]), sun=np.ones(3), cloud_shift=np.zeros(2))
AMBIENT, HORIZON = np.array(DAY.ambient), np.array(DAY.horizon)
PLAIN = Optics(haze_per_m=0.0, gloss=0.0)
EYE = np.array([0.0, -1.0, 0.0])
UP = (0.0, -1.0, 0.0)
TO_EYE = (0.0, 0.0, -1.0)
PLAIN_REFLECTANCE = 0.93**2


def hit(normal: tuple[float, float, float], **parts: object) -> Hits:
    """Return a white hit 10 m ahead of the origin, as large as a tile: its texture is the mean."""
    values: dict[str, object] = {
        "points": np.array([[0.0, 0.0, 10.0]]),
        "normal": np.array([normal]),
        "uv": np.zeros((1, 2)),
        "uv_steps": 8 * np.eye(2)[None],
        "sizes_m": np.full((1, 2), 0.1),
        "ambient": np.ones(1),
        "texture": np.array([Texture.PLAIN]),
        "tint": np.ones((1, 3)),
    }
    return Hits(**(values | parts))


def light(hits: Hits, lit: bool = True, optics: Optics = PLAIN) -> FloatArray:
    return shade(hits, EYE, np.array([lit]), DAY, optics)[0]


def test_floors_and_walls_receive_sun_and_sky() -> None:
    """Lambert's 0.6 of the sun; 0.75 + 0.25 (floor) or 0.75 (wall) of the sky."""
    sunny, shaded = light(hit(UP)), light(hit(UP), lit=False)
    np.testing.assert_allclose(sunny, PLAIN_REFLECTANCE * (0.6 + AMBIENT), rtol=0.02)
    np.testing.assert_allclose(shaded, PLAIN_REFLECTANCE * AMBIENT, rtol=0.02)
    wall = light(hit(TO_EYE))  # faces away from the sun
    np.testing.assert_allclose(wall, PLAIN_REFLECTANCE * 0.75 * AMBIENT, rtol=0.02)
    occluded = light(hit(TO_EYE, ambient=np.array([0.5])))
    np.testing.assert_allclose(occluded, 0.5 * wall, rtol=1e-5)


def test_leaves_let_light_through() -> None:
    leaf = {"texture": np.array([Texture.LEAVES])}
    lit, behind = (light(hit((0.0, -0.6 * s, 0.8 * s), **leaf)) for s in (1.0, -1.0))
    dark = light(hit((0.0, 0.6, -0.8), **leaf), lit=False)
    assert (lit > behind).all()  # more of the sky
    assert (behind > 1.5 * dark).all()


def test_tints_apply_to_tinted_parts_and_are_squared() -> None:
    red = light(hit(UP, tint=np.array([[1.0, 0.5, 0.0]])))
    np.testing.assert_allclose(red / light(hit(UP)), [1.0, 0.25, 0.0], atol=1e-6)
    facade = {
        "texture": np.array([Texture.BRICK_WINDOWS]),
        "uv_steps": np.zeros((1, 2, 2)),
        "tint": np.array([[1.0, 0.1, 0.1]]),
    }
    frame, wall = (light(hit(TO_EYE, uv=np.array([[76 / 512, v]]), **facade)) for v in (0.15, 0.45))
    assert frame[1] > 0.8 * frame[0]
    assert wall[1] < 0.5 * wall[0]


def test_gloss_reflects_the_sky_more_at_grazing_angles() -> None:
    black = {"tint": np.zeros((1, 3)), "texture": np.array([Texture.CAR_SIDE])}
    black |= {"uv": np.array([[0.7, 0.02]]), "uv_steps": np.zeros((1, 2, 2))}  # paint
    assert light(hit(UP, **black)).max() == 0.0
    steep_normal = (0.0, -0.5, -(0.75**0.5))  # 54 degrees from the ray
    steep, flat, half = (
        light(hit(normal, **black), optics=Optics(0.0, gloss))
        for normal, gloss in ((steep_normal, 1.0), (UP, 1.0), (UP, 0.5))
    )
    assert 0.01 < steep.mean() < 0.5 * flat.mean()
    np.testing.assert_allclose(half, 0.5 * flat, rtol=1e-5)


def test_haze_hides_half_at_its_half_distance() -> None:
    haze_per_m = float(np.log(2) / np.hypot(10.0, 1.0))
    hazy = light(hit(UP), optics=Optics(haze_per_m, gloss=0.0))
    np.testing.assert_allclose(hazy, 0.5 * light(hit(UP)) + 0.5 * HORIZON, rtol=1e-4)


def test_stains_appear_on_textures_that_repeat() -> None:
    places = np.random.default_rng(0).uniform(-50, 50, (300, 3))
    for texture, has_stains in ((Texture.PLAIN, False), (Texture.ASPHALT, True)):
        hits = Hits(*(np.repeat(values, 300, axis=0) for values in hit(UP)))
        hits = hits._replace(points=places, texture=np.full(300, int(texture)))
        light = shade(hits, EYE, np.ones(300, dtype=bool), DAY, PLAIN)[:, 0]
        assert (light.std() > 0.02 * light.mean()) == has_stains


def test_the_sky_is_blue_above_pale_below_bright_at_the_sun_and_cloudy() -> None:
    rays = np.array([UP, (-1.0, 0.0, 0.0), DAY.to_sun, DAY.to_sun * [1, 1, -1]])
    zenith, horizon, glow, opposite = DAY.sky_light(rays)
    np.testing.assert_allclose(horizon, HORIZON, atol=1e-4)
    assert zenith[2] > zenith[0]
    assert (glow - opposite).min() > 0.1
    rays = np.random.default_rng(2).normal(size=(500, 3)) * [1.0, 0.0, 1.0] + [0.0, -0.8, 0.0]
    sky = DAY.sky_light(rays / np.linalg.norm(rays, axis=-1, keepdims=True))
    assert np.ptp(sky[:, 2] / sky[:, 0]) > 0.5
