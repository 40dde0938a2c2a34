"""A Rerun recording holds what was kept of a clip, in one world and on one time line."""

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geovp_benchmarks import cli
from geovp_benchmarks.plots.recording import KeptClip
from geovp_benchmarks.results.store import Results
from geovp_classic import registry
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import Motion, Trajectory
from tests.benchmarks.conftest import Says
from tests.benchmarks.views.conftest import FUTURE, KEPT, PAST, fill, straight

needs_rerun = pytest.mark.skipif(
    importlib.util.find_spec("rerun") is None,
    reason="rerun is not installed (the extra viz): nothing was recorded",
)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    """The small results folder, with depths: everything is 5 m away."""
    results = Results(fill(tmp_path_factory.mktemp("recording") / "r"))
    clip = results.clip(KEPT)
    results.write_clip(replace(clip, depths=np.full(clip.frames.shape[:3], 5.0, np.float32)))
    return results


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
    def test_frames_cloud_and_paths_are_in_it(self, chunks: dict[str, int]) -> None:
        assert {"/world/cloud", "/world/truth/past", "/world/truth/future"} <= chunks.keys()
        assert chunks["/seen"] == chunks["/world/truth/camera"] == PAST + FUTURE
        assert (
            chunks[r"/predicted/gt\ \+\ far"] == chunks[r"/world/rows/gt\ \+\ far/camera"] == FUTURE
        )
        assert chunks["/predicted/copy-last"] == FUTURE
        assert not any(
            path.startswith("/world/rows/copy-last") for path in chunks
        )  # it knows no camera

    def test_samples_are_a_fan(self, chunks: dict[str, int]) -> None:
        assert r"/world/rows/kalman\ \+\ far/fan" in chunks
        assert r"/world/rows/gt\ \+\ far/fan" not in chunks

    def test_one_row_alone(self, results: Results, tmp_path: Path) -> None:
        from rerun.chunk import RrdReader

        path = tmp_path / "one.rrd"
        assert (
            cli.main(["view", str(results.root), KEPT, "--method", "gt + far", "--out", str(path)])
            == 0
        )
        paths = {chunk.entity_path for chunk in RrdReader(path).stream().to_chunks()}
        assert {path for path in paths if path.startswith("/predicted")} == {
            r"/predicted/gt\ \+\ far"
        }


def test_the_cloud_is_where_the_depth_says(results: Results) -> None:
    """Three cameras 1 m apart look along z, everything 5 m ahead: z is 5, 6 and 7; every other
    pixel both ways.
    """
    points, colours = KeptClip.read(results, KEPT).cloud()
    assert points.shape == colours.shape == (PAST * 8 * 8, 3)
    np.testing.assert_allclose(
        points[:, 2].reshape(PAST, -1), np.array([[5.0], [6.0], [7.0]]).repeat(64, axis=1)
    )
    # The corner pixel (0, 0) of a camera with f = 16 and c = 7.5: x = y = -7.5 / 16 * 5 m.
    np.testing.assert_allclose(points[0, :2], -7.5 / 16 * 5)


def test_another_world_and_unit_are_brought_into_the_true_one(results: Results) -> None:
    """A path that turned by 90 degrees and is half as long: its future is the true one from the
    last camera on.
    """
    kept = KeptClip.read(results, KEPT)
    other = se3.compose(np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]), np.array([5.0, 0, 0]))
    poses = other @ straight(0.5, PAST + FUTURE).world_from_cam
    motion = Motion(
        Trajectory(poses[:PAST], 0.1 * np.arange(PAST), is_metric=False),
        poses[None, PAST:],
        np.ones(PAST, bool),
    )
    past, futures = kept.placed(motion)
    np.testing.assert_allclose(past, straight(1.0, PAST).world_from_cam, atol=1e-12)
    np.testing.assert_allclose(
        futures[0], straight(1.0, PAST + FUTURE).world_from_cam[PAST:], atol=1e-12
    )


def test_what_was_not_kept_is_one_sentence(results: Results) -> None:
    with pytest.raises(BadData, match="no clip 'd' is kept in"):
        KeptClip.read(results, "d")
    with pytest.raises(BadData, match="no method 'copy-lst' is kept: did you mean 'copy-last'"):
        KeptClip.read(results, KEPT, ["copy-lst"])


def test_without_rerun_it_says_what_to_install(
    results: Results, monkeypatch: pytest.MonkeyPatch, refused: Says
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    said = refused("view", results.root, KEPT)
    assert f"which is not installed: {registry.install_command('viz')}" in said
