"""Studies behind the results pages, each with its figures; they are not installed."""

import pkgutil

from geovp_benchmarks import cli


def command_line() -> cli.ModuleParser:
    """Return the parser of all studies, one per module of this package."""
    parser = cli.ModuleParser(
        prog="python benchmarks/studies", description="Measurements behind the results pages."
    )
    parser.set_defaults(amount="normal")
    names = sorted(module.name for module in pkgutil.iter_modules(__path__))
    names.remove("__main__")
    modules = {name.replace("_", "-"): f"studies.{name}" for name in names}
    cli.add_modules(parser, modules, "NAME")
    return parser
