"""Contract tests of components: `check(role, component)` lists broken promises of its interface."""

from geovp_benchmarks.audit.contracts.checks import Finding, check

__all__ = ["Finding", "check"]
