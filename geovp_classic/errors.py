"""Exceptions; every message says what was given, what was expected and what to do."""


class GeovpError(Exception):
    """Base of all errors that a user can correct; the command line prints them in one line and
    exits with 2.
    """


class BadData(GeovpError):
    """A file, folder, array or setting is not what it should be."""


class Incompatible(GeovpError):
    """Two parts cannot work together, or a part cannot work with this clip; the harness records the
    cell as skipped.
    """


class UnknownComponent(GeovpError):
    """No component of that name is registered; the message suggests the nearest one."""


class MissingExtra(GeovpError):
    """A component is registered, but something that it needs is not installed or not on disk."""
