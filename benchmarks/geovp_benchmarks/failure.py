"""Failure of a component, method or clip, as data."""

import traceback
from typing import NamedTuple, Self

from geovp_classic.errors import BadData, Incompatible, MissingExtra

ERRORS = (Exception, SystemExit)  # of components: a plug-in may call sys.exit


class Failure(NamedTuple):
    """The reason why a method, component or metric is skipped or failed."""

    status: str  # "skipped" or "failed"
    reason: str
    traceback: str = ""

    @classmethod
    def of(cls, error: BaseException) -> Self:
        """Return "skipped" for incompatible or missing components, "failed" for other errors."""
        if isinstance(error, (Incompatible, MissingExtra)):
            return cls("skipped", str(error))
        trace = "".join(traceback.format_exception(error))
        reason = str(error) if isinstance(error, BadData) else f"{type(error).__name__}: {error}"
        return cls("failed", reason.strip().partition("\n")[0].removesuffix(":"), trace)
