"""Commanded motion: from a CSV file, or from the driver at the page."""

import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from geovp_classic import files
from geovp_classic.streaming import Command


def read_commands(path: Path) -> list[Command]:
    """Read commands in increasing time from a CSV file; BadData for another file."""
    header = "time_s,speed_m_s,yaw_rate_rad_s"
    expected = f"the first line must be {header}, then three numbers a line in increasing time"
    text = files.read_text(path, files.MIB)
    with files.checked(f"{path} is not a file of commands", expected):
        first, *lines = text.splitlines()
        if first != header or not any(lines):
            raise ValueError(f"its first line is {first!r}, before {len(lines)} others")
        table = np.loadtxt(lines, delimiter=",", ndmin=2)
        if (np.diff(table[:, 0]) < 0).any():
            raise ValueError("times decrease")
        return [Command(*row) for row in table.tolist()]


@dataclass(frozen=True)
class Driver:
    """Commands of the driver at the page, who repeats the last one until the next."""

    max_silence_s: float = 2.0  # pages in the background send once per second
    commands: deque[Command] = field(default_factory=lambda: deque(maxlen=256))

    def steer(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Set speed and yaw rate from now on."""
        self.commands.append(Command(time.monotonic(), speed_m_s, yaw_rate_rad_s))

    def at(self, now_s: float) -> Sequence[Command]:
        """Return the commands in the time of the images, where it is `now_s`.

        There are none if the driver is silent, so that the motion is forecast.
        """
        commands, clock_s = tuple(self.commands), time.monotonic()
        if commands and clock_s - commands[-1].time_s > self.max_silence_s:
            return []
        return [replace(command, time_s=command.time_s - clock_s + now_s) for command in commands]
