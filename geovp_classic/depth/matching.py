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
PackedArray = npt.NDArray[np.int32]

RADIUS_PX = 2  # of a window; a constant, since the kernel writes its sums out
WINDOW_PX = 2 * RADIUS_PX + 1
ROWS_PER_TASK = 32  # of a thread


@dataclass(frozen=True)
class WindowCorrelation:
    """Costs from 0 to 255 of windows of a reference image in other images."""

    # Windows whose grey values vary less match nothing: about the noise of a camera.
    noise_variance: float = 2.0
    # Where no source sees the point, the cost is that of a window with this part of the correlation
    # that its texture allows: neither good nor bad. A window of the sky, which matches nothing
    # anywhere, must not prefer the planes that no source sees. 0.5 brings .24 dB on videos of other
    # cameras, at the borders of what they saw before, and .02 dB on KITTI's train and val.
    unseen_correlation: float = 0.5
    # Extra cost of the nearest plane, so that windows without texture, like the sky's, are far. Set
    # by hand, below the cost of a large step between neighbours.
    max_near_cost: int = 8
    # Sources with less than this part of the longest baseline are compared at every
    # `short_stride`-th plane, and their scores are interpolated: between four planes their parallax
    # changes by less than 4/3 steps. This saves a third of the time; depth is no worse.
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
    ) -> tuple[CostArray, BoolArray]:
        """Return the costs [H, W, N], averaged over the sources that see a point.

        The second array [H, W] states whether a source sees a pixel on the farthest or the nearest
        plane. Points between these are seen where those are.
        """
        num_planes = len(inverse_depths)
        # The homography of a plane that faces the camera is K R inv(K) + q K t (0, 0, 1) (Hartley &
        # Zisserman 2004, eq. 13.2).
        baselines = np.linalg.norm(epipoles, axis=1)
        is_short = baselines < self.short_baseline_fraction * baselines.max()
        homographies = np.stack([infinity_from_pixel] * num_planes)
        homographies[..., 2] += inverse_depths[:, None, None] * epipoles
        windows = self._windows(reference)
        images = _neighbourhoods(sources)
        # Small costs that prefer far planes, and the costs of points that no source sees
        max_cost = 255 - self.max_near_cost
        near_costs = (self.max_near_cost * np.arange(num_planes) // num_planes).astype(np.uint8)
        texture = np.maximum(1 - self.noise_variance * windows[2] ** 2, 0)
        unseen_costs = (max_cost * (1 - self.unseen_correlation * texture)).astype(np.uint8)
        costs = np.empty((*reference.shape, num_planes), np.uint8)

        def match(first: int) -> None:
            # A band holds the rows of a task and those that their windows reach.
            rows = costs[first : first + ROWS_PER_TASK]
            last = first + len(rows)
            top = max(first - RADIUS_PX, 0)
            from_band = homographies.copy()  # of pixels whose rows are counted from the band's top
            from_band[..., 2] += top * from_band[..., 1]
            planes = np.empty((num_planes, *rows.shape[:2]), np.uint8)
            _match_band(
                np.ascontiguousarray(windows[:, top : last + RADIUS_PX]),
                images,
                from_band.astype(np.float32),
                is_short,
                self.short_stride,
                np.float32(self.noise_variance),
                np.float32(max_cost),
                unseen_costs[first:last],
                near_costs,
                first - top,
                planes,
            )
            # OpenCV transposes in blocks, ten times as fast as NumPy.
            cv2.transpose(planes.reshape(num_planes, -1), rows.reshape(-1, num_planes))

        parallel_map(match, range(0, len(reference), ROWS_PER_TASK))

        # `_write_mean_costs` writes these costs where no source sees the outermost planes
        outermost = [0, -1]
        unseen = unseen_costs[..., None] + near_costs[outermost]
        return costs, (costs[..., outermost] != unseen).any(axis=-1)

    def _windows(self, reference: ByteArray) -> FloatArray:
        """Return grey values, window means and inverse standard deviations [3, H, W]."""
        # var(x) = mean(x^2) - mean(x)^2, over the window
        grey = reference.astype(np.float32)
        window = (WINDOW_PX, WINDOW_PX)
        border = cv2.BORDER_REPLICATE
        mean = cv2.boxFilter(grey, cv2.CV_32F, window, borderType=border)
        mean_square = cv2.sqrBoxFilter(grey, cv2.CV_32F, window, borderType=border)
        variance = np.maximum(mean_square - mean**2, 0)
        inverse_deviation = 1 / np.sqrt(variance + self.noise_variance)
        return np.stack([grey, mean, inverse_deviation]).astype(np.float32)


def _neighbourhoods(
    images: ByteArray,  # [S, H, W]
) -> PackedArray:
    """Return each pixel with its right, lower and lower right neighbours, as the bytes of a number.

    Bilinear interpolation then reads memory once, not four times.
    """
    padded = np.pad(images, ((0, 0), (0, 1), (0, 1)), mode="edge")
    upper = padded[:, :-1]
    lower = padded[:, 1:]
    corners = [upper[..., :-1], upper[..., 1:], lower[..., :-1], lower[..., 1:]]
    return np.stack(corners, axis=-1).view("<i4")[..., 0]


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _match_band(
    # [3, B, W], of the reference: rows that stay in the processor's cache; see `_windows`
    windows: FloatArray,
    images: PackedArray,  # [S, H, W], the sources
    source_from_band: FloatArray,  # [N, S, 3, 3]
    is_short: BoolArray,  # [S]
    short_stride: int,
    noise_variance: np.float32,
    max_cost: np.float32,
    unseen_costs: CostArray,  # [R, W]
    near_costs: CostArray,  # [N]
    first: int,  # of the scored rows, in the band
    costs: CostArray,  # [N, R, W], written
) -> None:
    """Write the costs of the rows of a band, plane by plane.

    Short baselines are compared at the first plane of each block of `short_stride` planes, and at
    the last plane of all; in between their scores are interpolated.
    """
    num_planes, num_rows, width = costs.shape
    shape = (2, num_rows, width)
    scorer = (windows, images, noise_variance, first)
    after = np.zeros(shape, np.float32)
    _add_plane(scorer, source_from_band[0], is_short, after)
    for block in range(0, num_planes, short_stride):
        # The end of one block is the beginning of the next.
        before = after
        after = np.zeros(shape, np.float32)
        end = min(block + short_stride, num_planes - 1)
        _add_plane(scorer, source_from_band[end], is_short, after)
        for plane in range(block, min(block + short_stride, num_planes)):
            # Long baselines are compared at each plane.
            scores = np.zeros(shape, np.float32)
            _add_plane(scorer, source_from_band[plane], ~is_short, scores)
            weight = np.float32((plane - block) / max(end - block, 1))  # of `after`
            for row in range(num_rows):
                for x in range(width):
                    # Short baselines, interpolated between two planes, and long ones.
                    score = before[0, row, x]
                    score += weight * (after[0, row, x] - score) + scores[0, row, x]
                    count = before[1, row, x]
                    count += weight * (after[1, row, x] - count) + scores[1, row, x]
                    # The mean over the sources that see the pixel; without any, a neutral cost.
                    cost = max_cost * score / max(count, np.float32(1e-6))
                    mean = np.uint8(cost) if count > 0 else unseen_costs[row, x]
                    costs[plane, row, x] = mean + near_costs[plane]


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _add_plane(
    # As in `_match_band`: windows, images, noise_variance, first
    scorer: tuple[FloatArray, PackedArray, np.float32, int],
    source_from_band: FloatArray,  # [S, 3, 3], of the plane
    is_compared: BoolArray,  # [S]
    scores: FloatArray,  # [2, R, W], added to
) -> None:
    """Add the scores of some sources at one plane."""
    windows, images, noise_variance, first = scorer
    warped = np.empty(windows.shape[1:], np.float32)
    is_seen = np.empty(windows.shape[1:], np.float32)
    for s in np.flatnonzero(is_compared):
        _warp(images[s], source_from_band[s], warped, is_seen)
        _add_scores(windows, warped, is_seen, noise_variance, first, scores)


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _warp(
    image: PackedArray,  # [H, W]
    source_from_band: FloatArray,  # [3, 3]
    warped: FloatArray,  # [B, W], written
    is_seen: FloatArray,  # [B, W], written: 1 where the image sees a pixel, else 0
) -> None:
    """Warp an image bilinearly; its border continues outside.

    This takes a third of the time of `cv2.warpPerspective`. Each loop is simple enough to be
    vectorised.
    """
    num_rows, width = warped.shape
    h = source_from_band
    flat = image.reshape(-1)
    last_u = np.float32(width - 1)
    last_v = np.float32(image.shape[0] - 1)
    min_z = np.float32(1e-6)
    zero = np.float32(0)
    half = np.float32(0.5)
    unit = np.float32(1)
    byte = np.int32(255)
    indices = np.empty(width, np.int32)
    fraction_u = np.empty(width, np.float32)
    fraction_v = np.empty(width, np.float32)
    for row in range(num_rows):
        # Homogeneous pixels of the image; the terms of the row are the same for all columns.
        row_u = h[0, 1] * np.float32(row) + h[0, 2]
        row_v = h[1, 1] * np.float32(row) + h[1, 2]
        row_z = h[2, 1] * np.float32(row) + h[2, 2]
        for x in range(width):
            # Behind the source, z is negative, and the pixel comes out far outside.
            per_z = unit / max(h[2, 0] * np.float32(x) + row_z, min_z)
            u = (h[0, 0] * np.float32(x) + row_u) * per_z
            v = (h[1, 0] * np.float32(x) + row_v) * per_z
            # A pixel covers half a pixel around its centre: the image ends there.
            inner_u = min(max(u, zero), last_u)
            inner_v = min(max(v, zero), last_v)
            is_inside = max(abs(u - inner_u), abs(v - inner_v)) < half
            is_seen[row, x] = unit if is_inside else zero
            left = np.int32(inner_u)
            top = np.int32(inner_v)
            fraction_u[x] = inner_u - np.float32(left)
            fraction_v[x] = inner_v - np.float32(top)
            indices[x] = top * np.int32(width) + left
        # The four neighbours of each place, as the bytes of a number.
        for x in range(width):
            indices[x] = flat[np.uint64(indices[x])]
        # Bilinear interpolation.
        for x in range(width):
            corners = indices[x]
            top_left = np.float32(np.int32(corners & byte))
            top_right = np.float32(np.int32((corners >> 8) & byte))
            bottom_left = np.float32(np.int32((corners >> 16) & byte))
            bottom_right = np.float32(np.int32((corners >> 24) & byte))
            upper = top_left + fraction_u[x] * (top_right - top_left)
            lower = bottom_left + fraction_u[x] * (bottom_right - bottom_left)
            warped[row, x] = upper + fraction_v[x] * (lower - upper)


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _add_scores(
    windows: FloatArray,  # [3, B, W], of the reference
    warped: FloatArray,  # [B, W], source image
    is_seen: FloatArray,  # [B, W], 1 where the source sees a pixel, else 0
    noise_variance: np.float32,
    first: int,  # of the scored rows, in the band
    scores: FloatArray,  # [2, R, W], added to
) -> None:
    """Add one minus the ZNCC where the source sees a pixel, and 1 to the count there."""
    reference, window_mean, inverse_deviation = windows[0], windows[1], windows[2]
    _, num_rows, width = scores.shape
    zero = np.float32(0)
    unit = np.float32(1)
    num_pixels = np.float32(WINDOW_PX * WINDOW_PX)
    # Sums of each column over the five rows of the window, with a margin on either side.
    columns = np.zeros((3, width + 2 * RADIUS_PX), np.float32)
    values, squares, products = columns
    # All rows but the last one of the first window; the loop below adds that.
    for row in range(first - RADIUS_PX, first + RADIUS_PX):
        _add_row(reference, warped, row, unit, columns)
    for row in range(num_rows):
        # Move the windows down by a row: add the one below, subtract the one above.
        middle = first + row
        _add_row(reference, warped, middle + RADIUS_PX, unit, columns)
        if row > 0:
            _add_row(reference, warped, middle - RADIUS_PX - 1, -unit, columns)
        # The image's border continues outside.
        for k in range(3):
            columns[k, :RADIUS_PX] = columns[k, RADIUS_PX]
            columns[k, -RADIUS_PX:] = columns[k, -RADIUS_PX - 1]
        for x in range(width):
            # ZNCC = cov(x, y) / sqrt(var(x) var(y)), with the noise added to both variances
            mean = _window_sum(values, x) / num_pixels
            mean_square = _window_sum(squares, x) / num_pixels
            mean_product = _window_sum(products, x) / num_pixels
            variance = max(mean_square - mean * mean, zero) + noise_variance
            covariance = mean_product - mean * window_mean[middle, x]
            correlation = covariance * inverse_deviation[middle, x] / np.sqrt(variance)
            weight = is_seen[middle, x]
            scores[0, row, x] += weight * min(max(unit - correlation, zero), unit)
            scores[1, row, x] += weight


@numba.njit(nogil=True, inline="always")
def _add_row(
    reference: FloatArray,  # [B, W]
    warped: FloatArray,  # [B, W]
    row: int,  # the first or last one is repeated outside the band
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
