"""Matching costs of a plane sweep (Collins 1996): how badly images agree with a reference image.

The measure is one minus the zero-mean normalised cross-correlation (ZNCC) of small windows. Neither
a gain nor an offset of the exposure changes it. The planes face the reference camera.
"""

from dataclasses import dataclass

import cv2
import numba
import numpy as np
import numpy.typing as npt

from geovp_classic.parallel import parallel_map
from geovp_classic.types import BoolArray, ByteArray, FloatArray

CostArray = npt.NDArray[np.uint8]

RADIUS_PX = 2  # of a window; a constant, so that the compiler unrolls the sums over windows
WINDOW_PX = 2 * RADIUS_PX + 1
BAND_ROWS = 32  # of the image that a thread works on at once, so that they stay in its cache


@dataclass(frozen=True)
class WindowCorrelation:
    """Costs from 0 to 255 of windows of a reference image in other images."""

    # Windows whose grey values vary less match nothing: about the noise of a camera.
    noise_variance: float = 2.0
    # Cost where no source sees the point: neither good nor bad.
    unseen_cost: int = 128
    # Extra cost of the nearest plane, so that windows without texture, like the sky's, are far.
    max_near_cost: int = 8
    # Sources with less than this part of the longest baseline are compared at every
    # `short_stride`-th plane, and their costs are interpolated. This saves a third of the time.
    short_baseline_fraction: float = 1 / 3
    short_stride: int = 4

    def costs(
        self,
        reference: ByteArray,  # [H, W] grey
        sources: ByteArray,  # [S, H, W] grey
        # [S, 3, 3]; K R inv(K) maps pixels of the reference to a source, for points at infinity
        infinity_from_pixel: FloatArray,
        epipoles: FloatArray,  # [S, 3]; K t is added per unit of inverse depth
        inverse_depths: FloatArray,  # [N], of the planes
    ) -> CostArray:
        """Return the costs [H, W, N], averaged over the sources that see a point."""
        num_planes = len(inverse_depths)
        images = sources.astype(np.float32)
        baselines = np.linalg.norm(epipoles, axis=1)
        is_short = baselines < self.short_baseline_fraction * baselines.max()
        homographies = np.repeat(
            infinity_from_pixel[None], num_planes, axis=0
        )  # [N, S, 3, 3]
        homographies[..., 2] += inverse_depths[:, None, None] * epipoles
        coarse_steps = np.arange(
            0, num_planes + self.short_stride, self.short_stride
        )
        coarse_homographies = homographies[
            np.minimum(coarse_steps, num_planes - 1)
        ]
        near_costs = self._near_costs(num_planes)
        costs = np.empty((*reference.shape, num_planes), np.uint8)

        def match_band(top: int) -> None:
            long, num_long = self._match(
                reference, images[~is_short], homographies[:, ~is_short], top
            )
            short, num_short = self._match(
                reference,
                images[is_short],
                coarse_homographies[:, is_short],
                top,
            )
            volume = np.empty_like(long)
            for n in range(num_planes):
                step, rest = divmod(n, self.short_stride)
                after = rest / self.short_stride
                between = cv2.addWeighted(
                    short[step], 1 - after, short[step + 1], after, 0
                )
                count = cv2.addWeighted(
                    num_short[step],
                    1 - after,
                    num_short[step + 1],
                    after,
                    0,
                    dtype=cv2.CV_32F,
                )
                weight = count / np.maximum(
                    count + num_long[n], np.float32(1e-6)
                )
                volume[n] = long[n] + weight * (
                    between.astype(np.float32) - long[n]
                )
            # OpenCV transposes in blocks, ten times as fast as NumPy.
            transposed = cv2.transpose(volume.reshape(num_planes, -1))
            band = costs[top : top + BAND_ROWS]
            np.add(transposed.reshape(band.shape), near_costs, out=band)

        parallel_map(match_band, range(0, len(reference), BAND_ROWS))
        return costs

    def is_seen(
        self,
        costs: CostArray,  # [H, W, N]
    ) -> BoolArray:
        """Return whether a source sees the pixels [H, W] on the farthest or the nearest plane."""
        unseen = self.unseen_cost + self._near_costs(costs.shape[-1])
        outermost = [0, -1]
        return np.asarray(
            (costs[..., outermost] != unseen[outermost]).any(axis=-1)
        )

    def _near_costs(self, num_planes: int) -> CostArray:
        """Return the extra costs [N] of the planes."""
        return (
            self.max_near_cost * np.arange(num_planes) // num_planes
        ).astype(np.uint8)

    def _match(
        self,
        reference: ByteArray,
        images: FloatArray,  # [S, H, W]
        homographies: FloatArray,  # [N, S, 3, 3], source from reference
        top: int,
    ) -> tuple[CostArray, ByteArray]:
        """Return mean costs and numbers of the sources that see a pixel [N, R, W], for a band."""
        height, width = reference.shape
        bottom = min(top + BAND_ROWS, height)
        first = max(top - RADIUS_PX, 0)
        rows = reference[first : bottom + RADIUS_PX]
        window = (WINDOW_PX, WINDOW_PX)
        border = cv2.BORDER_REPLICATE
        mean = np.asarray(
            cv2.boxFilter(rows, cv2.CV_32F, window, borderType=border),
            np.float32,
        )
        mean_square = cv2.sqrBoxFilter(
            rows, cv2.CV_32F, window, borderType=border
        )
        variance = np.maximum(mean_square - mean**2, 0)
        inverse_deviation = 1 / np.sqrt(
            variance + np.float32(self.noise_variance)
        )
        grey = rows.astype(np.float32)
        homographies = homographies @ np.array(
            [[1, 0, 0], [0, 1, first], [0, 0, 1]]
        )
        warped = np.empty((len(images), *rows.shape), np.float32)
        costs = np.empty((len(homographies), bottom - top, width), np.uint8)
        counts = np.empty_like(costs)
        noise_variance = np.float32(self.noise_variance)
        max_cost = np.float32(255 - self.max_near_cost)
        unseen_cost = np.float32(self.unseen_cost)
        for n, source_from_rows in enumerate(homographies):
            for s, image in enumerate(images):
                cv2.warpPerspective(
                    image,
                    source_from_rows[s],
                    rows.shape[::-1],
                    warped[s],
                    flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
                    borderMode=border,
                )
            _correlate(
                grey,
                mean,
                inverse_deviation,
                warped,
                source_from_rows.astype(np.float32),
                height,
                top - first,
                noise_variance,
                max_cost,
                unseen_cost,
                costs[n],
                counts[n],
            )
        return costs, counts


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def _correlate(
    reference: FloatArray,  # [Q, W], rows of the image
    window_mean: FloatArray,  # [Q, W]
    inverse_deviation: FloatArray,  # [Q, W]
    warped: FloatArray,  # [S, Q, W]
    source_from_rows: FloatArray,  # [S, 3, 3]
    source_height: int,
    margin: int,  # rows before the first one of interest
    noise_variance: np.float32,
    max_cost: np.float32,
    unseen_cost: np.float32,
    costs: CostArray,  # [R, W], written
    counts: ByteArray,  # [R, W], written: how many sources see a pixel
) -> None:
    """Write the mean costs of all sources on one plane; beyond the border images are constant."""
    num_sources, num_rows, width = warped.shape
    num_pixels = np.float32(WINDOW_PX * WINDOW_PX)
    zero = np.float32(0)
    unit = np.float32(1)
    half = np.float32(0.5)
    last_u = np.float32(width) - half
    last_v = np.float32(source_height) - half
    column_sums = np.empty((3, width + 2 * RADIUS_PX), np.float32)
    total = np.empty(width, np.float32)
    count = np.empty(width, np.float32)
    for row in range(margin, margin + len(costs)):
        total[:] = zero
        count[:] = zero
        for s in range(num_sources):
            for x in range(width):
                value_sum = square_sum = product_sum = zero
                for i in range(row - RADIUS_PX, row + RADIUS_PX + 1):
                    y = min(max(i, 0), num_rows - 1)
                    value = warped[s, y, x]
                    value_sum += value
                    square_sum += value * value
                    product_sum += value * reference[y, x]
                column_sums[0, x + RADIUS_PX] = value_sum
                column_sums[1, x + RADIUS_PX] = square_sum
                column_sums[2, x + RADIUS_PX] = product_sum
            for k in range(3):
                column_sums[k, :RADIUS_PX] = column_sums[k, RADIUS_PX]
                column_sums[k, -RADIUS_PX:] = column_sums[k, -RADIUS_PX - 1]
            h = source_from_rows[s]
            y_px = np.float32(row)
            row_u = h[0, 1] * y_px + h[0, 2]
            row_v = h[1, 1] * y_px + h[1, 2]
            row_z = h[2, 1] * y_px + h[2, 2]
            for x in range(width):
                value_sum = square_sum = product_sum = zero
                for i in range(x, x + WINDOW_PX):
                    value_sum += column_sums[0, i]
                    square_sum += column_sums[1, i]
                    product_sum += column_sums[2, i]
                mean = value_sum / num_pixels
                variance = (
                    max(square_sum / num_pixels - mean * mean, zero)
                    + noise_variance
                )
                covariance = (
                    product_sum / num_pixels - mean * window_mean[row, x]
                )
                correlation = (
                    covariance * inverse_deviation[row, x] / np.sqrt(variance)
                )
                x_px = np.float32(x)
                z = max(h[2, 0] * x_px + row_z, np.float32(1e-6))
                u = (h[0, 0] * x_px + row_u) / z
                v = (h[1, 0] * x_px + row_v) / z
                is_inside_u = u > -half and u < last_u
                is_inside_v = v > -half and v < last_v
                weight = unit if is_inside_u and is_inside_v else zero
                total[x] += weight * min(max(unit - correlation, zero), unit)
                count[x] += weight
        for x in range(width):
            cost = unseen_cost
            if count[x] > zero:
                cost = max_cost * total[x] / count[x]
            costs[row - margin, x] = np.uint8(cost)
            counts[row - margin, x] = np.uint8(count[x])
