"""Binary segmentation of an image by a minimum cut (Boykov & Jolly 2001).

Pixels are nodes of a graph between a source (inside) and a sink (outside). The least cut between
both equals the maximum flow from one to the other.
"""

import math

import cv2
import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from geovp_classic.types import BoolArray, ByteArray, FloatArray

# A cut through so many pixels takes 20 ms; through 64 times as many, 4 s.
MAX_PIXELS = 2**14


def segment(
    cost: FloatArray,  # [H, W], of each pixel inside, over that of a pixel outside
    image: ByteArray,  # [H, W] grey
    edge_cost: float,  # of an outline between two pixels of one grey value
    edge_grey: float,  # difference of grey values at which it is 1 / sqrt(e) of that
) -> BoolArray:
    """Return the region [H, W] of least energy: the costs of its pixels and of its outline.

    Larger images are cut at a lower resolution.
    """
    height, width = cost.shape
    shrink = math.sqrt(cost.size / MAX_PIXELS)
    if shrink > 1:
        size_px = (max(1, int(width / shrink)), max(1, int(height / shrink)))
        small = [cv2.resize(each, size_px, interpolation=cv2.INTER_AREA) for each in (cost, image)]
        inside = segment(small[0], small[1], edge_cost, edge_grey).astype(np.float32)
        return np.asarray(cv2.resize(inside, (width, height))) > 0.5
    number = np.arange(cost.size).reshape(height, width)
    source, sink = cost.size, cost.size + 1
    # Neighbours are linked in both directions. Pixels that are cheaper inside are linked from the
    # source, the others to the sink; what the cut leaves with the source is inside.
    links = [
        (np.full_like(number, source), number, np.maximum(-cost, 0)),
        (number, np.full_like(number, sink), np.maximum(cost, 0)),
    ]
    grey = image.astype(np.float32)
    for first, second in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        step = grey[first] - grey[second]  # an outline is cheap where grey values differ
        capacity = edge_cost * np.exp(-(step**2) / (2 * edge_grey**2))
        links.append((number[first], number[second], capacity))
        links.append((number[second], number[first], capacity))
    rows, columns, capacities = (
        np.concatenate([values.ravel() for values in part]) for part in zip(*links, strict=True)
    )
    # The flow is integer: tenths of a grey value.
    graph = csr_array((np.rint(10 * capacities).astype(np.int32), (rows, columns)))
    graph.resize(cost.size + 2, cost.size + 2)
    residual = graph - maximum_flow(graph, source, sink).flow
    residual.eliminate_zeros()
    reached = breadth_first_order(residual, source, return_predecessors=False)
    is_inside = np.zeros(cost.size + 2, bool)
    is_inside[reached] = True
    return is_inside[: cost.size].reshape(height, width)
