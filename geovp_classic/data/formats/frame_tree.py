"""Coordinate frames that move in each other over time, as ROS's tf describes them."""

from dataclasses import dataclass, field

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray


@dataclass(frozen=True, eq=False)
class Link:
    """The motion of a frame in its parent, recorded in any order."""

    parent: str
    # parent_from_child [4, 4] by time in seconds
    poses: dict[float, FloatArray] = field(default_factory=dict)

    @property
    def is_fixed(self) -> bool:
        """Return whether the frame never moves, such as a mount, known at all times."""
        return bool(np.ptp([*self.poses.values()], axis=0).max() < 1e-6)

    def at(self, at_s: FloatArray, max_gap_s: float) -> FloatArray:
        """Return poses [N, 4, 4] interpolated between the neighbours in time.

        NaN before the first, after the last, and between neighbours more than `max_gap_s` apart.
        """
        times_s = np.array(sorted(self.poses))
        poses = np.array([self.poses[time_s] for time_s in times_s])
        if self.is_fixed:
            return np.tile(poses[0], (len(at_s), 1, 1))
        after = np.clip(np.searchsorted(times_s, at_s), 1, len(times_s) - 1)
        is_near = times_s[after] - times_s[after - 1] <= max_gap_s
        is_near &= (at_s >= times_s[0]) & (at_s <= times_s[-1])
        interpolated = se3.interpolate(poses, times_s, at_s)
        interpolated[~is_near] = np.nan
        return interpolated


class FrameTree(dict[str, Link]):
    """The link of each frame to its parent."""

    def add(self, parent: str, child: str, time_s: float, pose: FloatArray) -> None:
        """Add parent_from_child [4, 4] at a time; a frame keeps its first parent."""
        link = self.setdefault(child, Link(parent))
        if link.parent == parent:
            link.poses.setdefault(time_s, pose)

    def path(self, frame: str) -> list[Link]:
        """Return the links from a frame up to the root."""
        links: list[Link] = []
        while frame in self and len(links) < len(self):  # ends in a circle, too
            links.append(self[frame])
            frame = self[frame].parent
        return links
