"""GeoVP: geometry-based video prediction with a moving camera; the classical suite, without torch.

Public names are imported on first use, so that `import geovp` is fast; `__init__.pyi` lists them.
"""

import lazy_loader

from geovp_classic import numba_cache

numba_cache.choose_folder()
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
