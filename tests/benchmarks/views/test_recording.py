"""A Rerun recording holds what was kept of a clip, in one world and on one time line."""

import importlib.util
import shutil
import sys
from pathlib import Path

import pytest

from geovp_benchmarks import cli
from geovp_benchmarks.results.store import Results
from geovp_classic import registry
from tests.benchmarks.conftest import Says
from tests.benchmarks.views.conftest import FUTURE, KEPT, PAST, fill

needs_rerun = pytest.mark.skipif(
    importlib.util.find_spec("rerun") is None,
    reason="rerun is not installed (the extra viz): nothing was recorded",
)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    return Results(fill(tmp_path_factory.mktemp("recording") / "r"))


@pytest.fixture(scope="module")
def chunks(results: Results) -> dict[str, int]:
    """The rows of each entity that is not the same all the time, 0 for the others, read back from
    the file.
    """
    from rerun.chunk import RrdReader

    assert cli.main(["view", str(results.root), KEPT]) == 0
    found: dict[str, int] = {}
    for chunk in RrdReader(results.recording(KEPT)).stream().to_chunks():
        found[chunk.entity_path] = found.get(chunk.entity_path, 0) + (
            0 if chunk.is_static else chunk.num_rows
        )
    return found


@needs_rerun
class TestFile:
    def test_images_and_paths_are_in_it(self, chunks: dict[str, int]) -> None:
        assert {"/world/truth", r"/world/gt\ \+\ far"} <= chunks.keys()
        assert chunks["/observed"] == PAST + FUTURE
        assert chunks[r"/predicted/gt\ \+\ far"] == chunks["/predicted/copy-last"] == FUTURE
        assert "/world/copy-last" not in chunks  # it has no poses

    def test_one_row_alone(self, results: Results, tmp_path: Path) -> None:
        from rerun.chunk import RrdReader

        copied = Results(shutil.copytree(results.root, tmp_path / "r"))
        assert cli.main(["view", str(copied.root), KEPT, "--methods", "gt + far"]) == 0
        file = copied.recording(KEPT)
        paths = {chunk.entity_path for chunk in RrdReader(file).stream().to_chunks()}
        assert {path for path in paths if path.startswith("/predicted")} == {
            r"/predicted/gt\ \+\ far"
        }


def test_what_was_not_kept_is_one_sentence(results: Results, refused: Says) -> None:
    assert "only the predictions of a few clips are kept" in refused("view", results.root, "d")
    words = refused("view", results.root, KEPT, "--methods", "copy-lst")
    assert "did you mean 'copy-last'" in words


def test_without_rerun_it_says_what_to_install(
    results: Results, monkeypatch: pytest.MonkeyPatch, refused: Says
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    said = refused("view", results.root, KEPT)
    assert f"which is not installed: {registry.install_command('viz')}" in said
