"""What a user gets wrong is told in one sentence with exit code 2, never in a traceback."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from geovp_classic.types import Clip, Intrinsics, Trajectory
from tests.benchmarks.conftest import Command, Says, write_kitti
from tests.benchmarks.made import write_matrix

FRAMES = 8
PROTOCOL = {"num_past": 3, "num_future": 2, "size_px": [32, 32], "stride": 3}
REST = {"predictors": {"copy-last": {"name": "copy-last"}}, "metrics": {"frame": ["psnr"]}}


@pytest.fixture
def street(tmp_path: Path) -> Path:
    """A matrix file beside a tiny KITTI folder with which everything goes well."""
    root, times_s = tmp_path / "kitti", np.arange(FRAMES) / 10
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, 2, 3] = np.arange(FRAMES)
    noise = np.random.default_rng(0).integers(0, 256, (FRAMES, 40, 60, 3), dtype=np.uint8)
    camera = Intrinsics(50.0, 50.0, 29.5, 19.5, 60, 40)
    write_kitti(
        root,
        "00",
        Clip("noise", noise, times_s, camera, Trajectory(poses, times_s, is_metric=True)),
    )
    protocol = {"dataset": {"name": "kitti", "root": str(root)}, **PROTOCOL}
    return write_matrix(tmp_path / "street.toml", {"protocol": protocol, **REST})


def pose(number: float, first: float | str = 1) -> str:
    return f"{first} 0 0 0 0 1 0 0 0 0 1 {number}\n"


def run(street: Path) -> tuple[str | Path, ...]:
    return "run", street, "--out", street.parent / "out", "--no-report"


def replaced(old: str, new: str) -> Callable[[Path], None]:
    def damage(street: Path) -> None:
        content = street.read_text()
        assert old in content
        street.write_text(content.replace(old, new))

    return damage


def poses(*lines: str) -> Callable[[Path], None]:
    def damage(street: Path) -> None:
        (street.parent / "kitti/poses/00.txt").write_text("".join(lines))

    return damage


def truncated(street: Path) -> None:
    image = street.parent / "kitti/sequences/00/image_0/000004.png"
    image.write_bytes(image.read_bytes()[:200])


def emptied(street: Path) -> None:
    (street.parent / "kitti/sequences").rename(street.parent / "elsewhere")


def without_calibration(street: Path) -> None:
    (street.parent / "kitti/sequences/00/calib.txt").unlink()


GOOD = [pose(number) for number in range(FRAMES)]


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (replaced("/kitti", "/nowhere"), "nowhere"),
        (emptied, "sequences"),
        (without_calibration, "calib.txt"),
        (poses(*GOOD[:-1]), "00.txt"),
        (poses(*GOOD[:2], pose(2, "nan"), *GOOD[3:]), "line 3"),
        (poses(*GOOD[:2], pose(2, "one"), *GOOD[3:]), "line 3"),
        (replaced('"copy-last" }', '"copy-lst" }'), "did you mean 'copy-last'?"),
        (replaced('root = "', 'rot = 1, root = "'), "no field 'rot': did you mean 'root'?"),
        (replaced("[32, 32]", "[32, 16]"), "expected a square"),
        (replaced("num_past = 3", "num_past = 300"), "one clip needs 302"),
        (replaced('root = "', 'sequences = ["07"], root = "'), "07"),
        (replaced("[protocol]", "[protocol"), "not TOML"),
        (Path.unlink, "does not exist: give a matrix file"),
    ],
)
def test_damage_is_told_in_one_sentence(
    street: Path, refused: Says, damage: Callable[[Path], None], says: str
) -> None:
    damage(street)
    assert says in refused(*run(street))


def test_a_damaged_frame_fails_its_clips_alone(street: Path, command: Command) -> None:
    truncated(street)
    ended = command(*run(street))
    assert ended.code == 1
    assert "000004.png" in ended.out
    assert "Traceback" not in ended.err


def test_missing_poses_are_no_mistake_but_a_skipped_method(street: Path, command: Command) -> None:
    (street.parent / "kitti/poses/00.txt").unlink()
    assert command(*run(street)).code == 0
    tables = '\n[pose_sources]\ntrue = { name = "ground-truth" }\n[renderers]\nflat = { name = "ground-far-plane" }\n'
    street.write_text(street.read_text() + tables)
    ended = command(*run(street))
    assert ended.code == 1
    assert "- true + flat: skipped" in ended.out


def test_the_doctor_lists_what_is_wrong(
    street: Path, tmp_path_factory: pytest.TempPathFactory, command: Command, refused: Says
) -> None:
    root = street.parent / "kitti"
    assert "image_0: 8" in command("doctor", root).out
    truncated(street)
    found = command("doctor", root)
    assert found.code == 1
    assert "error: " in found.out
    assert refused("doctor", tmp_path_factory.mktemp("nothing"))
