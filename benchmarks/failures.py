"""Failure is data: why a cell, a component or a metric cannot go on."""

from __future__ import annotations

import traceback
from dataclasses import dataclass
from typing import Any

from benchmarks.matrix import Spec
from geovp_classic import registry
from geovp_classic.errors import BadData, Incompatible, MissingExtra


@dataclass(frozen=True)
class Failure:
    """Why a cell, a component or a metric cannot go on."""

    status: str  # "skipped" or "failed"
    reason: str
    traceback: str = ""

    @classmethod
    def of(cls, error: Exception) -> Failure:
        """Skipped when the parts do not suit each other or something is not installed, failed otherwise."""
        if isinstance(error, (Incompatible, MissingExtra)):
            return cls("skipped", str(error))
        trace = "".join(traceback.format_exception(error))
        reason = str(error) if isinstance(error, BadData) else f"{type(error).__name__}: {error}"
        return cls("failed", reason.strip().partition("\n")[0], trace)


def build(role: str, name: str, spec: Spec) -> Any:
    """The component of a matrix file's entry, or a Failure when something that it needs is not installed."""
    try:
        return registry.build(role, spec, f"{role}.{name}")
    except (Incompatible, MissingExtra) as error:
        return Failure.of(error)
