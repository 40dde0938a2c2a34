"""Kernels are compiled where neither the installation nor the home folder can be written."""

import os
import tempfile
from pathlib import Path

import pytest

from geovp_classic import numba_cache


@pytest.mark.parametrize("given", [None, "file/given", "given"])
def test_a_temporary_folder_is_the_last_resort(
    given: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Below a file, no folder can be created, even by root; a given one may be writable or not."""
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file" / "cache"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / (given or "")))
    if given is None:
        monkeypatch.delenv("NUMBA_CACHE_DIR")
    numba_cache.choose_folder(tmp_path / "file")
    folder = os.environ["NUMBA_CACHE_DIR"]
    assert numba_cache.is_writable(Path(folder))
    assert folder.startswith(str(tmp_path)) == (given == "given")


def test_another_users_folder_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The name of the temporary folder is taken by a file, so that another one is made."""
    (tmp_path / "file").write_text("")
    (tmp_path / f"geovp-numba-{os.getuid()}").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    numba_cache.choose_folder(tmp_path / "file")
    folder = Path(os.environ["NUMBA_CACHE_DIR"])
    assert folder.parent == tmp_path
    assert folder.is_dir()


def test_numba_chooses_where_it_can_write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for package in (tmp_path, tmp_path / "file"):
        numba_cache.choose_folder(package)
        assert "NUMBA_CACHE_DIR" not in os.environ
