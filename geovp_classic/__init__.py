"""GeoVP: geometry-based video prediction with a moving camera; the classical suite (no torch in
here).

The public API, each name imported on its first use: `import geovp_classic as geovp` costs nothing.
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
    _MODULE_OF = dict.fromkeys(("evaluate", "open_clip", "predict", "show"), "api")
    _MODULE_OF |= dict.fromkeys(("build", "load"), "registry")

    def __getattr__(name: str) -> object:
        """The public name, from its module; AttributeError for any other."""
        import importlib
        from importlib import metadata

        if name not in __all__:
            raise AttributeError(f"module 'geovp_classic' has no attribute {name!r}")
        if name == "__version__":
            value: object = metadata.version("geovp-classic")
        else:
            value = getattr(
                importlib.import_module(f"geovp_classic.{_MODULE_OF.get(name, 'types')}"), name
            )
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted(__all__)
