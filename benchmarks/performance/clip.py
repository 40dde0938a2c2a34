"""How long one clip takes all the way on this machine: odometry, forecast, depth, fusion, views; and how much memory.

`python -m benchmarks.performance.clip [ROUNDS [ROOT SEQUENCE]]`: ten frames seen, twenty predicted, at 256x256, on a
clip of the synthetic street or of KITTI. The first round, which loads compiled code, is not counted. The processor's
time stands beside the clock's: on a machine that others use as well, the clock says how busy it is.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from benchmarks.commands import command, whole_numbers
from geovp_classic import registry
from geovp_classic.depth.multiview import Multiview
from geovp_classic.errors import BadData
from geovp_classic.interfaces import DepthSource
from geovp_classic.pose_sources import Chained
from geovp_classic.renderers import DepthFusion
from geovp_classic.types import Clip, Context, FloatArray, Grant, Trajectory, Views

NUM_PAST = 10
STAGES = ("odometry", "forecast", "depth", "registration and fusion", "views")
Seconds = tuple[float, float]  # of the clock and of the processor, all threads

Result = TypeVar("Result")


@dataclass(frozen=True)
class Timing:
    """What the rounds took, stage by stage."""

    taken_s: FloatArray  # [rounds, stages, 2], by the clock and of the processor
    first_s: float  # the first round by the clock, all stages
    peak_mb: float  # of the whole process

    def lines(self) -> list[str]:
        """Medians over rounds, in words."""
        stages = np.median(self.taken_s, axis=0)
        whole = np.median(self.taken_s.sum(axis=1), axis=0)
        rows = [*zip(STAGES, stages, strict=True), ("all", whole)]
        told = [f"{name:<24}{1e3 * clock:6.0f} ms{1e3 * processor:7.0f} ms" for name, (clock, processor) in rows]
        head = f"{len(self.taken_s)} rounds, medians by the clock and of the processor"
        return [head, *told, f"first round {self.first_s:.1f} s; peak memory of the process {self.peak_mb:.0f} MB"]


@dataclass(frozen=True)
class Watched:
    """A depth source that says how long it took."""

    source: DepthSource = field(default_factory=Multiview)
    taken: list[Seconds] = field(default_factory=list)

    @property
    def needs(self) -> Grant:
        """What the source needs."""
        return self.source.needs

    def inverse_depths(self, context: Context, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        """The source's own."""
        found, seconds = timed(lambda: self.source.inverse_depths(context, past))
        self.taken.append(seconds)
        return found


def timed(work: Callable[[], Result]) -> tuple[Result, Seconds]:
    """What the work gives, and how long it took."""
    clock, processor = time.perf_counter(), time.process_time()
    result = work()
    return result, (time.perf_counter() - clock, time.process_time() - processor)


def one_clip(context: Context) -> tuple[Views, list[Seconds]]:
    """The clip predicted with `chained` and `depth-fusion` as they are, and the times of the stages."""
    source, depth = Chained(), Watched()
    renderer = DepthFusion(depth=depth)
    (past, _), odometry = timed(lambda: source.odometry.track(context.only(source.odometry.needs)))
    futures, forecast = timed(lambda: source.forecaster.forecast(past, context.times_s[NUM_PAST:]))
    scene, built = timed(lambda: renderer.reconstruct(context.only(renderer.needs), past))
    views, shown = timed(lambda: scene.view(futures[0], context.times_s[context.num_past :], context.intrinsics))
    own = depth.taken[0]
    return views, [odometry, forecast, own, (built[0] - own[0], built[1] - own[1]), shown]


def measure(clip: Clip, rounds: int) -> Timing:
    """Predict the clip once without counting and then `rounds` times."""
    context, _ = clip.split(NUM_PAST, Chained().needs | DepthFusion().needs)
    taken_s = np.array([one_clip(context)[1] for _ in range(rounds + 1)])
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return Timing(taken_s[1:], float(taken_s[0, :, 0].sum()), peak_mb)


@command
def main(arguments: Sequence[str]) -> str:
    """The timing in words."""
    usage, where = "[ROUNDS [ROOT SEQUENCE]]", arguments[1:]
    (rounds,) = whole_numbers(arguments[:1], (10,), usage)
    if len(where) not in (0, 2):
        raise BadData(f"arguments {' '.join(arguments)!r}: expected {usage}")
    spec = {"name": "kitti", "root": where[0], "sequences": [where[1]]} if where else {"name": "synthetic"}
    dataset = registry.build("datasets", {**spec, "num_frames": 30})
    return "\n".join(measure(dataset[0], rounds).lines())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
