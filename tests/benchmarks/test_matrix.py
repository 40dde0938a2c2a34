"""What a matrix file says, and what it is told when it says it wrongly."""

import re
from pathlib import Path
from typing import Any

import pytest

from geovp_benchmarks.matrix import CONFIGS, files, schema
from geovp_classic import registry
from geovp_classic.errors import BadData, GeovpError
from geovp_classic.types import PrivilegedInput

PROTOCOL = {
    "dataset": {"name": "synthetic"},
    "num_past": 3,
    "num_future": 2,
    "size_px": [32, 32],
    "stride": 5,
}


def content(**tables: Any) -> dict[str, Any]:
    return {"protocol": dict(PROTOCOL), "predictors": {"copy": {"name": "copy-last"}}, **tables}


def test_every_pose_source_meets_every_renderer_in_the_order_of_the_file() -> None:
    sources = {"b": {"name": "ground-truth"}, "a": "stand-still"}
    renderers = {"r": {"name": "ground-far-plane"}, "q": {"name": "depth-fusion"}}
    methods = schema.parse("m", content(pose_sources=sources, renderers=renderers)).methods
    assert [method.name for method in methods] == ["b--r", "b--q", "a--r", "a--q", "copy"]
    assert methods[0].label == "b + r"
    assert [method.renderer for method in methods] == ["r", "q", "r", "q", None]


def test_samples_are_the_protocols_unless_an_entry_says_otherwise() -> None:
    protocol = {**PROTOCOL, "num_samples": 5}
    predictors = {"few": {"name": "copy-last"}, "many": {"name": "copy-last", "num_samples": 100}}
    parsed = schema.parse("m", content(protocol=protocol, predictors=predictors))
    assert [method.num_samples for method in parsed.methods] == [5, 100]
    assert parsed.predictors["many"].spec == {"name": "copy-last"}


def test_metrics_are_a_list_or_a_table_of_columns() -> None:
    assert list(schema.parse("m", content()).metrics["frame"]) == ["psnr", "ssim", "lpips"]
    parsed = schema.parse(
        "m", content(metrics={"frame": ["psnr", {"name": "lpips", "net": "squeeze"}]})
    )
    assert parsed.metrics["frame"] == {
        "psnr": {"name": "psnr"},
        "lpips": {"name": "lpips", "net": "squeeze"},
    }


def test_a_root_is_replaced_or_read_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    protocol = {**PROTOCOL, "dataset": {"name": "kitti", "root": "$STREETS/odometry"}}
    parsed = schema.parse("m", content(protocol=protocol))
    moved = r"/data, does not exist: give the place of the data as --root FOLDER"
    with pytest.raises(GeovpError, match=moved):
        parsed.override(root=Path("/data")).build_dataset(PrivilegedInput.NONE)
    monkeypatch.setenv("STREETS", "/streets")
    with pytest.raises(GeovpError, match="/streets/odometry"):
        parsed.build_dataset(PrivilegedInput.NONE)
    monkeypatch.delenv("STREETS")
    with pytest.raises(GeovpError, match=r"\$STREETS.* is not set: set it, or give --root FOLDER"):
        parsed.build_dataset(PrivilegedInput.NONE)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (
            content(predictor={}),
            "the matrix file has an unknown key 'predictor': did you mean 'predictors'",
        ),
        (
            content(protocol={**PROTOCOL, "dataset": {"name": "kitti", "stride": 2}}),
            "which the harness sets",
        ),
        (content(metrics={"frame": "psnr"}), "expected a list such as"),
        (content(metrics={"frame": {"../a|b": "psnr"}}), "expected a name"),
        (content(predictors={}), "no complete method"),
        (content(predictors={"a/b": "copy-last"}), r"predictors\.a/b is .* expected a name"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(wrong: dict[str, Any], says: str) -> None:
    with pytest.raises(GeovpError, match=says) as caught:
        schema.parse("m", wrong)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_our_own_files_can_be_read(path: Path) -> None:
    assert schema.read(path).methods


def test_the_variants_of_the_ablation_differ() -> None:
    matrix = schema.read(CONFIGS / "ablation.toml")
    built = {
        repr(registry.build("predictors", matrix.predictor_spec(method.label)))
        for method in matrix.methods
    }
    assert len(built) == len(matrix.methods) == 11


@pytest.mark.parametrize(
    ("key", "given", "expected"),
    [
        ("root", "data", "file/data"),
        ("root", "other", "here/other"),  # which only the working directory has
        ("root", "$DATA/x", None),
        ("root", "missing", None),
        ("cameras", "lenses.toml", "file/lenses.toml"),
        ("split", "lenses.toml", "file/lenses.toml"),
        ("split", "data", None),
    ],
)
def test_relative_paths_are_those_of_the_matrix_file(
    key: str, given: str, expected: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file" / "data").mkdir(parents=True)
    (tmp_path / "file" / "lenses.toml").write_text("")
    (tmp_path / "here" / "other").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "here")
    text = f'[protocol]\ndataset = {{ name = "videos", {key} = "{given}" }}\n'
    (tmp_path / "file" / "m.toml").write_text(text)
    _, content = files.read(Path("../file/m.toml"))
    path = content["protocol"]["dataset"][key]
    assert path == given if expected is None else Path(path).samefile(tmp_path / expected)


@pytest.mark.parametrize(
    ("setting", "expected"),
    [
        ("protocol.size_px=5", "[width, height] in pixels"),
        ("protocol.device=gpu", "cpu, cuda, cuda:N or auto"),
        ("metrics=5", "a table"),
    ],
)
def test_values_of_another_kind_are_told_in_plain_words(setting: str, expected: str) -> None:
    with pytest.raises(BadData, match=re.escape(f", expected {expected}") + "$"):
        schema.read(Path("demo"), [setting])
