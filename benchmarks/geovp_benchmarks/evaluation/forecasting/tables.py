"""Tables of forecasters' scores: errors, and how well the predictive distributions
hold what came.
"""

import json
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from geovp_benchmarks.evaluation.forecasting.evaluation import Scores
from geovp_classic.types import FloatArray

REGIONS = (0.5, 0.9)
BODY = (("height", "m"), ("pitch", "deg"), ("roll", "deg"))  # over the plane
TURNING_DEG = 15.0  # a window that truly turns more than this is one of the turning ones


def columns(scores: Scores) -> dict[str, float]:
    """One row's numbers; NaN where there is nothing to measure."""
    num_future = scores.position_m.shape[1]
    steps = [step for step in (1, 10, 20) if step <= num_future]
    row = {f"error @{step} m": float(scores.position_m[:, step - 1].mean()) for step in steps}
    row["ADE m"] = float(scores.position_m.mean())
    row["FDE m"] = float(scores.position_m[:, -1].mean())
    row[f"yaw @{num_future} deg"] = float(scores.yaw_deg[:, -1].mean())
    row["median"] = float(np.median(scores.yaw_deg[:, -1]))
    for number, (name, unit) in enumerate(BODY):
        row[f"{name} @1 {unit}"] = float(scores.body[:, 0, number].mean())
        row[f"{name} {unit}"] = float(scores.body[..., number].mean())
    row["NLL nats"] = float(scores.negative_log_density.mean())
    row["energy m"] = float(scores.energy_m.mean())
    for region in REGIONS:
        row[f"in {region:.0%}"] = _share(scores.rank, region)
        row[f"in {region:.0%} @{num_future}"] = _share(scores.rank[:, -1], region)
    for number, (name, unit) in enumerate((*BODY, ("all six", ""))):
        for region in REGIONS:
            row[f"{name} in {region:.0%}"] = _share(scores.body_rank[..., number], region)
        row[f"{name} in {REGIONS[-1]:.0%} @{num_future}"] = _share(
            scores.body_rank[:, -1, number], REGIONS[-1]
        )
        if unit:
            row[f"{name} energy {unit}"] = float(scores.body_energy[:, number].mean())
    turning = np.abs(scores.turned_deg) > TURNING_DEG
    row["ADE m, turning"] = float(scores.position_m[turning].mean()) if turning.any() else np.nan
    row[f"yaw @{num_future} deg, turning"] = (
        float(scores.yaw_deg[turning, -1].mean()) if turning.any() else np.nan
    )
    return row


def as_lines(table: Mapping[str, Scores]) -> Iterator[str]:
    """The number of turning windows, and two tables in Markdown: errors, and the predictive
    distributions.
    """
    rows = {name: columns(scores) for name, scores in table.items()}
    turned_deg = next(iter(table.values())).turned_deg
    num_turning = (np.abs(turned_deg) > TURNING_DEG).sum()
    yield f"turning: {num_turning} windows, by more than {TURNING_DEG:g} degrees"
    spread = {name: row for name, row in rows.items() if not np.isnan(row["NLL nats"])}
    for shown, is_wanted in ((rows, False), (spread, True)):
        heads = [
            head for head in next(iter(rows.values())) if _is_of_distribution(head) == is_wanted
        ]
        if not shown:
            continue
        yield ""
        yield "| forecaster | " + " | ".join(heads) + " |"
        yield "| --- |" + " ---: |" * len(heads)
        for name, row in shown.items():
            cells = ("-" if np.isnan(row[head]) else f"{row[head]:.3f}" for head in heads)
            yield f"| {name} | " + " | ".join(cells) + " |"


def as_json(table: Mapping[str, Scores], sequences: Sequence[str]) -> str:
    """The same numbers, null for what cannot be measured."""
    rows = {name: columns(scores) for name, scores in table.items()}
    known = {
        name: {key: None if np.isnan(x) else x for key, x in row.items()}
        for name, row in rows.items()
    }
    turned_deg = next(iter(table.values())).turned_deg
    turning = int((np.abs(turned_deg) > TURNING_DEG).sum())
    about = {"sequences": list(sequences), "windows": len(turned_deg), "turning_windows": turning}
    return json.dumps({**about, "forecasters": known}, indent=2)


def _is_of_distribution(head: str) -> bool:
    return "NLL" in head or "energy" in head or "in " in head


def _share(rank: FloatArray, region: float) -> float:
    return float("nan") if np.isnan(rank).any() else float((rank <= region).mean())
