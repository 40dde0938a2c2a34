"""Where numbers come from: the id of a protocol, and weights of networks."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from typing import Any

from geovp_benchmarks.results.score_names import CONFIDENCE
from geovp_benchmarks.results.store import Method

PATHS = ("root", "path")  # settings of data sets that say where they are, not what they hold


def content_hash(value: Any) -> str:
    """Return the SHA-256 of a JSON value, independent of the order of keys."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def protocol_id(protocol: Mapping[str, Any]) -> str:
    """Return a short id of a protocol.json.

    It differs if the data set, clips, frames, sizes or definitions of metrics do.
    """
    shared = ("split_hash", "num_past", "num_future", "size_px", "stride", "clips")
    facts = {key: protocol.get(key) for key in shared}
    uncounted = (*PATHS, "with_full", "with_right")  # the folder, and views that methods need
    dataset = protocol["dataset"].items()
    facts["dataset"] = {key: value for key, value in dataset if key not in uncounted}
    of_a_metric = ("asked", "unit", "definition")
    facts["metrics"] = {
        name: {key: about[key] for key in of_a_metric if key in about}
        for name, about in protocol["metrics"].items()
        if name != CONFIDENCE  # describes what a prediction rests on, not how good it is
    }
    return content_hash(facts)[:8]


def weights_notes(methods: Iterable[Method]) -> list[str]:
    """Return a note for all weights that methods with scores use, with these methods."""
    users: dict[str, list[str]] = {}
    for method in methods:
        for note in method.about if method.num_clips else ():
            users.setdefault(note, []).append(method.label)
    return [f"{note} ({', '.join(labels)})." for note, labels in users.items()]
