"""Put a component through the contract tests of its role."""

import argparse

from geovp_benchmarks.arguments import add_settings, settings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which component, with which settings."""
    parser.add_argument("role", metavar="ROLE", help="such as renderers")
    parser.add_argument("name", metavar="NAME", help="as `geovp list` shows it")
    add_settings(parser)


def run(chosen: argparse.Namespace) -> int:
    """Print the tests that pass and those that fail."""
    from geovp_benchmarks.audit import contracts
    from geovp_classic import registry

    component = registry.build(chosen.role, {"name": chosen.name, **settings(chosen)})
    findings = contracts.check(chosen.role, component)
    for finding in findings:
        detail = f": {finding.detail}" if finding.detail else ""
        print(f"{'passed' if finding.passed else 'FAILED'}  {finding.name}{detail}")
    passed = sum(finding.passed for finding in findings)
    print(f"{chosen.name}: {passed} of {len(findings)} checks passed")
    return int(passed < len(findings))
