"""Contract tests for any component, ours or a plug-in's: `check(role, component)` lists the
promises it breaks.
"""

from geovp_benchmarks.contracts.checks import Finding, check

__all__ = ["Finding", "check"]
