"""The data types of the suite: clips, camera motion, and the input and output of predictors.

Conventions:

- `a_from_b` maps points of frame b into frame a; chain by cancelling: `cam_from_world @
  world_from_rig`. Transforms are plain 4x4 float64 arrays.
- Camera axes as OpenCV: x right, y down, z forward. Depth is z-depth; 0 = unknown, inf = sky
  (inverse depth 0).
- Pixels (u, v) = (column, row); (0, 0) is the centre of the top-left pixel; resizing maps c to
  (c + 0.5) * s - 0.5.
- Images are uint8 RGB [..., H, W, 3] at interfaces (clips, views, predictions, files), float32 in
  [0, 1] inside.
- Axes: T clip, P past, F future, S samples, H, W, N points. Steps: 0..P-1 | P..P+F-1; horizon
  k = 1..F.
- Units are suffixes: `_s _m _px _rad _deg _hz`. A length without suffix is in the trajectory's own
  unit; `is_metric` tells whether that is metres.
- A trajectory has one arbitrary world frame; `world_from_cam[0]` need not be the identity.
"""

from geovp_classic.types.arrays import BoolArray, ByteArray, FloatArray, IntArray
from geovp_classic.types.clips import (
    Clip,
    Context,
    ExtraView,
    Observations,
    PrivilegedInput,
    Target,
)
from geovp_classic.types.motion import Intrinsics, Motion, Trajectory
from geovp_classic.types.predictions import Prediction, ShownBy, Views

__all__ = [
    "BoolArray",
    "ByteArray",
    "Clip",
    "Context",
    "ExtraView",
    "FloatArray",
    "IntArray",
    "Intrinsics",
    "Motion",
    "Observations",
    "Prediction",
    "PrivilegedInput",
    "ShownBy",
    "Target",
    "Trajectory",
    "Views",
]
