"""Light: what sun, sky, gloss and haze do to a patch, and how images are blurred."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geovp_classic.data.synthetic.render import _bell, _blurred
from geovp_classic.data.synthetic.shading import Optics, Weather, dot, shade, sky_light
from geovp_classic.data.synthetic.surfaces import Patches
from geovp_classic.data.synthetic.textures import Texture, atlas
from geovp_classic.types import FloatArray

DAY = Weather(
    to_sun=np.array([0.0, -0.6, 0.8]),
    sun=np.array([1.0, 1.0, 1.0]),
    sky=np.array([0.4, 0.4, 0.4]),
    zenith=np.array([0.2, 0.3, 0.6]),
    horizon=np.array([0.6, 0.7, 0.8]),
    cloud_shift=np.zeros(2),
)
PLAIN = Optics(haze_per_m=0.0, gloss=0.0, blur_px=0.0)
EYE = np.array([0.0, -1.0, 0.0])


def patch(normal: tuple[float, float, float], **fields: object) -> Patches:
    """One patch 10 m ahead of the origin, white, seen as a whole tile so that its texture is its mean."""
    whole = np.float32(8 * np.eye(2)[None])
    values: dict[str, object] = {
        "points": np.array([[0.0, 0.0, 10.0]], dtype=np.float32),
        "normal": np.array([normal], dtype=np.float32),
        "uv": np.zeros((1, 2), dtype=np.float32),
        "uv_steps": whole,
        "paint_uv": np.zeros((1, 2), dtype=np.float32),
        "paint_steps": whole,
        "around": np.ones(1, dtype=np.float32),
        "sizes_m": np.full((1, 2), 0.1, dtype=np.float32),
        "texture": np.array([Texture.PLAIN], dtype=np.int32),
        "paint": np.array([-1], dtype=np.int32),
        "tint": np.ones((1, 3), dtype=np.float32),
        "gloss": np.zeros(1, dtype=np.float32),
    }
    return Patches(**(values | fields))  # type: ignore[arg-type]


def light(seen: Patches, lit: bool = True, optics: Optics = PLAIN) -> FloatArray:
    return shade(atlas(), seen, EYE, np.array([lit]), DAY, optics)[0]


UP = (0.0, -1.0, 0.0)
TO_EYE = (0.0, 0.0, -1.0)


def test_a_floor_gets_the_sun_by_its_height_and_all_of_the_sky() -> None:
    """0.6 of the sun (Lambert) and 0.75 + 0.25 of the sky; PLAIN reflects about 0.93 squared."""
    np.testing.assert_allclose(light(patch(UP)), 0.93**2 * (0.6 + 0.4), rtol=0.02)
    np.testing.assert_allclose(light(patch(UP), lit=False), 0.93**2 * 0.4, rtol=0.02)


def test_a_wall_that_faces_away_from_the_sun_gets_sky_only() -> None:
    np.testing.assert_allclose(light(patch(TO_EYE)), 0.93**2 * 0.75 * 0.4, rtol=0.02)


def test_light_from_around_is_scaled_by_the_share_that_arrives() -> None:
    half = patch(TO_EYE, around=np.array([0.5], dtype=np.float32))
    np.testing.assert_allclose(light(half), 0.5 * light(patch(TO_EYE)), rtol=1e-5)


def test_leaves_shine_from_behind() -> None:
    texture = np.array([Texture.LEAVES], dtype=np.int32)
    ahead, behind = (light(patch((0.0, -0.6 * sign, 0.8 * sign), texture=texture)) for sign in (1.0, -1.0))
    dark = light(patch((0.0, 0.6, -0.8), texture=texture), lit=False)
    assert (ahead > behind).all()  # more of the sky
    assert (behind > 1.5 * dark).all()


def test_a_tint_colours_and_squares() -> None:
    red = light(patch(UP, tint=np.array([[1.0, 0.5, 0.0]], dtype=np.float32)))
    white = light(patch(UP))
    np.testing.assert_allclose(red / white, [1.0, 0.25, 0.0], atol=1e-6)


def test_paint_covers_what_is_below_by_its_alpha() -> None:
    """The whole zebra tile is an eighth to a quarter white; the rest shows the surface."""
    bare = light(patch(UP, tint=np.full((1, 3), 0.2, dtype=np.float32)))
    painted = light(patch(UP, tint=np.full((1, 3), 0.2, np.float32), paint=np.array([Texture.ZEBRA], dtype=np.int32)))
    cover = (np.sqrt(painted) - np.sqrt(bare)) / (np.sqrt(light(patch(UP))) * 0.93 - np.sqrt(bare))
    assert ((cover > 0.12) & (cover < 0.3)).all()


def test_gloss_mirrors_the_sky_and_more_of_it_at_grazing_angles() -> None:
    black = {"tint": np.zeros((1, 3), dtype=np.float32), "gloss": np.ones(1, dtype=np.float32)}
    shiny = dataclasses.replace(PLAIN, gloss=1.0)
    assert light(patch(UP, **black)).max() == 0.0
    steep = light(patch((0.0, -0.5, -(0.75**0.5)), **black), optics=shiny)  # 54 degrees from the ray
    flat = light(patch(UP, **black), optics=shiny)  # 84 degrees from the ray
    assert 0.05 < steep.mean() < 0.5 * flat.mean()
    np.testing.assert_allclose(light(patch(UP, **black), optics=Optics(0.0, 0.5, 0.0)), 0.5 * flat, rtol=1e-5)


def test_haze_hides_half_after_its_half_distance() -> None:
    distance_m = np.hypot(10.0, 1.0)
    hazy = light(patch(UP), optics=Optics(haze_per_m=float(np.log(2) / distance_m), gloss=0.0))
    np.testing.assert_allclose(hazy, 0.5 * light(patch(UP)) + 0.5 * DAY.horizon, rtol=1e-4)


def test_stains_spare_what_does_not_repeat() -> None:
    places = np.random.default_rng(0).uniform(-50, 50, (300, 3)).astype(np.float32)
    for texture, stained in ((Texture.PLAIN, False), (Texture.ASPHALT, True)):
        many = {
            part.name: np.repeat(getattr(patch(UP), part.name), 300, axis=0) for part in dataclasses.fields(Patches)
        }
        seen = Patches(**(many | {"points": places, "texture": np.full(300, int(texture), dtype=np.int32)}))
        spread = shade(atlas(), seen, EYE, np.ones(300, dtype=bool), DAY, PLAIN)[:, 0]
        assert (spread.std() > 0.02 * spread.mean()) == stained


def test_the_sky_is_blue_above_pale_below_and_bright_at_the_sun() -> None:
    up, level, sun = np.array([[0.0, -1.0, 0.0]]), np.array([[-1.0, 0.0, 0.0]]), DAY.to_sun[None]
    overhead, horizon, glow = (sky_light(atlas(), DAY, ray.astype(np.float32))[0] for ray in (up, level, sun))
    np.testing.assert_allclose(horizon, DAY.horizon, atol=1e-4)
    assert overhead[2] > overhead[0]
    beside = sky_light(atlas(), DAY, np.float32([[0.0, -0.6, -0.8]]))[0]
    assert (glow - beside).min() > 0.1


def test_clouds_are_seen_through_more_or_less() -> None:
    rng = np.random.default_rng(2)
    rays = rng.normal(size=(500, 3)) * [1.0, 0.0, 1.0] + [0.0, -0.8, 0.0]
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    sky = sky_light(atlas(), DAY, rays.astype(np.float32))
    blueness = sky[:, 2] / sky[:, 0]
    assert np.ptp(blueness) > 0.5


@given(seed=st.integers(0, 99))
def test_dot_is_the_inner_product(seed: int) -> None:
    a, b = np.random.default_rng(seed).normal(size=(2, 5, 3))
    np.testing.assert_allclose(dot(a, b)[:, 0], [np.dot(x, y) for x, y in zip(a, b, strict=True)])


@pytest.mark.parametrize("spread_px", [0.0, 0.3, 0.8, 2.0])
def test_the_lens_keeps_light_and_spreads_it(spread_px: float) -> None:
    kernel = _bell(spread_px)
    assert kernel.sum() == pytest.approx(1.0, abs=1e-6)
    offsets = np.arange(len(kernel)) - len(kernel) // 2
    spread = float((kernel * offsets**2).sum()) ** 0.5
    assert spread == pytest.approx(spread_px, abs=0.06 if spread_px >= 0.8 else 0.25)  # few samples of a narrow bell
    star = np.zeros((41, 41, 3), dtype=np.float32)
    star[20, 20] = 1.0
    seen = _blurred(star, kernel)
    assert seen.sum() == pytest.approx(3.0, abs=1e-4)
    assert seen.shape[0] == 41 - len(kernel) + 1


def test_blur_of_a_crop_is_the_crop_of_the_blur() -> None:
    whole = np.random.default_rng(0).uniform(0, 1, (30, 50, 3)).astype(np.float32)
    kernel = _bell(0.45)
    np.testing.assert_array_equal(
        _blurred(whole, kernel)[:, 7:20], _blurred(whole[:, 7 : 20 + len(kernel) - 1], kernel)
    )
