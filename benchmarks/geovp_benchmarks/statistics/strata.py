"""Results by attributes of the clips, which are stored with their scores.

They follow from true poses, exact depths and moving objects; without exact depth, `seen` is the
fraction of pixels that a method covers.
"""

import itertools
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from geovp_benchmarks.results.score_names import COVERAGE
from geovp_benchmarks.results.scores import nanmean
from geovp_benchmarks.results.store import Results
from geovp_classic.errors import BadData, nearest

DIVISIONS = {  # the attribute, and bounds of the strata
    "turning": ("yaw_deg", (5.0,)),
    "speed": ("speed_m_s", (5.0, 10.0)),
    "step": ("step_m", (0.5, 1.0)),  # of two frames
    "seen": ("seen", ()),  # fraction of pixels that were seen before; as many clips in each third
    "moving": ("moving", (0.01,)),  # fraction of pixels
    "masked": ("masked", (0.01,)),  # fraction of pixels
}
FACTS = {  # in words, and their units
    "yaw_deg": ("turn", "degrees"),
    "speed_m_s": ("speed", "m/s"),
    "step_m": ("step of two frames", "m"),
    "seen": ("fraction of pixels seen before", ""),
    "moving": ("fraction of pixels of moving objects", ""),
    "masked": ("fraction of pixels fixed to the camera", ""),
    "disoccluded": ("fraction of disoccluded pixels", ""),
    "static": ("fraction of static pixels", ""),
}


def divide(results: Results, by: str) -> list[Results]:
    """Return a subset per stratum that has clips; raise BadData if the attribute is unknown.

    An attribute in words, such as the kind of a video, has a stratum per text.
    """
    # Texts of the data set count before numbers of the same name.
    stored = results.clip_facts()
    stated = [item for facts in stored.values() for item in facts.items()]
    words = {name for name, value in stated if isinstance(value, str)}
    if by in words:
        texts: dict[str, list[str]] = {}
        for clip in results.protocol()["clips"]:
            text = stored.get(clip, {}).get(by, "unknown")
            texts.setdefault(str(text), []).append(clip)
        return [_subset(results, clips, f"{by}: {text}") for text, clips in texts.items()]
    if by not in DIVISIONS:
        raise BadData(f"clips cannot be divided by {by!r}{nearest(by, [*DIVISIONS, *words])}")
    # Numbers of the clips; without exact depth, coverage stands for the pixels seen before.
    fact, bounds = DIVISIONS[by]
    facts = {clip: float(numbers[fact]) for clip, numbers in stored.items() if fact in numbers}
    source = ""
    if not facts and fact == "seen":
        facts, source = _covered(results.select())
    if not facts:
        raise BadData(
            f"{results.root} has the {FACTS[fact][0]} of no clip: the data set has no true poses "
            "or depths, or an older version computed the methods (`geovp run --fresh` recomputes "
            "them)"
        )
    # Each clip belongs to the stratum between two bounds.
    name, unit = FACTS[fact]
    bounds = bounds or tuple(np.quantile(list(facts.values()), [1 / 3, 2 / 3]).tolist())
    inner = [f"{low:.3g} to {high:.3g} {unit}" for low, high in itertools.pairwise(bounds)]
    last = f"{bounds[-1]:.3g} {unit}".strip()
    labels = [f"below {bounds[0]:.3g} {unit}", *inner, f"{last} or more", "unknown"]
    clips: dict[str, list[str]] = {label: [] for label in labels}
    for clip in results.protocol()["clips"]:
        rank = np.searchsorted(bounds, facts[clip], side="right") if clip in facts else -1
        clips[labels[rank]].append(clip)
    return [
        _subset(results, names, f"{name} {label.strip()}{source}")
        for label, names in clips.items()
        if names
    ]


def _subset(results: Results, clips: Iterable[str], label: str) -> Results:
    return replace(results, subset=frozenset(clips), label=label)


def _covered(results: Results) -> tuple[dict[str, float], str]:
    """Return the fraction of pixels that a method covers by clip, and its name in words."""
    for method in results.methods():
        if method.renderer and method.status == "done":
            samples = results.means(method.name)[COVERAGE]
            covered = nanmean(samples, axis=1).tolist()  # over samples
            facts = dict(zip(results.protocol()["clips"], covered, strict=True))
            return facts, f", as {method.label} covers it"
    return {}, ""
