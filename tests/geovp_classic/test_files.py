"""Checked reading of files, and texts that reach HTML, LaTeX and file names."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geovp_classic import files
from geovp_classic.data.formats import pose_files
from geovp_classic.data.frames import image_frames
from geovp_classic.errors import BadData


@pytest.mark.parametrize("name", ["pipe", ".", "large", "missing", "n" * 300, "a\0b"])
def test_only_regular_files_below_the_limit_are_read(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "large").write_bytes(bytes(3 * files.MIB))
    with pytest.raises(BadData):
        files.read_bytes(tmp_path / name, 2 * files.MIB)


def test_an_image_of_too_many_pixels_is_refused_before_it_is_decoded(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "wide.png"), np.zeros((1, 2**16), np.uint8))
    assert image_frames.read_image(tmp_path / "wide.png").shape == (1, 2**16, 3)
    content = bytearray((tmp_path / "wide.png").read_bytes())
    content[20:24] = (2**16).to_bytes(4, "big")  # the height in IHDR
    (tmp_path / "tall.png").write_bytes(content)
    with pytest.raises(BadData):
        image_frames.read_image(tmp_path / "tall.png")


def test_a_byte_order_mark_is_skipped(tmp_path: Path) -> None:
    (tmp_path / "times.txt").write_bytes(b"\xef\xbb\xbf0.0\n0.1\n")
    assert pose_files.read_times(tmp_path / "times.txt").tolist() == [0.0, 0.1]


@pytest.mark.parametrize("content", [b"", b"[1]", b'{"a": ', b"\xff", b"[" * 100_000])
def test_a_damaged_record_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "record.json"
    path.write_bytes(files.json_bytes({"name": "ü", "count": 3}))
    assert files.read_json(path) == {"name": "ü", "count": 3}
    path.write_bytes(content)
    with pytest.raises(BadData, match=r"record\.json"):
        files.read_json(path)


def test_a_record_holds_utf8_only() -> None:
    with pytest.raises(BadData, match="is not text in UTF-8"):
        files.json_bytes({"root": os.fsdecode(b"path/to/kitti\xff")})


def test_python_notation_is_not_a_number_in_a_pose_file(tmp_path: Path) -> None:
    for word in ("1_0", "\uff11\uff10", "0x10", "1e999", "nan", "9" * 400):
        (tmp_path / "times.txt").write_text(word)
        with pytest.raises(BadData, match="line 1"):
            pose_files.read_times(tmp_path / "times.txt")
    (tmp_path / "times.txt").write_text("-.5\n1.\n2E+0\n7\n")
    assert pose_files.read_times(tmp_path / "times.txt").tolist() == [-0.5, 1.0, 2.0, 7.0]


@given(st.text(max_size=40), st.sampled_from(["", "/", "../", "a/../../"]))
def test_names_from_data_stay_inside_their_folder(name: str, before: str) -> None:
    if files.leads_inside(before + name):
        assert Path("/root/folder") in (Path("/root/folder") / before / name / "x").parents
        assert ".." not in Path(before + name).parts
    else:
        assert before or ".." in name or "\0" in name or name.startswith("/")
