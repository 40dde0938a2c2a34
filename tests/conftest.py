"""Settings of the whole suite: property tests never fail for slowness, only for being wrong."""

from hypothesis import settings

settings.register_profile("geovp", deadline=None)
settings.load_profile("geovp")
