"""Transfer of fine detail to magnified surfaces, which one observed image cannot hold.

A surface that is seen z times larger than it was observed has no frequencies above 1 / z of the
finest one: roads, walls and trees blur, which perceptual metrics and people dislike more than wrong
texture. While a car drives on, the texture at one place of the image changes little (road below,
walls and trees at the sides). So the missing frequency bands are taken from the last observed frame
at the same pixels, at the local contrast of the view. Bands are those of a Laplacian pyramid (Burt
& Adelson 1983).
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.geometry import pinhole
from geovp_classic.parallel import parallel_map
from geovp_classic.types import ByteArray, FloatArray


@dataclass(frozen=True)
class MagnifiedDetail:
    """Detail of the last observed frame, added to the brightness of magnified surfaces.

    All settings were chosen on val, by LPIPS and SSIM.
    """

    strength: float = 1.0
    # Magnifications between which each frequency band is lost.
    band_edges: tuple[float, ...] = (1.0, 1.7, 2.7, 4.0, 6.0)
    blur_px: float = 0.5  # standard deviation of the low-pass filter per unit of magnification
    # Detail is what a blur of this standard deviation removes
    coarse_px: float = 4.0
    # Standard deviation of the window in which contrasts are compared
    contrast_px: float = 6.0
    min_contrast_grey: float = 2.0  # below it nothing is amplified

    def transfer(
        self,
        frames: ByteArray,  # [F, H, W, 3]
        # F maps [H, W] float32, 1 where nothing was lost
        magnification: Sequence[FloatArray],
        observed: ByteArray,  # [H, W, 3]
    ) -> ByteArray:
        """Return the frames with the bands that magnification removed."""
        # The bands of the last frame, and how much contrast they have there.
        image = pinhole.grey(observed)
        bands = self._bands(image)
        contrast = self._contrast(image)

        def add(step: int) -> ByteArray:
            # Each band counts as much as magnification removed of it.
            missing = np.zeros_like(image)
            for band, low, high in zip(
                bands, self.band_edges[:-1], self.band_edges[1:], strict=True
            ):
                loss = (magnification[step] - low) / np.float32(high - low)
                missing += np.clip(loss, 0, 1) * band
            # Detail as strong as the view's own, and never amplified.
            own_contrast = self._contrast(pinhole.grey(frames[step]))
            gain = self.strength * np.minimum(own_contrast / contrast, 1)
            added = cv2.merge([gain * missing] * 3)
            return cv2.add(frames[step], added, dtype=cv2.CV_8U)

        return np.stack(parallel_map(add, range(len(frames))))

    def _bands(self, image: FloatArray) -> list[FloatArray]:
        """Return the frequency bands [H, W] of an image [H, W], finest first."""
        levels = [image]
        for edge in self.band_edges[1:]:
            levels.append(cv2.GaussianBlur(image, (0, 0), self.blur_px * edge))
        return [fine - coarse for fine, coarse in itertools.pairwise(levels)]

    def _contrast(self, image: FloatArray) -> FloatArray:
        """Return the local root mean square of detail [H, W]."""
        detail = image - wide_blur(image, self.coarse_px)
        variance = wide_blur(detail * detail, self.contrast_px)
        return np.sqrt(variance + np.float32(self.min_contrast_grey**2))


def wide_blur(
    image: FloatArray | ByteArray,  # [H, W, 3] or [H, W]
    sigma_px: float,
) -> FloatArray:
    """Blur with a Gaussian that is wide compared to a pixel, on a smaller image for speed."""
    shrink = 2 ** max(0, int(math.log2(sigma_px / 2)))
    height, width = image.shape[:2]
    size_px = (max(1, width // shrink), max(1, height // shrink))
    small = cv2.resize(image, size_px, interpolation=cv2.INTER_AREA)
    # Averaging over pixels and interpolating between averages blur as well.
    variance = (3 * shrink**2 - 1) / 12 if shrink > 1 else 0.0
    sigma = math.sqrt(sigma_px**2 - variance) / shrink
    blurred = cv2.GaussianBlur(small.astype(np.float32), (0, 0), sigma)
    return cv2.resize(blurred, (width, height))
