"""Compiled kernels are kept for the states of the sources that are in use."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from hydro_model.numerics import compile_cache


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


def without_home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def nobody() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", nobody)


def with_a_file_for_a_home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder", encoding="utf-8")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))


@pytest.mark.parametrize("spoil", [without_home, with_a_file_for_a_home])
def test_without_a_home_a_run_has_a_folder_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spoil: Callable[..., None]
) -> None:
    """Beside the sources, where numba would go itself, kernels of older ones may lie."""
    ends: list[Callable[[], None]] = []
    monkeypatch.setattr(compile_cache.atexit, "register", ends.append)
    monkeypatch.setattr(compile_cache.tempfile, "tempdir", str(tmp_path))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    spoil(monkeypatch, tmp_path)
    compile_cache.use_user_cache()
    folder = os.environ.pop("NUMBA_CACHE_DIR")
    assert Path(folder).parent == tmp_path
    assert not compile_cache.is_kept(folder)
    [end] = ends
    with monkeypatch.context() as fork:
        fork.setattr(os, "getpid", lambda: -1)
        end()
    assert Path(folder).is_dir()
    end()
    assert not Path(folder).exists()


def test_a_cache_that_another_process_prunes_meanwhile_is_no_matter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    base = tmp_path / "hydro_model"
    for k in range(20):
        (base / f"other{k:02d}").mkdir(parents=True)
    listed = list(base.iterdir())

    def gone(folder: Path) -> Iterator[Path]:
        (base / "other07").rmdir()
        return iter([*listed, base / compile_cache.source_state()])

    monkeypatch.setattr(Path, "iterdir", gone)
    compile_cache.use_user_cache()
    assert os.environ.pop("NUMBA_CACHE_DIR") == str(base / compile_cache.source_state())


def test_a_folder_that_was_chosen_is_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "chosen")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    compile_cache.use_user_cache()
    assert os.environ["NUMBA_CACHE_DIR"] == "chosen"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("package", ["hydro_model", "hydro_control", "hydro_hw_bridge"])
def test_a_change_of_any_file_that_kernels_are_made_of_makes_another_state(package: str) -> None:
    """Indices and limits that kernels were compiled with stand in other files than they do."""
    spec = importlib.util.find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        pytest.skip(f"{package} is not installed here")
    file = Path(next(iter(spec.submodule_search_locations))) / "__init__.py"
    status, before = file.stat(), compile_cache.source_state()
    try:
        os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns + 1_000_000_000))
        assert compile_cache.source_state() != before
    finally:
        os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert compile_cache.source_state() == before
