from .api import evaluate, open_clip, predict, show
from .registry import build, load
from .types import (
    Clip,
    Context,
    Intrinsics,
    Motion,
    Prediction,
    PrivilegedInput,
    Target,
    Trajectory,
    Views,
)
from .version import __version__

__all__ = [
    "Clip",
    "Context",
    "Intrinsics",
    "Motion",
    "Prediction",
    "PrivilegedInput",
    "Target",
    "Trajectory",
    "Views",
    "__version__",
    "build",
    "evaluate",
    "load",
    "open_clip",
    "predict",
    "show",
]
