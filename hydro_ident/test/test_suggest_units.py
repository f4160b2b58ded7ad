"""A unit that a name carries is read in every format; one that the file says counts more."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from hydro_ident.logs.file import read_log
from hydro_ident.logs.guess import Guess
from hydro_ident.logs.suggest import suggest
from hydro_model.arrays import FloatArray
from hydro_model.robot_files import load_robot

Columns = Mapping[str, FloatArray]
T = 0.002 * np.arange(200)
#: Degrees and bar, each with a name in the style of programs and one in that of tables.
LOG = {
    "t_ms": 1e3 * T,
    "lift_deg": 20.0 + 5.0 * np.sin(T),
    "tilt [deg]": -40.0 + 5.0 * np.sin(T),
    "lift_pressure_a_bara": 60.0 + np.sin(T),
    "supply_pressure_barg": 180.0 + np.sin(T),
}


def write_csv(file: Path, columns: Columns) -> None:
    head = ",".join(columns)
    rows = np.column_stack(list(columns.values()))
    np.savetxt(file, rows, "%.9g", delimiter=",", header=head, comments="")


def write_mat(file: Path, columns: Columns) -> None:
    """As Simulink does: signals by labels, which MATLAB's own names could not be."""
    time, *names = columns
    signals = np.zeros(len(names), dtype=[("values", object), ("label", object)])
    for k, name in enumerate(names):
        signals[k] = (columns[name], name)
    savemat(file, {time: columns[time], "rec": {"signals": signals}})


def write_parquet(file: Path, columns: Columns) -> None:
    pyarrow = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    from pyarrow import parquet

    parquet.write_table(pyarrow.table(dict(columns)), file)


FORMATS = {".csv": write_csv, ".mat": write_mat, ".parquet": write_parquet}


def guesses(file: Path) -> dict[str, Guess]:
    found = suggest(read_log(file), load_robot("xs031")).guesses
    return {g.column.removeprefix("rec.signals."): g for g in found}


@pytest.mark.parametrize(("kind", "write"), FORMATS.items())
def test_units_in_names_count_in_every_format(
    kind: str, write: Callable[[Path, Columns], None], tmp_path: Path
) -> None:
    """Of Parquet and MAT they had been told by the numbers, or said to be unknown."""
    write(tmp_path / f"log{kind}", LOG)
    found = guesses(tmp_path / f"log{kind}")
    assert found["t_ms"].entry["unit"] == "ms"
    for name, joint in (("lift_deg", "lift"), ("tilt [deg]", "tilt")):
        assert (found[name].section, found[name].name) == ("joints", joint)
        assert (found[name].entry["unit"], found[name].level) == ("deg", "sure")
    supply, chamber = found["supply_pressure_barg"], found["lift_pressure_a_bara"]
    assert (supply.name, supply.level) == ("supply", "sure")
    assert (supply.entry["unit"], supply.entry["reference"]) == ("bar", "gauge")
    assert (chamber.name, chamber.entry["reference"]) == ("lift_cylinder/a", "absolute")


def test_a_matrix_name_carries_the_unit_of_its_columns(tmp_path: Path) -> None:
    both = np.column_stack([LOG["lift_deg"], LOG["tilt [deg]"]])
    savemat(tmp_path / "log.mat", {"t_ms": LOG["t_ms"], "angle_deg": both})
    found = guesses(tmp_path / "log.mat")
    assert [found[f"angle_deg[{k}]"].name for k in (1, 2)] == ["lift", "tilt"]
    for k in (1, 2):
        assert "unit 'deg'" in found[f"angle_deg[{k}]"].why


def test_what_a_parquet_file_says_of_a_column_counts_more_than_its_name(tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    from pyarrow import parquet

    fields = [
        pyarrow.field("p_bar", pyarrow.float64(), metadata={"unit": "MPa"}),
        pyarrow.field("stamp_ms", pyarrow.timestamp("ns")),
    ]
    stamps = np.datetime64("2026-03-12", "ns") + np.arange(5) * np.timedelta64(10, "ms")
    table = pyarrow.table([np.arange(5.0), stamps], schema=pyarrow.schema(fields))
    parquet.write_table(table, tmp_path / "log.parquet")
    # Dates are seconds, whatever the name says they were once.
    assert read_log(tmp_path / "log.parquet").units == {"p_bar": "MPa", "stamp_ms": "s"}
