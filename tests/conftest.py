"""Settings of the whole suite: property tests never fail for slowness, only for being wrong.

Where CI is set, they try the same examples every time, so that a checkout passes or fails whenever it is run; on a
developer's machine they go on looking for new ones.
"""

import os

from hypothesis import settings

settings.register_profile("geovp", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("geovp")
