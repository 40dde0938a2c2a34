"""Run the contract tests of a component.

Examples:
  geovp check renderers depth-fusion
  geovp check renderers '{name = "depth-fusion", crack_px = 0}'
"""

import argparse

from geovp_benchmarks.cli.options import LinesAndCode

ARGUMENTS = {
    "": {
        "role ROLE": "Role, such as renderers; see `geovp list`.",
        "component SPEC": "Name of a component, or its table as in TOML.",
    }
}


def run(args: argparse.Namespace) -> LinesAndCode:
    """Print the tests that pass and those that fail."""
    from geovp_benchmarks.checks import contracts
    from geovp_classic import registry

    component = registry.build(args.role, args.component)
    findings = contracts.check(args.role, component)
    for finding in findings:
        detail = f": {finding.detail}" if finding.detail else ""
        yield f"{'passed' if finding.passed else 'FAILED'}  {finding.name}{detail}"
    passed = sum(finding.passed for finding in findings)
    yield f"{registry.name_of(component)}: {passed} of {len(findings)} checks passed"
    return int(passed < len(findings))
