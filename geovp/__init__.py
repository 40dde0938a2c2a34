"""The public names of `geovp_classic` under the name of the distribution: `import geovp`."""

from typing import TYPE_CHECKING

import geovp_classic
from geovp_classic import __all__ as __all__

if TYPE_CHECKING:
    from geovp_classic import *  # noqa: F403


def __getattr__(name: str) -> object:
    """Look up a public name on first use."""
    return getattr(geovp_classic, name)


def __dir__() -> list[str]:
    return dir(geovp_classic)
