"""What a plain `pip install .` puts beside Python: the package and all that it needs, which is to
stay below 1 GB.
"""

from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

LIMIT_BYTES, FOLDER_BYTES = 10**9, 4096


def needed(name: str, found: dict[str, metadata.Distribution]) -> dict[str, metadata.Distribution]:
    """A distribution and those that it requires without extras, by name."""
    if name not in found:
        found[name] = metadata.distribution(name)
        for line in found[name].requires or ():
            requirement = Requirement(line)
            if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
                needed(requirement.name.lower().replace("_", "-"), found)
    return found


def main() -> None:
    """Print the size as `du -sb` counts it; exit with a sentence when it is not below the limit."""
    found = needed("geovp-classic", {})
    inside = {
        each: [file for file in each.files or () if ".." not in file.parts]
        for each in found.values()
    }
    paths = {Path(str(each.locate_file(file))) for each, own in inside.items() for file in own}
    folders = {
        Path(str(each.locate_file(up)))
        for each, own in inside.items()
        for file in own
        for up in file.parents
    }
    total = sum(path.stat().st_size for path in paths if path.exists()) + FOLDER_BYTES * len(
        folders
    )
    print(f"{total / 1e6:.1f} MB in {len(found)} distributions")
    if total >= LIMIT_BYTES:
        raise SystemExit(f"a plain install takes {total} bytes, expected less than {LIMIT_BYTES}")


if __name__ == "__main__":
    main()
