"""What sets clips apart: labels that may explain why a method predicts some of them badly."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from geovp_benchmarks.results import stored_facts
from geovp_benchmarks.results.score_names import COVERAGE
from geovp_benchmarks.results.scores import nanmean
from geovp_benchmarks.results.store import Method, Results

OF_CLIPS = {  # attribute -> (whether high values are hard, label)
    "yaw_deg": (True, "large turn"),
    "speed_m_s": (True, "high speed"),
    "seen": (False, "few pixels seen before"),
    "moving": (True, "many pixels of moving objects"),
    "masked": (True, "many pixels fixed to the camera"),
}


def of_clips(results: Results, method: Method) -> dict[str, list[str]]:
    """Return the labels of each clip.

    A clip has a label if it is among the hardest quarter of all clips by an attribute of the clips,
    or by the pose errors or the coverage of the method. Texts of the data set, fallbacks and
    failures are labels, too.
    """
    protocol, facts = results.protocol(), results.clip_facts()
    clips, means = protocol["clips"], results.means(method.name)
    # How hard each clip is, by label: higher is harder.
    hardness: dict[str, list[float]] = {}
    for name, (is_high_hard, label) in OF_CLIPS.items():
        stored = [facts.get(clip, {}).get(name) for clip in clips]
        numbers = [value if isinstance(value, float) else math.nan for value in stored]
        hardness[label] = [number if is_high_hard else -number for number in numbers]
    if COVERAGE in means:
        hardness["low coverage"] = (-nanmean(means[COVERAGE], axis=1)).tolist()
    # Of the pose errors, the first of each unit: those of one unit label the same clips.
    pose_errors: dict[str, str] = {}
    for metric, about in protocol["metrics"].items():
        if about["role"] == "trajectory" and about.get("higher_is_better") is False:
            pose_errors.setdefault(about.get("unit", ""), metric)
    for metric in pose_errors.values():
        if metric in means:
            hardness[f"large {stored_facts.title(metric)}"] = nanmean(
                means[metric], axis=1
            ).tolist()
    # The words of the data set, then what is among the hardest quarter.
    labels = {
        clip: [
            f"{name}: {value}"
            for name, value in facts.get(clip, {}).items()
            if isinstance(value, str)
        ]
        for clip in clips
    }
    for label, values in hardness.items():
        if np.isfinite(values).any():
            middle, hard = np.nanquantile(values, [0.5, 0.75])
            for clip, value in zip(clips, values, strict=True):
                if value >= hard and value > middle:  # equal clips have no label
                    labels[clip].append(label)
    # What the method did.
    for clip, shown_by in method.scored.shown_by.items():
        if shown_by in stored_facts.FALLBACKS:
            labels[clip].append(f"shown by {stored_facts.FALLBACKS[shown_by]}")
    for clip in method.scored.failures:
        labels[clip].append("failed")
    return labels


def frequent(
    labels: Mapping[str, Sequence[str]], worst: Sequence[str], count: int = 3
) -> list[tuple[str, int, int]]:
    """Return the labels that are most overrepresented among the worst clips.

    Each has its number of clips among the worst and among the others.
    """
    others = [clip for clip in labels if clip not in worst]
    inside, outside = (
        Counter(label for clip in clips for label in labels[clip]) for clips in (worst, others)
    )
    excess = {
        label: number / len(worst) - outside[label] / max(len(others), 1)
        for label, number in inside.items()
    }
    ranked = sorted(excess, key=lambda label: (excess[label], label), reverse=True)
    return [(label, inside[label], outside[label]) for label in ranked[:count] if excess[label] > 0]
