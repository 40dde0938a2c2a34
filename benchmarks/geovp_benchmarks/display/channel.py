"""Simulated radio channel: delays images, reorders them and loses some."""

from dataclasses import dataclass
from queue import PriorityQueue

import numpy as np

from geovp_classic.types import ByteArray


@dataclass(frozen=True, order=True)
class Sent:
    """An image on its way."""

    arrival_s: float  # since the start of the replay
    number: int
    time_s: float  # when it was taken
    frame: ByteArray  # [H, W, 3]; never compared, because numbers differ


@dataclass(frozen=True)
class Channel:
    """Delay and loss of each image, as a function of its number."""

    latency_s: float = 0.5
    jitter_s: float = 0.0  # largest additional delay, uniformly distributed
    loss: float = 0.0  # probability
    seed: int = 0

    def delay_s(self, number: int) -> float | None:
        """Return the delay of an image, or None if it is lost."""
        loss, jitter = np.random.default_rng((self.seed, number)).random(2).tolist()
        return None if loss < self.loss else self.latency_s + self.jitter_s * jitter


class InFlight:
    """The images on their way, in the order of their arrival; one thread sends, one receives."""

    def __init__(self, channel: Channel) -> None:
        self.channel = channel
        self._sent: PriorityQueue[Sent] = PriorityQueue()

    def send(self, number: int, frame: ByteArray, time_s: float, now_s: float) -> None:
        """Send an image, which may get lost."""
        delay_s = self.channel.delay_s(number)
        if delay_s is not None:
            self._sent.put(Sent(now_s + delay_s, number, time_s, frame))

    def receive(self, now_s: float) -> list[Sent]:
        """Return the images that arrived since the last call."""
        arrived = []
        while not self._sent.empty() and self._sent.queue[0].arrival_s <= now_s + 1e-6:  # rounding
            arrived.append(self._sent.get())
        return arrived
