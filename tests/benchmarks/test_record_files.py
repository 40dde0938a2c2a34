"""Records and kept arrays that are not what a run writes are refused, with the file, the key and
what was expected.
"""

import operator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geovp_benchmarks.results import records
from geovp_benchmarks.results.kept_files import KeptFiles
from geovp_benchmarks.results.store import Results
from geovp_classic import files
from geovp_classic.errors import BadData
from geovp_classic.types import Clip, Prediction
from tests.benchmarks.made import write_protocol

METHOD = {
    "label": "x",
    "kind": "predictor",
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
CAMERA = zip(("fx_px", "fy_px", "cx_px", "cy_px"), (4.0, 4.0, 2.0, 1.5), strict=True)
CLIP = {"name": np.array("a"), "frames": FRAMES[0], "times_s": np.arange(2.0)}
CLIP |= {f"intrinsics.{name}": np.array(value) for name, value in CAMERA}
CLIP |= {"intrinsics.width_px": np.array(5), "intrinsics.height_px": np.array(4)}
ROAD = {"trajectory.world_from_cam": POSES[:2], "trajectory.times_s": np.arange(2.0)}
ROAD |= {"trajectory.is_metric": np.array(False)}


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


def kept(folder: Path, arrays: dict[str, Any], is_clip: bool = False) -> Clip | Prediction:
    np.savez(folder / "a..npz", **arrays)
    return KeptFiles(folder, "", Clip if is_clip else Prediction).read("a")


@pytest.mark.parametrize(
    ("more", "is_clip"),
    [
        ({}, False),
        (
            MOTION
            | {"covered": FRAMES[..., 0] == 0, "motion.past.scale_uncertainty": np.array(0.5)},
            False,
        ),
        (
            MOTION | {"motion.past.times_s": np.arange(3)},
            False,
        ),  # whole numbers of seconds are times, too
        ({}, True),
        ({"depths": np.full((2, 4, 5), np.inf, np.float32), "camera_height_m": np.array(2)}, True),
        (ROAD, True),
    ],
)
def test_what_a_run_keeps_is_read(more: dict[str, Any], is_clip: bool, tmp_path: Path) -> None:
    arrays = (CLIP if is_clip else {"frames": FRAMES}) | more
    back = kept(tmp_path, arrays, is_clip)
    for name, array in arrays.items():
        np.testing.assert_array_equal(operator.attrgetter(name)(back), array)


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
    with pytest.raises(BadData, match=r"a\.\.npz holds another .*remove it"):
        kept(tmp_path, {name: array for name, array in arrays.items() if array is not None})


@pytest.mark.parametrize(
    "changed",
    [
        {"intrinsics.fx_px": None},
        {"intrinsics.depth_px": np.array(7)},
        {"trajectory.world_from_cam": POSES[:2]},
        {"times_s": None},
        dict.fromkeys(CLIP),
    ],
)
def test_other_arrays_of_a_clip_are_refused(changed: dict[str, Any], tmp_path: Path) -> None:
    given = {name: array for name, array in {**CLIP, **changed}.items() if array is not None}
    with pytest.raises(BadData, match=r"a\.\.npz holds another .*remove it"):
        kept(tmp_path, given, is_clip=True)
