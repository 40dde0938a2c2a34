"""Scores belong to the content of clips, not to the paths of their files."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from geovp_benchmarks.matrix import schema
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.running.executors import Serial
from geovp_benchmarks.running.plan import Plan
from geovp_benchmarks.running.run import run
from geovp_classic import registry
from geovp_classic.data.frames.image_frames import FrameFiles
from tests.benchmarks.made import values, write_images

PROTOCOL = {"num_past": 2, "num_future": 1, "size_px": [16, 16], "stride": 3}
TABLES = {
    "metrics": {"frame": ["psnr"], "trajectory": []},
    "predictors": {"copy-last": "copy-last"},
}


def plan(images: Path, out: Path) -> Plan:
    """Return the plan of three clips of a folder of nine frames."""
    dataset = {"name": "folder", "path": str(images), "intrinsics": [20.0, 20.0, 7.5, 7.5]}
    tables = {"protocol": {**PROTOCOL, "dataset": dataset}, **TABLES}
    return Plan(schema.parse("m", tables), Results(out), keep="all")


def missing(plan: Plan) -> list[str]:
    (method,) = plan.methods
    return sorted(plan.missing(method))


@pytest.fixture
def images(tmp_path: Path) -> Path:
    frames = np.random.default_rng(0).integers(0, 256, (9, 16, 16, 3), np.uint8)
    write_images(tmp_path / "a" / "drive", frames)
    return tmp_path / "a" / "drive"


def test_moved_data_is_not_recomputed(images: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    before = plan(images, out)
    run(before, Serial())
    moved = tmp_path / "b" / "drive"
    shutil.copytree(images, moved, copy_function=shutil.copyfile)  # with other times
    after = plan(moved, out)
    assert missing(after) == []
    assert after.changed == []
    assert after.protocol["id"] == before.protocol["id"]


def test_an_edited_frame_is_noticed_reported_and_recomputed(
    images: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    out = tmp_path / "out"
    run(plan(images, out), Serial())
    old = values(out, "copy-last", "psnr")
    kept = Results(out).clips().names
    frame = cv2.imread(str(images / "000005.png"))
    frame[8, 8, 0] ^= 255  # one value of the target of the second clip
    cv2.imwrite(str(images / "000005.png"), frame)
    edited = plan(images, out)
    assert missing(edited) == ["drive/000003"]
    run(edited, Serial())
    assert "1 clips changed since they were scored, such as drive/000003" in caplog.text
    new = values(out, "copy-last", "psnr")
    assert [a == b for a, b in zip(old, new, strict=True)] == [True, False, True]
    assert missing(plan(images, out)) == []
    assert Results(out).clips().names == kept
    target = Results(out).clips().read("drive/000003").frames[-1]
    np.testing.assert_array_equal(target, frame[..., ::-1])


def test_an_edited_pixel_changes_a_file_without_compression(tmp_path: Path) -> None:
    digests = set()
    for grey in (0, 1):
        image = np.zeros((64, 64), np.uint8)
        image[20, 20] = grey
        cv2.imwrite(str(tmp_path / "0.bmp"), image)
        digests.add(FrameFiles((tmp_path / "0.bmp",), ((64, 64),)).digest(0))
    assert len(digests) == 2


def test_digests_of_other_files_poses_and_times_differ(street: Path) -> None:
    def digest() -> str:
        table = {"name": "kitti", "root": str(street), "sequences": ["07"], "num_frames": 5}
        return str(registry.build("datasets", table).clip_digest(0))

    digests = [digest()]
    for name in ("poses/07.txt", "sequences/07/times.txt", "sequences/07/calib.txt"):
        path = street / name
        text = path.read_text()
        path.write_text(text.replace("0.1", "0.11") if "times" in name else text.replace("5", "6"))
        digests.append(digest())
        path.write_text(text)
    assert len(set(digests)) == 4
    assert digest() == digests[0]
