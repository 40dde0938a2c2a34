"""Names of the components that this distribution registers, whatever else is installed."""

from importlib import metadata


def names(role: str) -> list[str]:
    """Return the sorted names of a role, without those of third-party plug-ins."""
    entry_points = metadata.distribution("geovp").entry_points.select(group=f"geovp.{role}")
    return sorted(entry_point.name for entry_point in entry_points)
