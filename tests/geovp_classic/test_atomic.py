"""A file or folder appears when it is complete; an error leaves the old one and no scratch."""

import os
from pathlib import Path

import pytest

from geovp_classic.atomic import atomic_write, write_bytes
from geovp_classic.errors import BadData


def test_a_file_replaces_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "new" / "file.txt"
    for content in (b"first", b"second"):
        write_bytes(path, content)
        assert path.read_bytes() == content
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("is_folder", [False, True])
def test_an_error_leaves_the_old_state(tmp_path: Path, is_folder: bool) -> None:
    (tmp_path / "file.txt").write_bytes(b"whole")

    def write() -> None:
        with atomic_write(tmp_path / ("folder" if is_folder else "file.txt")) as scratch:
            if is_folder:
                scratch.mkdir()
            (scratch / "a" if is_folder else scratch).write_bytes(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write()
    assert list(tmp_path.iterdir()) == [tmp_path / "file.txt"]
    assert (tmp_path / "file.txt").read_bytes() == b"whole"


def test_errors_name_the_path_and_not_the_scratch(tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError) as caught:
        write_bytes(tmp_path, b"content")
    assert caught.value.filename == str(tmp_path)


def test_a_folder_replaces_an_empty_one(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    with atomic_write(folder) as scratch:
        scratch.mkdir()
        (scratch / "a").write_text("a")
        assert not (folder / "a").exists()
    assert [path.name for path in folder.iterdir()] == ["a"]
    assert list(tmp_path.iterdir()) == [folder]


def test_a_pipe_is_not_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(BadData, match="pipe is a pipe or device"):
        write_bytes(tmp_path / "pipe", b"content")
    assert (tmp_path / "pipe").is_fifo()
