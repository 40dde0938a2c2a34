"""Light: what sun, sky, gloss and haze do to a patch, and how images are blurred."""

import dataclasses

import numpy as np

from geovp_classic.data.synthetic.images import Texture
from geovp_classic.data.synthetic.mesh import Hits
from geovp_classic.data.synthetic.shading import (
    AMBIENT,
    GLOSS,
    HORIZON,
    Optics,
    Weather,
    shade,
    sky_light,
)
from geovp_classic.types import FloatArray

DAY = Weather(
    to_sun=np.array([0.0, -0.6, 0.8], dtype=np.float32),
    sun=np.ones(3, dtype=np.float32),
    cloud_shift=np.zeros(2, dtype=np.float32),
)
PLAIN = Optics(haze_per_m=0.0, gloss=0.0, blur_px=0.0)
EYE = np.array([0.0, -1.0, 0.0])


def hit(normal: tuple[float, float, float], **parts: object) -> Hits:
    """One hit 10 m ahead of the origin, white, seen as a whole tile so that its texture is its
    mean.
    """
    values: dict[str, object] = {
        "points": np.array([[0.0, 0.0, 10.0]], dtype=np.float32),
        "normal": np.array([normal], dtype=np.float32),
        "uv": np.zeros((1, 2), dtype=np.float32),
        "uv_steps": np.float32(8 * np.eye(2)[None]),
        "sizes_m": np.full((1, 2), 0.1, dtype=np.float32),
        "ambient": np.ones(1, dtype=np.float32),
        "texture": np.array([Texture.PLAIN], dtype=np.int32),
        "tint": np.ones((1, 3), dtype=np.float32),
    }
    return Hits(**(values | parts))


def light(hits: Hits, lit: bool = True, optics: Optics = PLAIN) -> FloatArray:
    return shade(hits, EYE, np.array([lit]), DAY, optics)[0]


UP = (0.0, -1.0, 0.0)
TO_EYE = (0.0, 0.0, -1.0)


def test_a_floor_gets_the_sun_by_its_height_and_all_of_the_sky() -> None:
    """0.6 of the sun (Lambert) and 0.75 + 0.25 of the ambient light; PLAIN reflects about 0.93
    squared.
    """
    np.testing.assert_allclose(light(hit(UP)), 0.93**2 * (0.6 + AMBIENT), rtol=0.02)
    np.testing.assert_allclose(light(hit(UP), lit=False), 0.93**2 * AMBIENT, rtol=0.02)


def test_a_wall_that_faces_away_from_the_sun_gets_sky_only() -> None:
    np.testing.assert_allclose(light(hit(TO_EYE)), 0.93**2 * 0.75 * AMBIENT, rtol=0.02)


def test_ambient_light_is_scaled_by_the_share_that_arrives() -> None:
    half = hit(TO_EYE, ambient=np.array([0.5], dtype=np.float32))
    np.testing.assert_allclose(light(half), 0.5 * light(hit(TO_EYE)), rtol=1e-5)


def test_leaves_shine_from_behind() -> None:
    texture = np.array([Texture.LEAVES], dtype=np.int32)
    ahead, behind = (
        light(hit((0.0, -0.6 * sign, 0.8 * sign), texture=texture)) for sign in (1.0, -1.0)
    )
    dark = light(hit((0.0, 0.6, -0.8), texture=texture), lit=False)
    assert (ahead > behind).all()  # more of the sky
    assert (behind > 1.5 * dark).all()


def test_a_tint_colours_and_squares() -> None:
    red = light(hit(UP, tint=np.array([[1.0, 0.5, 0.0]], dtype=np.float32)))
    white = light(hit(UP))
    np.testing.assert_allclose(red / white, [1.0, 0.25, 0.0], atol=1e-6)


def test_untinted_parts_of_a_texture_keep_their_colour() -> None:
    """Windows are grey under a red tint as well; a wall is red from its first to its last texel."""
    texel = {
        "uv_steps": np.zeros((1, 2, 2), dtype=np.float32),
        "tint": np.array([[1.0, 0.1, 0.1]], dtype=np.float32),
    }
    facade = {"texture": np.array([Texture.BRICK_WINDOWS], dtype=np.int32)}
    frame, wall = (np.array([[76 / 512, v]], dtype=np.float32) for v in (0.15, 0.45))
    red, green, _ = light(hit(TO_EYE, uv=frame, **texel, **facade))
    assert green > 0.8 * red
    red, green, _ = light(hit(TO_EYE, uv=wall, **texel, **facade))
    assert green < 0.5 * red


def test_gloss_mirrors_the_sky_and_more_of_it_at_grazing_angles() -> None:
    black: dict[str, object] = {
        "tint": np.zeros((1, 3), dtype=np.float32),
        "texture": np.array([Texture.CAR_PAINT], dtype=np.int32),
    }
    assert GLOSS[Texture.CAR_PAINT] > 0
    shiny = dataclasses.replace(PLAIN, gloss=1.0)
    assert light(hit(UP, **black)).max() == 0.0
    steep = light(hit((0.0, -0.5, -(0.75**0.5)), **black), optics=shiny)  # 54 degrees from the ray
    flat = light(hit(UP, **black), optics=shiny)  # 84 degrees from the ray
    assert 0.01 < steep.mean() < 0.5 * flat.mean()
    np.testing.assert_allclose(
        light(hit(UP, **black), optics=Optics(0.0, 0.5, 0.0)), 0.5 * flat, rtol=1e-5
    )


def test_haze_hides_half_after_its_half_distance() -> None:
    distance_m = np.hypot(10.0, 1.0)
    hazy = light(hit(UP), optics=Optics(haze_per_m=float(np.log(2) / distance_m), gloss=0.0))
    np.testing.assert_allclose(hazy, 0.5 * light(hit(UP)) + 0.5 * HORIZON, rtol=1e-4)


def test_stains_spare_what_does_not_repeat() -> None:
    places = np.random.default_rng(0).uniform(-50, 50, (300, 3)).astype(np.float32)
    for texture, stained in ((Texture.PLAIN, False), (Texture.ASPHALT, True)):
        one = hit(UP)
        many = Hits(*(np.repeat(part, 300, axis=0) for part in one))
        seen = many._replace(points=places, texture=np.full(300, int(texture), dtype=np.int32))
        spread = shade(seen, EYE, np.ones(300, dtype=bool), DAY, PLAIN)[:, 0]
        assert (spread.std() > 0.02 * spread.mean()) == stained


def test_the_sky_is_blue_above_pale_below_and_bright_at_the_sun() -> None:
    up, level, sun = np.array([[0.0, -1.0, 0.0]]), np.array([[-1.0, 0.0, 0.0]]), DAY.to_sun[None]
    overhead, horizon, glow = (
        sky_light(DAY, ray.astype(np.float32))[0] for ray in (up, level, sun)
    )
    np.testing.assert_allclose(horizon, HORIZON, atol=1e-4)
    assert overhead[2] > overhead[0]
    beside = sky_light(DAY, np.float32([[0.0, -0.6, -0.8]]))[0]
    assert (glow - beside).min() > 0.1


def test_clouds_are_seen_through_more_or_less() -> None:
    rng = np.random.default_rng(2)
    rays = rng.normal(size=(500, 3)) * [1.0, 0.0, 1.0] + [0.0, -0.8, 0.0]
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    sky = sky_light(DAY, rays.astype(np.float32))
    blueness = sky[:, 2] / sky[:, 0]
    assert np.ptp(blueness) > 0.5
