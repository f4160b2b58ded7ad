"""Bags as other writers, and people who rename files, leave them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hydro_ident.bag.reader import read_bag
from hydro_ident.errors import BagError


def _tell(bag: Path, **changed: object) -> None:
    """Change what metadata.yaml says."""
    file = bag / "metadata.yaml"
    data = yaml.safe_load(file.read_text())
    data["rosbag2_bagfile_information"].update(changed)
    file.write_text(yaml.safe_dump(data))


@pytest.mark.parametrize("mode", ["NONE", "none", "None", "", None])
def test_files_that_are_not_compressed_are_read_whatever_that_is_called(
    write_bag: Any, run_columns: Any, mode: str | None
) -> None:
    path = write_bag(run_columns(20))
    _tell(path, compression_mode=mode)
    bag = read_bag(path)
    assert (bag.count, bag.losses) == (120, ())


@pytest.mark.parametrize("mode", ["FILE", "MESSAGE"])
def test_compressed_files_are_refused(write_bag: Any, run_columns: Any, mode: str) -> None:
    path = write_bag(run_columns(20))
    _tell(path, compression_mode=mode, compression_format="zstd")
    with pytest.raises(BagError, match=f"found whole {mode}s compressed by rosbag2"):
        read_bag(path)


def test_a_file_that_was_renamed_is_read_and_said(write_bag: Any, run_columns: Any) -> None:
    path = write_bag(run_columns(20))
    (file,) = path.glob("*.mcap")
    file.rename(path / "mine.mcap")
    bag = read_bag(path)
    assert bag.count == 120
    assert bag.losses == (
        f"{file.name}: named by metadata.yaml, not there",
        "mine.mcap: not named by metadata.yaml, taken, as no file that it names is there",
    )


def test_split_files_that_were_renamed_are_read_in_their_order(
    write_bag: Any, run_columns: Any
) -> None:
    columns = run_columns(600)
    path = write_bag(columns, split_ns=100_000_000)
    files = list(path.glob("*.mcap"))
    assert len(files) == 12
    for file in files:
        file.rename(path / file.name.replace(path.name, "mine"))
    q = columns["/joint_states"][1]["position"]
    np.testing.assert_array_equal(read_bag(path).series["/joint_states"].fields["position"], q)
