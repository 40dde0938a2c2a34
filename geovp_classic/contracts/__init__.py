"""Checks that any component, ours or a plug-in's, can be put through: `check(role, component)` says what it breaks."""

from geovp_classic.contracts.checks import Finding, check

__all__ = ["Finding", "check"]
