"""Size of a plain installation with all libraries that it needs, which must stay below 1.2 GB."""

from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement


def add_needed(name: str, needed: dict[str, metadata.Distribution]) -> None:
    """Add a distribution and those that it requires without extras."""
    if name in needed:
        return
    needed[name] = metadata.distribution(name)
    for line in needed[name].requires or ():
        requirement = Requirement(line)
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            add_needed(requirement.name.lower().replace("_", "-"), needed)


def main() -> None:
    """Print the size; exit with an error if it is not below the limit."""
    needed: dict[str, metadata.Distribution] = {}
    add_needed("geovp", needed)
    files = {Path(str(file.locate())) for each in needed.values() for file in each.files or ()}
    size_mb = sum(path.stat().st_size for path in files if path.exists()) / 1e6
    print(f"{size_mb:.1f} MB in {len(needed)} distributions")
    if size_mb >= 1200:
        raise SystemExit("a plain installation must take less than 1.2 GB")


if __name__ == "__main__":
    main()
