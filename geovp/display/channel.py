"""Simulated radio channel: delays images, reorders them and loses some."""

from dataclasses import dataclass, field
from queue import PriorityQueue

import numpy as np

from geovp_classic.types import ByteArray


@dataclass(frozen=True, order=True)
class Sent:
    """An image on its way."""

    arrival_s: float  # on the clock of `send` and `receive`
    number: int
    time_s: float  # when it was taken
    frame: ByteArray  # [H, W, 3]; never compared, because numbers differ


@dataclass(frozen=True)
class Channel:
    """A channel with the images on their way; one thread may send while another receives.

    Delay and loss of an image are functions of its number.
    """

    latency_s: float = 0.5
    jitter_s: float = 0.0  # largest additional delay, uniformly distributed
    loss: float = 0.0  # probability
    _sent: PriorityQueue[Sent] = field(default_factory=PriorityQueue, init=False, repr=False)

    def send(self, number: int, frame: ByteArray, time_s: float, now_s: float) -> None:
        """Send an image, which may get lost."""
        loss, jitter = np.random.default_rng((0, number)).random(2).tolist()
        if loss >= self.loss:
            arrival_s = now_s + self.latency_s + self.jitter_s * jitter
            self._sent.put(Sent(arrival_s, number, time_s, frame))

    def receive(self, now_s: float) -> list[Sent]:
        """Return the images that arrived since the last call, in the order of their arrival."""
        arrived = []
        while not self._sent.empty() and self._sent.queue[0].arrival_s <= now_s + 1e-6:  # rounding
            arrived.append(self._sent.get())
        return arrived
