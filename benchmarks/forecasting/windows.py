"""Pose files cut into windows: some past steps, from which a forecaster must tell the future ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from geovp_classic.data import pose_files
from geovp_classic.errors import BadData
from geovp_classic.types import Trajectory


@dataclass(frozen=True)
class Cut:
    """How windows are cut."""

    num_past: int = 10
    num_future: int = 20
    stride: int = 5

    def __post_init__(self) -> None:
        """Raise BadData for counts below one."""
        if min(self.num_past, self.num_future, self.stride) < 1:
            raise BadData(
                f"windows of {self.num_past} past and {self.num_future} future steps, every {self.stride}: "
                "expected at least one of each"
            )


@dataclass(frozen=True)
class Window:
    """A piece of one sequence."""

    past: Trajectory
    future: Trajectory


def read(folder: Path, names: Sequence[str]) -> dict[str, Trajectory]:
    """The trajectories folder/NN.txt with times folder/NN_times.txt; BadData says which file is wrong."""
    return {
        name: pose_files.read_trajectory(folder / f"{name}.txt", pose_files.read_times(folder / f"{name}_times.txt"))
        for name in names
    }


def windows(trajectory: Trajectory, cut: Cut) -> Iterator[Window]:
    """All windows of one sequence; none when it is too short."""
    length = cut.num_past + cut.num_future
    for first in range(0, len(trajectory) - length + 1, cut.stride):
        middle = first + cut.num_past
        yield Window(trajectory[first:middle], trajectory[middle : first + length])
