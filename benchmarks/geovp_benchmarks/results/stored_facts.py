"""What protocol.json and method.json say: a column's title, direction and bounds, the data, the
privileged inputs of a method.
"""

import math
from collections.abc import Iterable, Mapping
from typing import Any

from geovp_benchmarks.results.score_names import Bounds
from geovp_benchmarks.results.store import Method

MARKS = {  # PrivilegedInput -> (mark next to the method's name, its meaning)
    "PAST_POSES": ("p", "true past poses"),
    "FUTURE_POSES": ("f", "true future poses"),
    "PAST_DEPTHS": ("d", "true past depths"),
    "CAMERA_HEIGHT": ("h", "camera height"),
    "FULL_FRAMES": ("w", "uncropped frames"),
    "RIGHT_FRAMES": ("r", "right camera's frames"),
    "FUTURE_FRAMES": ("i", "future images, for poses only"),
}

FALLBACKS = {"image-motion": "image motion", "last-frame": "the last frame"}  # of ShownBy


def title(metric: str) -> str:
    """Return the name of a metric for people, such as "PSNR, covered pixels" for "psnr@covered"."""
    name, _, pixels = metric.partition("@")
    words = (
        name.upper()
        if len(name) <= 5 or name.startswith(("ms-ssim", "lpips-"))
        else name.replace("-", " ")
    )
    return f"{words}, {pixels} pixels" if pixels else words


def metric_of(key: str) -> str:
    """Return the metric of a column, such as "psnr" of "psnr@covered" or "psnr t+5"."""
    return key.split("@")[0].split(" ")[0]


def facts_of(key: str, protocol: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return what the protocol says about the metric of a column."""
    facts: Mapping[str, Any] = protocol["metrics"].get(metric_of(key), {})
    return facts


def with_unit(words: str, unit: str) -> str:
    """Return words with their unit, if they have one."""
    return f"{words} ({unit})" if unit else words


def labelled(words: str, about: Mapping[str, Any]) -> str:
    """Return words on a metric with its unit, and an arrow to its better values."""
    arrow = {None: "", True: " ↑", False: " ↓"}[about.get("higher_is_better")]
    return with_unit(words, about.get("unit", "")) + arrow


def bounds(about: Mapping[str, Any]) -> Bounds:
    """Return the lowest and highest value that a metric can have."""
    low, high = about.get("bounds") or (None, None)
    return (-math.inf if low is None else low, math.inf if high is None else high)


def data_name(protocol: Mapping[str, Any]) -> str:
    """Return the data set and its split, for people."""
    split = protocol["dataset"].get("split")
    return f"{protocol['dataset_name']}, split {split}" if split else str(protocol["dataset_name"])


def summary(protocol: Mapping[str, Any]) -> str:
    """Return the number of clips, and of frames that are observed and predicted, and their size."""
    frames = f"{protocol['num_past']} frames observed, the next {protocol['num_future']} predicted"
    width_px, height_px = protocol["size_px"]
    count = len(protocol["clips"])
    return (
        f"{count} clip{'s' * (count != 1)} of {data_name(protocol)}; {frames} at "
        f"{width_px}x{height_px}"
    )


def fallbacks(method: Method) -> str:
    """Return in words how many clips each fallback of a method shows; "" for none."""
    ways = [*method.scored.shown_by.values()]
    counts = [f"{ways.count(way)} by {words}" for way, words in FALLBACKS.items() if way in ways]
    return ", ".join(counts).replace(" by", f" of {method.num_clips} clips by", 1)


def legend(methods: Iterable[Method]) -> str:
    """Return what the names of pose sources, renderers and predictors in labels stand for."""
    meanings = {
        getattr(method, role, method.name): outline(spec)
        for method in methods
        for role, spec in method.components.items()
    }
    return "; ".join(f"{name} = {text}" for name, text in meanings.items() if name != text)


def outline(spec: Mapping[str, Any]) -> str:
    """Return the name of a component, with those of nested components in brackets."""
    tables = (value for value in spec.values() if isinstance(value, dict))
    inner = [outline(table) for table in tables if "name" in table]
    return f"{spec['name']} ({', '.join(inner)})" if inner else str(spec["name"])


def marks(method: Method) -> str:
    """Return the letters next to the name of a method."""
    return "".join(MARKS[name][0] for name in method.privileged_inputs)
