"""Kernels are compiled where neither the installation nor the home folder can be written."""

import os
from pathlib import Path

import pytest

from geovp_classic import numba_cache


@pytest.mark.parametrize("given", [None, "/elsewhere"])
def test_a_temporary_folder_is_the_last_resort(
    given: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Below a file, no folder can be created, even by root."""
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file" / "cache"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", given or "")
    if given is None:
        monkeypatch.delenv("NUMBA_CACHE_DIR")
    numba_cache.choose_folder(tmp_path / "file")
    folder = os.environ["NUMBA_CACHE_DIR"]
    if given is not None:
        assert folder == given
    else:
        assert numba_cache.is_writable(Path(folder))
        assert not folder.startswith(str(tmp_path))


def test_numba_chooses_where_it_can_write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for package in (tmp_path, tmp_path / "file"):
        numba_cache.choose_folder(package)
        assert "NUMBA_CACHE_DIR" not in os.environ
