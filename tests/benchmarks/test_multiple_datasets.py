"""A matrix file with several data sets gives each its results, and one table with all of them."""

import json
from pathlib import Path
from typing import Any

import pytest

import geovp
from geovp_benchmarks.matrix import multiple_datasets
from geovp_benchmarks.results.store import Results
from geovp_classic.errors import BadData, UnknownComponent
from geovp_classic.types import Clip
from tests.benchmarks.conftest import Command, Says
from tests.benchmarks.made import intrinsics_of, rows, write_images, write_matrix

PROTOCOL = {"num_past": 3, "num_future": 2, "size_px": [32, 32], "stride": 5}
REST = {
    "pose_sources": {"gt-3d": "ground-truth"},
    "renderers": {"ground-far-plane": "ground-far-plane"},
    "predictors": {"copy-last": "copy-last"},
    "metrics": {"frame": ["psnr"], "trajectory": ["rotation-error"]},
}


@pytest.fixture(scope="module")
def street() -> Clip:
    return geovp.open_clip({"name": "synthetic", "num_frames": 10, "size_px": [32, 32]})


@pytest.fixture
def matrix_file(tmp_path: Path, street: Clip) -> Path:
    """Two clips of the synthetic street, and two of the same images without poses, in a folder."""
    write_images(tmp_path / "frames", street.frames)
    images = {
        "name": "folder",
        "path": str(tmp_path / "frames"),
        "intrinsics": intrinsics_of(street.intrinsics),
    }
    datasets = [{"name": "synthetic", "num_clips": 2}, {**images, "camera_height_m": 1.65}]
    return write_matrix(
        tmp_path / "both.toml", {"protocol": {"datasets": datasets, **PROTOCOL}, **REST}
    )


def test_each_data_set_has_its_results_and_a_row_is_skipped_where_it_cannot_be(
    matrix_file: Path, tmp_path: Path, command: Command, refused: Says
) -> None:
    out = tmp_path / "out"
    ended = command("run", matrix_file, "--out", out, "--no-report")
    assert ended.code == 1  # one row was skipped
    datasets = Results(out).by_dataset()
    assert list(datasets) == ["synthetic", "folder"]
    methods = {
        label: {method.label: method for method in each.methods()}
        for label, each in datasets.items()
    }
    row = "gt-3d + ground-far-plane"
    assert {
        label: {name: method.status for name, method in own.items()}
        for label, own in methods.items()
    } == {
        "synthetic": {row: "done", "copy-last": "done"},
        "folder": {row: "skipped", "copy-last": "done"},
    }
    again = command("table", out).out
    assert (
        again.count("## both/synthetic: whole frames")
        == again.count("## both/folder: whole frames")
        == 1
    )
    command("run", matrix_file, "--out", out, "--no-report")  # nothing is computed twice
    assert Results(out / "folder").method("copy-last") == methods["folder"]["copy-last"]
    assert f"{out} holds several data sets: give one, such as {out / 'folder'}" in refused(
        "rescore", out
    )


def test_a_file_with_one_data_set_gives_what_it_gave(
    tmp_path: Path, matrix_file: Path, command: Command
) -> None:
    """The same rows, bit by bit, whether the data set stands alone or among others; nothing lies
    elsewhere.
    """
    both = tmp_path / "both-out"
    assert command("run", matrix_file, "--out", both, "--no-report").code == 1
    protocol = {"dataset": {"name": "synthetic", "num_clips": 2}, **PROTOCOL}
    alone = write_matrix(tmp_path / "both.toml", {"protocol": protocol, **REST})
    assert command("run", alone, "--out", tmp_path / "one", "--no-report").code == 0
    one, among = Results(tmp_path / "one"), Results(both / "synthetic")
    assert one.by_dataset() == {"": one}
    assert not (one.root / "datasets.json").exists()
    for method in one.methods():
        assert rows(among.root, method.name) == rows(one.root, method.name)
    protocols = [json.loads((each.root / "protocol.json").read_text()) for each in (one, among)]
    assert protocols[0]["fingerprint"] == protocols[1]["fingerprint"]
    assert protocols[0]["name"] == "both"


def content(**protocol: Any) -> dict[str, Any]:
    return {"protocol": {**PROTOCOL, **protocol}, "predictors": {"copy": "copy-last"}}


def test_labels_are_names_or_given() -> None:
    synthetic = {"name": "synthetic", "num_clips": 1}
    found = multiple_datasets.parse(
        "m", content(datasets={"a": synthetic, "b": {**synthetic, "seed": 1}})
    )
    assert {label: one.name for label, one in found.items()} == {"a": "m/a", "b": "m/b"}
    assert found["b"].dataset == {**synthetic, "seed": 1}
    assert list(multiple_datasets.parse("m", content(datasets=[synthetic]))) == ["synthetic"]
    assert list(multiple_datasets.parse("m", content(dataset=synthetic))) == [""]


@pytest.mark.parametrize(
    ("protocol", "root", "message"),
    [
        (
            {"datasets": [{"name": "synthetic"}] * 2},
            None,
            "expected 'synthetic' once: give a table",
        ),
        (
            {"datasets": {"a/b": {"name": "synthetic"}}},
            None,
            "datasets.a/b is 'a/b', .* should match",
        ),
        ({"datasets": ["synthetic"]}, Path("/data"), "and replaces protocol.dataset and --root"),
        (
            {"datasets": {"a": {"name": "tum", "root": "/no"}}},
            None,
            "data set 'a': protocol.dataset: /no does not exist",
        ),
    ],
)
def test_wrong_files_are_told_what_is_wrong(
    protocol: dict[str, Any], root: Path | None, message: str
) -> None:
    with pytest.raises((BadData, UnknownComponent), match=message):
        multiple_datasets.parse("m", content(**protocol), root)
