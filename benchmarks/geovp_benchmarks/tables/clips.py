"""Table of clips: what they are, how well methods predict them, and what shows them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from geovp_benchmarks.results import stored_facts
from geovp_benchmarks.results.score_names import COVERAGE
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.statistics import strata
from geovp_benchmarks.tables import causes
from geovp_benchmarks.tables.tables import method_scores


def per_clip(results: Results, metrics: Sequence[str] = ()) -> list[list[Any]]:
    """Return the cells of a table with a row per clip, those with the worst score first.

    It shows the scores of the methods, what they show a clip by where that varies, and what is
    known of the clips, else None; it is empty without scores. The first method with scores orders
    the clips, and labels say what sets them apart. Metrics are by default the first of frames and
    of poses, and the coverage.
    """
    protocol, facts = results.protocol(), results.clip_facts()
    clips = protocol["clips"]
    roles = {about["role"]: key for key, about in reversed(protocol["metrics"].items())}
    defaults = roles.get("frame", ""), COVERAGE, roles.get("trajectory", "")
    keys = metrics or [*dict.fromkeys(defaults)]
    columns: dict[str, list[Any]] = {"clip": clips}

    # How well the methods predict them.
    order = None
    for method in (method for method in results.methods() if method.num_clips):
        scores = method_scores(results, [method])[0].scores
        failures, shown_by = method.scored.failures, method.scored.shown_by
        for key in (key for key in keys if key in scores):
            about, of_method = stored_facts.facts_of(key, protocol), scores[key].values
            heading = stored_facts.with_unit(stored_facts.title(key), about.get("unit", ""))
            columns[f"{method.label}: {heading}"] = of_method.tolist()
            if order is None:
                order = np.argsort(of_method if about.get("higher_is_better") else -of_method)
                labels = causes.of_clips(results, method)
        ways = {clip: stored_facts.FALLBACKS.get(way, way) for clip, way in shown_by.items()}
        ways |= dict.fromkeys(failures, "a copy (failed)")
        if {*ways.values()} - {"geometry"}:
            columns[f"{method.label}: shown by"] = [*map(ways.get, clips)]
    if order is None:
        return []
    # Words of the data set have columns of their own
    columns["labels"] = [
        ", ".join(label for label in labels[clip] if ": " not in label) for clip in clips
    ]

    # What the clips are: numbers, then words of the data set.
    names = dict.fromkeys(name for of_clip in facts.values() for name in of_clip)
    for name in [*strata.FACTS, *(name for name in names if name not in strata.FACTS)]:
        values = [facts.get(clip, {}).get(name) for clip in clips]
        if name != "interval_s" and set(values) != {None}:
            is_text = any(isinstance(value, str) for value in values)
            words, unit = (name, "") if is_text else strata.FACTS.get(name, (name, ""))
            columns[stored_facts.with_unit(words, unit)] = values
    return [[*columns], *([column[row] for column in columns.values()] for row in order)]


def rounded(lines: list[list[Any]]) -> list[list[str]]:
    """Return cells as text for people, with four digits, and "-" for what is not known."""
    return [
        [f"{cell:.4g}" if isinstance(cell, float) else cell or "-" for cell in line]
        for line in lines
    ]
