"""Rendered views of a geometric method as conditions of a video generator with a 3D cache.

A clip is a npz file with arrays in the layout of GEN3C (Ren et al., CVPR 2025): batch, frames,
views of the cache, channels, rows, columns. The world is the camera of the last observed frame.

    rendered_warp_images  float32 [1, F, 1, 3, H, W]  RGB in [-1, 1], -1 where nothing is known
    rendered_warp_masks   float32 [1, F, 1, 1, H, W]  1 where the geometry shows the scene
    depths                float32 [1, F, 1, 1, H, W]  z-depth, 0 where unknown
    w2cs                  float32 [1, F, 4, 4]        camera from world, axes as in OpenCV
    intrinsics            float32 [1, F, 3, 3]        pixels, (0, 0) is the centre of the first one
    observed              uint8 [P, H, W, 3]          the observed frames
"""

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.running.task import build_matrix
from geovp_classic.atomic import write_bytes
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.types import Context, FloatArray


def write_conditions(matrix: Matrix, folder: Path, limit: int | None = None) -> Iterator[Path]:
    """Write a file per clip of the matrix's only method and yield its path."""
    built = build_matrix(matrix.model_dump_json())
    (predictor,) = built.predictors.values()
    if not isinstance(predictor, GeometricPredictor):
        raise BadData(
            "conditions are views of a scene: give a method with a pose source and a renderer"
        )
    for index, name in enumerate(built.clip_names[:limit]):
        context, _ = built.clip(index, name).split(matrix.num_past, predictor.needs)
        stream = io.BytesIO()
        np.savez_compressed(stream, **dict[str, Any](conditions(predictor, context)))
        path = folder / f"{name}.npz"
        write_bytes(path, stream.getvalue())
        yield path


def conditions(predictor: GeometricPredictor, context: Context) -> dict[str, FloatArray]:
    """Return the arrays of a clip, from the first sampled future."""
    observed = predictor.observe(context)
    motion = predictor.estimate(observed)
    scene = predictor.reconstruct(observed, motion.past)
    future, times_s = motion.futures[0], context.times_s[context.num_past :]
    views = scene.view(future, times_s, context.intrinsics)
    is_known = views.covered[..., None]
    images = np.where(is_known, views.frames / np.float32(127.5) - 1, np.float32(-1))
    depths = np.where(views.covered & np.isfinite(views.depths), views.depths, 0)
    cam_from_last = se3.inverse(future) @ motion.past.world_from_cam[-1]
    intrinsics = np.tile(context.intrinsics.matrix, (len(future), 1, 1))
    arrays = {
        "rendered_warp_images": np.moveaxis(images, -1, 1)[None, :, None],
        "rendered_warp_masks": views.covered[None, :, None, None],
        "depths": depths[None, :, None, None],
        "w2cs": cam_from_last[None],
        "intrinsics": intrinsics[None],
    }
    arrays = {name: array.astype(np.float32) for name, array in arrays.items()}
    return {**arrays, "observed": context.frames}
