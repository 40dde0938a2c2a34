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

RADIUS_PX = 2  # of a window; a constant, since the kernel writes its sums out
WINDOW_PX = 2 * RADIUS_PX + 1
PLANES_PER_TASK = 16  # of a thread


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
    # `short_stride`-th plane, and their scores are interpolated. This saves a third of the time.
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
        windows = self._windows(reference)
        baselines = np.linalg.norm(epipoles, axis=1)
        is_short = baselines < self.short_baseline_fraction * baselines.max()
        near_costs = self._near_costs(num_planes)
        volume = np.empty((num_planes, *reference.shape), np.uint8)

        def match_planes(first: int) -> None:
            warped = np.empty(reference.shape, np.float32)

            def add_scores(
                plane: int, is_used: BoolArray, scores: FloatArray
            ) -> FloatArray:
                inverse_depth = inverse_depths[min(plane, num_planes - 1)]
                for s in np.flatnonzero(is_used):
                    homography = infinity_from_pixel[s].copy()
                    homography[:, 2] += inverse_depth * epipoles[s]
                    self._add_source(
                        windows, images[s], homography, warped, scores
                    )
                return scores

            no_scores = np.zeros((2, *reference.shape), np.float32)
            scores = no_scores.copy()
            after = add_scores(first, is_short, no_scores.copy())
            last = min(first + PLANES_PER_TASK, num_planes)
            for plane in range(first, last):
                step = plane % self.short_stride
                if step == 0:
                    before = after
                    next_plane = plane + self.short_stride
                    after = add_scores(next_plane, is_short, no_scores.copy())
                weight = step / self.short_stride
                cv2.addWeighted(before, 1 - weight, after, weight, 0, scores)
                add_scores(plane, ~is_short, scores)
                _write_mean_costs(
                    scores,
                    np.float32(255 - self.max_near_cost),
                    np.uint8(self.unseen_cost),
                    near_costs[plane],
                    volume[plane],
                )

        parallel_map(match_planes, range(0, num_planes, PLANES_PER_TASK))
        # OpenCV transposes in blocks, ten times as fast as NumPy.
        costs = cv2.transpose(volume.reshape(num_planes, -1))
        return np.asarray(costs, np.uint8).reshape(*reference.shape, num_planes)

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

    def _windows(self, reference: ByteArray) -> FloatArray:
        """Return grey values, window means and inverse standard deviations [3, H, W]."""
        grey = reference.astype(np.float32)
        window = (WINDOW_PX, WINDOW_PX)
        border = cv2.BORDER_REPLICATE
        mean = cv2.boxFilter(grey, cv2.CV_32F, window, borderType=border)
        mean_square = cv2.sqrBoxFilter(
            grey, cv2.CV_32F, window, borderType=border
        )
        variance = np.maximum(mean_square - mean**2, 0)
        inverse_deviation = 1 / np.sqrt(variance + self.noise_variance)
        return np.stack([grey, mean, inverse_deviation]).astype(np.float32)

    def _add_source(
        self,
        windows: FloatArray,  # [3, H, W]
        image: FloatArray,  # [H, W]
        source_from_reference: FloatArray,  # [3, 3]
        warped: FloatArray,  # [H, W], overwritten by the source image
        scores: FloatArray,  # [2, H, W], added to
    ) -> None:
        """Add one minus the ZNCC where a source sees a pixel, and 1 to the count there."""
        grey, mean, inverse_deviation = windows
        cv2.warpPerspective(
            image,
            source_from_reference,
            image.shape[::-1],
            warped,
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        _add_scores(
            grey,
            mean,
            inverse_deviation,
            warped,
            source_from_reference.astype(np.float32),
            np.float32(self.noise_variance),
            scores,
        )


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _write_mean_costs(
    scores: FloatArray,  # [2, H, W]
    max_cost: np.float32,
    unseen_cost: np.uint8,
    near_cost: np.uint8,
    costs: CostArray,  # [H, W], written
) -> None:
    """Write the mean costs of the sources that see a pixel."""
    for row in range(costs.shape[0]):
        for x in range(costs.shape[1]):
            count = scores[1, row, x]
            cost = max_cost * scores[0, row, x] / max(count, np.float32(1e-6))
            mean = np.uint8(cost) if count > 0 else unseen_cost
            costs[row, x] = mean + near_cost


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _add_scores(
    reference: FloatArray,  # [H, W]
    window_mean: FloatArray,  # [H, W], of the reference
    inverse_deviation: FloatArray,  # [H, W], of the reference
    warped: FloatArray,  # [H, W], source image
    source_from_reference: FloatArray,  # [3, 3]
    noise_variance: np.float32,
    scores: FloatArray,  # [2, H, W], added to
) -> None:
    """Add one minus the ZNCC where the source sees a pixel, and 1 to the count there."""
    height, width = warped.shape
    zero = np.float32(0)
    unit = np.float32(1)
    half = np.float32(0.5)
    num_pixels = np.float32(WINDOW_PX * WINDOW_PX)
    h = source_from_reference
    last_u = np.float32(width) - half
    last_v = np.float32(height) - half
    # Sums of each column over the five rows of the window, with a margin on either side.
    columns = np.zeros((3, width + 2 * RADIUS_PX), np.float32)
    values, squares, products = columns
    for i in range(-RADIUS_PX, RADIUS_PX):
        _add_row(reference, warped, i, unit, columns)
    for row in range(height):
        _add_row(reference, warped, row + RADIUS_PX, unit, columns)
        if row > 0:
            _add_row(reference, warped, row - RADIUS_PX - 1, -unit, columns)
        for k in range(3):
            columns[k, :RADIUS_PX] = columns[k, RADIUS_PX]
            columns[k, -RADIUS_PX:] = columns[k, -RADIUS_PX - 1]
        row_u = h[0, 1] * np.float32(row) + h[0, 2]
        row_v = h[1, 1] * np.float32(row) + h[1, 2]
        row_z = h[2, 1] * np.float32(row) + h[2, 2]
        for x in range(width):
            mean = _window_sum(values, x) / num_pixels
            mean_square = _window_sum(squares, x) / num_pixels
            mean_product = _window_sum(products, x) / num_pixels
            variance = max(mean_square - mean * mean, zero) + noise_variance
            covariance = mean_product - mean * window_mean[row, x]
            correlation = (
                covariance * inverse_deviation[row, x] / np.sqrt(variance)
            )
            u = h[0, 0] * np.float32(x) + row_u
            v = h[1, 0] * np.float32(x) + row_v
            z = h[2, 0] * np.float32(x) + row_z
            is_inside_u = (u > -half * z) & (u < last_u * z)
            is_inside_v = (v > -half * z) & (v < last_v * z)
            weight = unit if is_inside_u & is_inside_v else zero
            scores[0, row, x] += weight * min(
                max(unit - correlation, zero), unit
            )
            scores[1, row, x] += weight


@numba.njit(nogil=True, inline="always")
def _add_row(
    reference: FloatArray,  # [H, W]
    warped: FloatArray,  # [H, W]
    row: int,  # the first or last one is repeated outside the image
    sign: np.float32,
    columns: FloatArray,  # [3, W + 4], of values, squares and products; added to
) -> None:
    """Add or subtract a row of the source image, its squares and its products."""
    height, width = warped.shape
    y = min(max(row, 0), height - 1)
    for x in range(width):
        value = warped[y, x]
        columns[0, x + RADIUS_PX] += sign * value
        columns[1, x + RADIUS_PX] += sign * value * value
        columns[2, x + RADIUS_PX] += sign * value * reference[y, x]


@numba.njit(nogil=True, inline="always")
def _window_sum(values: FloatArray, first: int) -> np.float32:
    """Return the sum of the five values of a window; a loop would not be vectorised."""
    return (
        values[first]
        + values[first + 1]
        + values[first + 2]
        + values[first + 3]
        + values[first + 4]
    )
