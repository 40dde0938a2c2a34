"""`geovp reproduce thesis` from nothing, on two short sequences in KITTI odometry's layout."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from geovp_benchmarks import cli, plots
from geovp_benchmarks.results.store import Results
from geovp_classic.atomic import write_bytes
from geovp_classic.data.synthetic.dataset import Synthetic
from tests.benchmarks.conftest import write_kitti

pytest.importorskip(
    "torch", reason="torch is not installed: the thesis's rows need the extra 'learned'"
)
ROWS = ("svg-tiny-1", "svg-tiny-100", "gt-3d+ground-far-plane", "copy-last")


@pytest.fixture
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The two test sequences of `thesis-like-test`, one clip of 30 frames each, of two different
    streets.
    """
    folder = tmp_path_factory.mktemp("kitti")
    for seed, sequence in enumerate(("07", "10")):
        write_kitti(
            folder,
            sequence,
            Synthetic(seed=seed, num_clips=1, num_frames=30, size_px=(64, 64))[0],
        )
    return folder


@pytest.fixture
def done(root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[int, Results]:
    out = tmp_path_factory.mktemp("out")
    words = ["reproduce", "thesis", "--root", str(root), "--out", str(out), "--limit", "2"]
    words += ["--set", "protocol.dataset.split=thesis-like-test", "--samples", "2", "--keep", "0"]
    with (
        pytest.MonkeyPatch.context() as patch
    ):  # their names and places are tested here, what is in them elsewhere
        patch.delenv("GEOVP_LPIPS_WEIGHTS", raising=False)  # published networks take long
        patch.setattr(plots.Page, "write", lambda page, path: write_bytes(path, b""))
        return cli.main([*words, "--methods", *ROWS]), Results(out)


def test_the_protocol_and_the_published_block_are_the_thesiss(done: tuple[int, Results]) -> None:
    code, results = done
    assert code == 0
    shared = results.protocol()
    assert (shared["num_past"], shared["num_future"], shared["size_px"]) == (10, 20, [256, 256])
    assert shared["clips"] == ["07/000000", "10/000000"]
    assert {method.name: (method.status, method.num_samples) for method in results.methods()} == {
        "svg-tiny-1": ("done", 1),
        "svg-tiny-100": ("done", 2),
        "gt-3d+ground-far-plane": ("done", 1),
        "copy-last": ("done", 1),
    }

    ours, published = (
        (results.tables / f"{name}.md").read_text() for name in ("thesis", "thesis-published")
    )
    # A network that is not the paper's stands under its own name, not under "SVG - 1 Sample"
    names = ["svg-tiny-1", "svg-tiny-100, best of 2", "gt-3d+ground-far-plane [pfh]", "copy-last"]
    assert sorted(re.findall(r"^[|] (\w.*?) +[|] +2 [|]", ours, re.M)) == sorted(names)
    assert (
        "- 2 clips of kitti, split thesis-like-test; 10 frames observed, the next 20 predicted at "
        "256x256." in ours
    )
    assert "**" not in ours  # two clips are too few
    assert "**13.504** ± 0.070" in published
    tex = (results.tables / "thesis-published.tex").read_text()
    assert r"SRVP - 100 Samples & - & \textbf{13.504} $\pm$ 0.070" in tex
