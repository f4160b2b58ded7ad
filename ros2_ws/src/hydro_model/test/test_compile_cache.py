"""Compiled kernels are kept for the states of the sources that are in use."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hydro_model import compile_cache


def test_caches_in_use_outlive_those_that_are_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    base = tmp_path / "hydro_model"
    compile_cache.use_user_cache()
    mine = base / compile_cache.source_state()
    assert os.environ.pop("NUMBA_CACHE_DIR") == str(mine)
    # Made long before the others, but used again after them.
    os.utime(mine, (1.0, 1.0))
    for k in range(20):
        (base / f"other{k:02d}").mkdir()
        os.utime(base / f"other{k:02d}", (100.0 + k, 100.0 + k))
    compile_cache.use_user_cache()
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setattr(compile_cache, "source_state", lambda: "fresh")
    compile_cache.use_user_cache()
    left = {folder.name for folder in base.iterdir()}
    assert {mine.name, "fresh", "other19"} <= left
    assert "other00" not in left
    assert len(left) == 16


def test_a_folder_that_was_chosen_is_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "chosen")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    compile_cache.use_user_cache()
    assert os.environ["NUMBA_CACHE_DIR"] == "chosen"
    assert not list(tmp_path.iterdir())
