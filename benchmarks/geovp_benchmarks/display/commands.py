"""Commanded motion: from a CSV file, or from the driver at the page."""

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from geovp_classic import files
from geovp_classic.streaming import Command

HEADER = "time_s,speed_m_s,yaw_rate_rad_s"


class Commands(Protocol):
    """Commands by the present time; empty if the motion is to be forecast."""

    def at(self, now_s: float) -> Sequence[Command]:
        """Return the commands up to the present, in increasing time."""


@dataclass(frozen=True)
class PlannedCommands:
    """Commands with the times of the recording."""

    commands: tuple[Command, ...] = ()

    @classmethod
    def read(cls, path: Path) -> "PlannedCommands":
        """Read a CSV file; BadData if columns are missing, or times decrease."""
        first, *lines = files.read_text(path, files.MIB).splitlines() or [""]
        expected = f"the first line must be {HEADER}, then three numbers a line in increasing time"
        with files.checked(f"{path} is not a file of commands", expected):
            if first != HEADER or not any(lines):
                raise ValueError(f"its first line is {first!r}, before {len(lines)} others")
            table = np.loadtxt(lines, delimiter=",", ndmin=2)
            if not np.isfinite(table).all() or (np.diff(table[:, 0]) < 0).any():
                raise ValueError("a number is not finite, or times decrease")
            return cls(tuple(Command(*row) for row in table.tolist()))

    def at(self, now_s: float) -> Sequence[Command]:
        """Return all commands; later ones plan the path."""
        return self.commands


class Driver:
    """Commands of the driver at the page, who repeats the last one until the next."""

    def __init__(
        self,
        clock: Callable[[], float] = time.monotonic,
        max_commands: int = 256,
        max_silence_s: float = 2.0,  # pages in the background send once per second
    ) -> None:
        self._clock = clock
        self._max_silence_s = max_silence_s
        self._commands: deque[Command] = deque(maxlen=max_commands)

    def steer(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Set speed and yaw rate from now on."""
        self._commands.append(Command(self._clock(), speed_m_s, yaw_rate_rad_s))

    def release(self) -> None:
        """Forget all commands, so that the motion is forecast again."""
        self._commands.clear()

    def at(self, now_s: float) -> Sequence[Command]:
        """Return the commands in the time of the images, where it is `now_s`."""
        commands, clock_s = tuple(self._commands), self._clock()
        if commands and clock_s - commands[-1].time_s > self._max_silence_s:
            return []
        return [replace(command, time_s=command.time_s - clock_s + now_s) for command in commands]
