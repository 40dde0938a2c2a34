"""How near the nearest of a few futures comes to the truth: minADE, and the same of rotations and
in the image.

Independent draws beside representative ones of the same distribution, on windows of pose files.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product

import numpy as np

from geovp_benchmarks.analysis.intervals import interval
from geovp_benchmarks.evaluation.forecasting.evaluation import Window
from geovp_benchmarks.progress import Progress, no_progress
from geovp_classic.forecasting.kalman import TurnRateKalman
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.forecasting.representative import ImageDistance, Representative
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Forecaster
from geovp_classic.types import FloatArray

ERRORS = ("ADE m", "rotation deg", "in the image deg")
REPRESENTED = ", representative"


def forecasters() -> dict[str, Forecaster]:
    """The rows: each source as it draws, and represented."""
    sources: dict[str, Forecaster] = {"CTRV": TurnRateKalman(), "motion prior": MotionPrior()}
    return {name: one for name, source in sources.items() for name, one in _both(name, source)}


def errors(
    windows: Sequence[Window],
    rows: Mapping[str, Forecaster],
    counts: Sequence[int],
    progress: Progress = no_progress,
) -> dict[str, FloatArray]:
    """The least error of the first k futures [N, len(counts), 3], one after the other of ERRORS,
    each by itself.
    """
    found: dict[str, list[FloatArray]] = {name: [] for name in rows}
    for done, ((past, future), (name, forecaster)) in enumerate(
        product(windows, rows.items()), start=1
    ):
        one, several = (
            forecaster.forecast(past, future.times_s, count) for count in (1, max(*counts, 2))
        )
        alone, each = (_of_each(futures, future.world_from_cam) for futures in (one, several))
        found[name].append(
            np.stack([(alone if count == 1 else each[:count]).min(axis=0) for count in counts])
        )
        progress(done, len(windows) * len(rows))
    return {name: np.stack(values) for name, values in found.items()}


def as_lines(
    table: Mapping[str, FloatArray],  # of `errors`
    counts: Sequence[int],
    sequences: Sequence[str],  # [N], that the windows are cut from
) -> Iterator[str]:
    """A table in Markdown: means, and what the represented row has more than the drawn one, with
    intervals.
    """
    heads = [f"{name}, best of {count}" for name in ERRORS for count in counts]
    yield f"| forecaster | {' | '.join(heads)} |"
    yield f"| --- | {' | '.join('---:' for _ in heads)} |"
    for name, values in table.items():
        yield f"| {name} | {' | '.join(f'{mean:.3f}' for mean in values.mean(axis=0).T.ravel())} |"
        drawn = table.get(name.removesuffix(REPRESENTED))
        if name.endswith(REPRESENTED) and drawn is not None:
            columns = np.moveaxis(values - drawn, 2, 1).reshape(len(values), -1).T
            less = [interval(column, np.array(sequences)) for column in columns]
            texts = [f"{one.mean:+.3f} [{one.low:+.3f}, {one.high:+.3f}]" for one in less]
            yield f"| more than {name.removesuffix(REPRESENTED)} | {' | '.join(texts)} |"


def _both(name: str, source: Forecaster) -> Iterator[tuple[str, Forecaster]]:
    yield name, source
    yield name + REPRESENTED, Representative(source)


def _of_each(futures: FloatArray, truth: FloatArray) -> FloatArray:
    """ERRORS [S, 3] of futures [S, F, 4, 4]."""
    position_m = np.linalg.norm(futures[..., :3, 3] - truth[:, :3, 3], axis=-1)
    rotation_deg = np.degrees(se3.rotation_angle_rad(se3.inverse(truth) @ futures))
    distance = ImageDistance()
    motions = distance.motions(truth, futures)
    shift_rad = distance.between(np.zeros_like(motions[:1]), motions)[0]
    return np.stack(
        [position_m.mean(axis=1), rotation_deg.mean(axis=1), np.degrees(shift_rad)], axis=1
    )
