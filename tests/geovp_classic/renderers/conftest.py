"""The world of tests/geovp_classic/rendering, for renderers."""

from tests.geovp_classic.rendering.conftest import camera, drive, plain, walled_plain

__all__ = ["camera", "drive", "plain", "walled_plain"]
