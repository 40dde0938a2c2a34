"""Exceptions; a message states what was given, what was expected and what to do."""


class GeovpError(Exception):
    """Base of all errors that a user can correct; the command line prints them in one line."""


class BadData(GeovpError):
    """Invalid file, folder, array or setting."""


class Incompatible(GeovpError):
    """Components that cannot work together or with a clip; the method is skipped."""


class UnknownComponent(GeovpError):
    """Unregistered name of a component; the message suggests the nearest name."""


class MissingExtra(GeovpError):
    """Registered component with a requirement that is not installed or not on disk."""
