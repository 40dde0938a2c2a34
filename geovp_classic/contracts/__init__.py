"""Contract tests for any component, ours or a plug-in's: `check(role, component)` lists the promises it breaks."""

from geovp_classic.contracts.checks import Finding, check

__all__ = ["Finding", "check"]
