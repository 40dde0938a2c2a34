"""GeoVP: geometry-based video prediction with a moving camera; the classical suite, without torch.

Public names are imported on first use, so that `import geovp` is fast.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from geovp_classic.api import evaluate, open_clip, predict, show
    from geovp_classic.registry import build, load
    from geovp_classic.types import (
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

    __version__: str

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

if not TYPE_CHECKING:
    _MODULE_OF = {"build": "registry", "load": "registry"}
    _MODULE_OF |= dict.fromkeys(
        ("evaluate", "open_clip", "predict", "show"), "api"
    )

    def __getattr__(name: str) -> object:
        """Import a public name from its module on first use."""
        import importlib
        from importlib import metadata

        if name == "__version__":
            return metadata.version("geovp")
        if name not in __all__:
            raise AttributeError(
                f"module 'geovp_classic' has no attribute {name!r}"
            )
        module = importlib.import_module(
            f"geovp_classic.{_MODULE_OF.get(name, 'types')}"
        )
        globals()[name] = getattr(module, name)
        return globals()[name]


def __dir__() -> list[str]:
    return sorted(__all__)
