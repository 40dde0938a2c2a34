"""Sun and sky of a fine day; colours are linear light."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.random import Generator

from geovp_classic.data.synthetic.textures import Texture, sample
from geovp_classic.types import BoolArray, FloatArray

Rgb = tuple[float, float, float]


@dataclass(frozen=True)
class Weather:
    """Sun and sky of a fine day."""

    to_sun: FloatArray  # [3], unit, world frame
    sun: FloatArray  # [3]
    cloud_shift: FloatArray  # [2], in tiles
    ambient: Rgb = (0.36, 0.42, 0.52)
    zenith: Rgb = (0.16, 0.33, 0.66)
    horizon: Rgb = (0.62, 0.74, 0.86)

    @classmethod
    def drawn(cls, rng: Generator) -> Self:
        """Return a day with the sun 30 to 55 degrees high."""
        elevation_rad = np.deg2rad(rng.uniform(30, 55))
        azimuth_rad = rng.uniform(0, 2 * np.pi)
        warmth = rng.uniform(0, 1)
        level = np.cos(elevation_rad) * np.exp(1j * azimuth_rad)
        to_sun = np.array([level.imag, -np.sin(elevation_rad), level.real])
        sun = np.array([1.45, 1.34 - 0.07 * warmth, 1.17 - 0.18 * warmth])
        return cls(to_sun, sun, cloud_shift=rng.uniform(0, 1, 2))

    def sky_light(self, directions: FloatArray) -> FloatArray:
        """Return the light [N, 3] from unit directions [N, 3].

        The sky is paler at the horizon, with clouds on a flat ceiling and a glow around the sun.
        """
        up = np.maximum(-directions[:, 1:2], 0.0)
        weight = np.exp(-4.0 * up)
        clear = self.horizon * weight + self.zenith * (1 - weight)
        reach = 0.35 / (up + 0.12)
        uv = directions[:, [0, 2]] * reach + self.cloud_shift
        blur = 0.004 * reach[:, 0] ** 2
        cover = sample(Texture.CLOUDS, uv, 0 * uv, blur)[:, :1]
        cover *= np.minimum(1.0, 5.0 * up)  # no clouds in the haze
        towards_sun = np.maximum(directions @ self.to_sun, 0.0)[:, None]
        glow = 0.35 * towards_sun**24 * self.sun
        return clear * (1 - cover) + 0.93 * cover + glow

    def irradiance(
        self, normal: FloatArray, is_lit: BoolArray, is_leaf: BoolArray
    ) -> FloatArray:
        """Return the light [N, 3] that arrives from sun and sky; leaves also let it through."""
        cosine = normal @ self.to_sun
        up = -normal[:, 1]
        direct = np.where(is_leaf, 0.25 + 0.5 * cosine, cosine)
        direct = np.maximum(direct, 0.0) * is_lit
        from_sky = np.where(is_leaf, 0.6 + 0.4 * up, 0.75 + 0.25 * up)
        return direct[:, None] * self.sun + from_sky[:, None] * self.ambient
