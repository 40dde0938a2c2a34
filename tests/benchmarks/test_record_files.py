"""Records and kept arrays that are not what a run writes are refused, with the file, the key and
what was expected.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geovp_benchmarks.results import records
from geovp_benchmarks.results.kept_files import KeptFiles
from geovp_benchmarks.results.store import Results
from geovp_classic import files
from geovp_classic.errors import BadData
from geovp_classic.types import Prediction
from tests.benchmarks.made import write_protocol

METHOD = {
    "label": "x",
    "status": "done",
    "privileged_inputs": ["PAST_POSES"],
    "num_samples": 1,
}
METHOD |= {"fingerprint": "f", "components": {}}
FRAMES = np.zeros((1, 2, 4, 5, 3), np.uint8)
POSES = np.tile(np.eye(4), (3, 1, 1))
MOTION = {
    "past.world_from_cam": POSES,
    "past.times_s": np.arange(3.0),
    "futures": POSES[None, :2],
    "tracked": np.ones(3, bool),
    "past.is_metric": np.array(True),
}
MOTION = {f"motion.{name}": array for name, array in MOTION.items()}


def method(folder: Path, **changed: Any) -> dict[str, Any]:
    (folder / "method.json").write_bytes(files.json_bytes(METHOD | changed))
    method: records.Method = records.read(folder / "method.json", records.Method, name="x")
    return method.model_dump()


@pytest.mark.parametrize("name", ["../up", "/root", "a\nb"])
def test_names_that_lead_elsewhere_are_refused(name: str, tmp_path: Path) -> None:
    results = Results(tmp_path)
    write_protocol(results, ["x", name], [])
    with pytest.raises(BadData, match=r"protocol\.json: methods.1 is .* should match"):
        results.protocol()


@pytest.mark.parametrize("text", ["{", "[]", "{}"])
def test_a_damaged_protocol_is_named_once(text: str, tmp_path: Path) -> None:
    (tmp_path / "protocol.json").write_text(text)
    with pytest.raises(BadData) as caught:
        Results(tmp_path).protocol()
    assert str(caught.value).count("protocol.json") == 1
    assert "add it" not in str(caught.value)


@pytest.mark.parametrize(
    "changed",
    [
        {"num_samples": 1.5},
        {"privileged_inputs": ["PAST_POSES", 1]},
        {"reason": [7] * 90},
    ],
)
def test_a_value_of_another_kind_is_refused_with_its_key(
    changed: dict[str, Any], tmp_path: Path
) -> None:
    assert METHOD.items() <= method(tmp_path, unknown=[1]).items()
    with pytest.raises(BadData, match=rf"method\.json: {next(iter(changed))}.* is .* expected"):
        method(tmp_path, **changed)


@pytest.mark.parametrize(
    "changed",
    [
        {"frames": FRAMES.astype(float)},
        {"motion.past.world_from_cam": np.full((3, 4, 4), np.nan)},
        {"colour": np.zeros(1)},
        *({name: None} for name in MOTION),
    ],
)
def test_other_arrays_of_a_prediction_are_refused(changed: dict[str, Any], tmp_path: Path) -> None:
    arrays = {"frames": FRAMES} | MOTION | changed
    stored = {name: array for name, array in arrays.items() if array is not None}
    np.savez(tmp_path / "a..npz", **stored)
    with pytest.raises(BadData, match=r"a\.\.npz holds another .*remove it"):
        KeptFiles(tmp_path, "", Prediction).read("a")
