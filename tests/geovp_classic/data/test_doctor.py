"""The doctor says what is there, and finds every error in one go."""

from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from geovp_classic.data import doctor
from geovp_classic.errors import BadData

Edit = Callable[[Path, int, str], None]


def told(root: Path, **settings: bool) -> list[str]:
    """Findings as "severity file:line message"."""
    return [
        f"{finding.severity} {finding.path.relative_to(root)}:{finding.line or ''} "
        f"{finding.message}"
        for finding in doctor.examine(root, **settings).findings
    ]


def test_a_sound_root_has_no_findings(kitti_root: Path) -> None:
    examination = doctor.examine(kitti_root, deep=True)
    assert examination.is_sound
    assert examination.findings == ()
    assert examination.rows[0] == {
        "sequence": "00",
        "frames": "image_2: 12, image_3: 12",
        "size_px": "64x24",
        "calibrated": "P0, P1, P2, P3",
        "times": "12",
        "duration_s": "1.1",
        "poses": "12",
        "length_m": "11",
        "errors": "0",
        "warnings": "0",
    }
    assert examination.rows[1]["frames"] == "image_0: 12"
    assert examination.usable_splits == ()


def test_progress_can_be_watched(kitti_root: Path) -> None:
    seen: list[str] = []

    def watch(names: list[str]) -> Iterator[str]:
        for name in names:
            seen.append(name)
            yield name

    doctor.examine(kitti_root, watch=watch)
    assert seen == ["00", "01"]


def test_everything_wrong_is_found_at_once(kitti_root: Path, edit: Edit) -> None:
    folder = kitti_root / "sequences" / "00"
    edit(kitti_root / "poses" / "00.txt", 2, "1 0 0 nan 0 1 0 0 0 0 1 1")
    edit(kitti_root / "poses" / "00.txt", 4, "1 0 0 0")
    edit(kitti_root / "poses" / "00.txt", 9, "1 2 3 0 0 1 0 0 0 0 1 8")
    edit(folder / "times.txt", 5, "0.3")
    edit(folder / "calib.txt", 3, "P2: 50 0 31.5")
    (folder / "image_2" / "000006.png").unlink()
    cv2.imwrite(str(folder / "image_2" / "000008.png"), np.zeros((10, 20), np.uint8))
    image = folder / "image_3" / "000002.png"
    image.write_bytes(image.read_bytes()[:50])
    assert told(kitti_root) == [
        "error sequences/00/image_2: frame 000006 is missing: frames must be numbered from "
        "000000 without a gap",
        "error sequences/00/image_2/000008.png: is 20x10 pixels, but those before are 64x24",
        "error sequences/00/image_3/000002.png: is cut short: its end is missing: restore the file",
        "error sequences/00/calib.txt:3 P2: has 3 numbers, expected 12",
        "error sequences/00: cameras have different numbers of frames: image_2 has 11, image_3 "
        "has 12",
        "error sequences/00/times.txt:5 time 0.3 is not after 0.3 of line 4",
        "error poses/00.txt:2 'nan' is not finite: every number must be known",
        "error poses/00.txt:4 4 numbers, expected 12 (KITTI) or 13 (with a frame index), the "
        "same on every line",
        "error poses/00.txt:9 not a rotation matrix: R R' is off the identity by 13",
    ]
    row = doctor.examine(kitti_root).rows[0]
    assert (row["errors"], row["poses"], row["times"]) == ("9", "9", "11")
    assert not doctor.examine(kitti_root).is_sound


def test_wrong_lengths_are_found(kitti_root: Path) -> None:
    for file in ("sequences/01/times.txt", "poses/01.txt"):
        lines = (kitti_root / file).read_text().splitlines()
        (kitti_root / file).write_text("\n".join(lines[:10]))
    assert told(kitti_root) == [
        "error sequences/01/times.txt: 10 times for 12 frames, expected one each",
        "error poses/01.txt: 10 poses for 12 frames, expected one each",
    ]


def test_missing_files_are_found(kitti_root: Path) -> None:
    folder = kitti_root / "sequences" / "01"
    (folder / "calib.txt").unlink()
    (folder / "times.txt").unlink()
    (kitti_root / "poses" / "01.txt").rename(kitti_root / "poses" / "07.txt")
    (kitti_root / "sequences" / "02").mkdir()
    found = told(kitti_root)
    assert "error sequences/01/calib.txt: does not exist" in found
    assert "error sequences/01/times.txt: does not exist" in found
    assert (
        "error sequences/02: holds no images: expected a folder image_0, image_1, image_2 or "
        "image_3" in found
    )
    assert "note poses/07.txt: there is no sequence '07' with images for these poses" in found
    assert any(line.startswith("note poses/01.txt: does not exist") for line in found)
    assert doctor.examine(kitti_root).rows[1]["poses"] == "none"


def test_what_is_unlikely_is_a_warning(kitti_root: Path, edit: Edit) -> None:
    edit(kitti_root / "poses" / "01.txt", 12, "1 0 0 0 0 1 0 0 0 0 1 20")  # 10 m in 0.1 s
    edit(kitti_root / "poses" / "01.txt", 1, "0 0 1 0 0 1 0 0 -1 0 0 0")  # 90 degrees
    edit(kitti_root / "sequences" / "01" / "times.txt", 12, "1.4")
    edit(kitti_root / "sequences" / "01" / "calib.txt", 1, "P0: 50 0 60 0 0 50 11 0 0 0 1 0")
    assert told(kitti_root) == [
        "warning sequences/01/calib.txt:1 P0 puts the principal point at 94% of the width, 46% "
        "of the height of "
        "64x24 images: were they resized or cropped without it?",
        "warning sequences/01/times.txt:12 0.400 s after the time before, 0.100 s is usual: "
        "frames are missing",
        "warning poses/01.txt:2 turned by 90 degrees from the pose before: more than a car turns",
    ]
    edit(kitti_root / "sequences" / "01" / "times.txt", 12, "1.1")
    assert "warning poses/01.txt:12 100 m/s from the pose before: more than a car drives" in told(
        kitti_root
    )
    assert doctor.examine(kitti_root).is_sound


def test_damage_inside_an_image_is_found_only_by_decoding_it(kitti_root: Path) -> None:
    image = kitti_root / "sequences" / "01" / "image_0" / "000003.png"
    content = bytearray(image.read_bytes())
    start = content.index(b"IDAT") + 4
    content[start : start + 8] = b"\xff" * 8
    image.write_bytes(bytes(content))
    assert told(kitti_root) == []
    assert told(kitti_root, deep=True) == [
        "error sequences/01/image_0/000003.png: cannot be decoded as an image, the checksum at "
        "byte 102 is wrong: "
        "restore the file"
    ]


def test_a_root_without_sequences_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadData, match="does not exist"):
        doctor.examine(tmp_path / "none")
    (tmp_path / "sequences").mkdir()
    with pytest.raises(BadData, match="holds no sequence: expected folders such as 00"):
        doctor.examine(tmp_path)
