"""Grey images in three equal channels, of which one is a third of the work."""

import numba
import numpy as np

from geovp_classic.types import ByteArray


def is_grey(frames: ByteArray) -> bool:
    """Whether all channels of frames [..., 3] are the same."""
    return bool(_is_grey(np.ascontiguousarray(frames).reshape(-1)))


@numba.njit(nogil=True, cache=True)
def _is_grey(
    values: ByteArray,  # [3 N]
) -> bool:
    different = np.uint8(0)
    for n in range(
        len(values) // 3
    ):  # to the end, without a branch, so that the compiler vectorises it
        different |= (values[3 * n] ^ values[3 * n + 1]) | (values[3 * n] ^ values[3 * n + 2])
    return different == 0
