"""A file or folder appears when it is complete; an error leaves the old one and no scratch."""

from pathlib import Path

import pytest

from geovp_classic.data.atomic import atomic_write, write_bytes


def test_a_file_replaces_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "new" / "file.txt"
    for content in (b"first", b"second"):
        write_bytes(path, content)
        assert path.read_bytes() == content
    assert list(path.parent.iterdir()) == [path]


def test_an_error_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "file.txt"
    path.write_bytes(b"whole")

    def write() -> None:
        with atomic_write(path) as scratch:
            scratch.write_bytes(b"half")
            raise OSError("full")

    with pytest.raises(OSError, match="full"):
        write()
    assert path.read_bytes() == b"whole"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_replaces_an_empty_one(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    with atomic_write(folder) as scratch:
        scratch.mkdir()
        (scratch / "a").write_text("a")
        assert not (folder / "a").exists()
    assert [path.name for path in folder.iterdir()] == ["a"]
    assert list(tmp_path.iterdir()) == [folder]


def test_an_incomplete_folder_is_removed(tmp_path: Path) -> None:
    def write() -> None:
        with atomic_write(tmp_path / "folder") as scratch:
            scratch.mkdir()
            (scratch / "a").write_text("a")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write()
    assert not any(tmp_path.iterdir())
