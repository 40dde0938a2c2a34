"""The toy components, registered for the time of a test, and a street in KITTI's layout."""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from kitti_files import write_kitti

import studies
from geovp_benchmarks import cli, plots
from geovp_benchmarks.running import task
from geovp_classic import registry
from geovp_classic.atomic import write_bytes
from geovp_classic.data.synthetic.dataset import Synthetic

TOYS = Path(__file__).parent / "toys"


@pytest.fixture(autouse=True)
def _any_width(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables of any width: pytest-xdist sets COLUMNS."""
    monkeypatch.delenv("COLUMNS", raising=False)


@dataclass(frozen=True)
class Ended:
    """The exit code of a command line, and what it said."""

    code: int
    out: str
    err: str


Command = Callable[..., Ended]  # of words
Says = Callable[..., str]


@pytest.fixture
def command(capsys: pytest.CaptureFixture[str]) -> Command:
    """Return a function that runs a command line, or a study, in this process."""

    def run(*words: object) -> Ended:
        capsys.readouterr()
        name, *args = map(str, words)
        if name in ("run", "reproduce", "score") and "--workers" not in args:
            args += ["--workers", "0"]  # in this process, which has the toys
        code = studies.main(args) if name == "study" else cli.main([name, *args])
        return Ended(code, *capsys.readouterr())

    return run


@pytest.fixture
def printed(command: Command) -> Says:
    """A function that runs a command line that does all that it is asked for, and gives what it
    prints.
    """

    def run(*words: object) -> str:
        ended = command(*words)
        assert ended.code == 0, ended.err
        return ended.out

    return run


@pytest.fixture
def refused(command: Command) -> Says:
    """A function that runs a command line that is bad input, and gives the one sentence that says
    so.
    """

    def run(*words: object) -> str:
        ended = command(*words)
        assert ended.code == 2
        assert "Traceback" not in ended.err
        [sentence] = [
            line
            for line in ended.err.replace("\r", "\n").splitlines()
            if line.startswith("geovp: ")
        ]
        return sentence

    return run


@pytest.fixture
def unrendered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are laid out and their files are empty: for tests of anything but what is in them."""
    monkeypatch.setattr(plots.Page, "write", lambda page, path: write_bytes(path, b""))


@pytest.fixture
def toys(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder that has to be on the path for the toys to be found, already on ours."""
    monkeypatch.syspath_prepend(str(TOYS))
    registry._entry_points.cache_clear()
    task.build_matrix.cache_clear()
    yield TOYS
    registry._entry_points.cache_clear()
    task.build_matrix.cache_clear()


@pytest.fixture(scope="session")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sequence 07: twelve frames of the synthetic street in KITTI's layout."""
    root = tmp_path_factory.mktemp("kitti")
    write_kitti(root, "07", Synthetic(num_clips=1, num_frames=12, size_px=(160, 160))[0])
    return root


@pytest.fixture
def lpips_weights() -> None:
    """Skip the test without the weights of LPIPS, which may not be downloadable."""
    if "GEOVP_LPIPS_WEIGHTS" not in os.environ:
        pytest.skip("GEOVP_LPIPS_WEIGHTS is not set: needs the weights of LPIPS")
