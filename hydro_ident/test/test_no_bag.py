"""What is no bag and no log is refused with the way to one."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest
from scipy.io import savemat

from hydro_ident.bag.reader import read_bag
from hydro_ident.commands import convert, diagnose, identify, inspect, tracking
from hydro_ident.errors import BagError
from hydro_ident.logs.file import read_log
from hydro_model.command_line.command import run_command

#: Commands that take a bag, and what else they want.
COMMANDS = {
    "inspect": (inspect.main, []),
    "identify": (partial(run_command, "identify", identify.run), ["--out", "OUT"]),
    "diagnose": (partial(run_command, "diagnose", diagnose.run), ["--out", "OUT"]),
    "tracking": (tracking.main, []),
}


def a_log(folder: Path, ending: str) -> Path:
    """A log that `convert` takes, by its ending."""
    path = folder / f"run{ending}"
    if ending == ".mat":
        savemat(path, {"t": [0.0, 1.0], "q": [0.1, 0.2]})
    else:
        path.write_text("t,q\n0,0.1\n1,0.2\n", encoding="utf-8")
    return path


@pytest.mark.needs("clarabel", "plotly")
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("ending", [".csv", ".CSV", ".csv.gz", ".lvm", ".mat", ".parquet"])
def test_a_log_in_the_place_of_a_bag_is_sent_to_convert(
    command: str, ending: str, tmp_path: Path, capsys
) -> None:
    main, more = COMMANDS[command]
    log = a_log(tmp_path, ending)
    words = [word.replace("OUT", str(tmp_path / "out")) for word in more]
    assert main([str(log), "--robot", "xs031", *words]) == 2
    told = capsys.readouterr().err
    assert "expected an MCAP file, found bytes" in told
    assert told.count("\n") == 1
    assert f"'convert {log} --suggest MAP.yaml'" in told
    assert f"'convert {log} --map MAP.yaml --out BAG'" in told


def test_the_player_sends_a_log_to_convert_too(tmp_path: Path, capsys) -> None:
    pytest.importorskip("rclpy")
    from hydro_ident.bag.player import main

    assert main([str(a_log(tmp_path, ".csv"))]) == 2
    assert "--suggest MAP.yaml' writes a mapping" in capsys.readouterr().err


def test_both_commands_that_are_named_are_commands(tmp_path: Path) -> None:
    """As the message has them: a mapping is written, and taken again."""
    log, mapping = a_log(tmp_path, ".csv"), tmp_path / "MAP.yaml"
    assert convert.run([str(log), "--suggest", str(mapping)]) == 0
    mapping.write_text(mapping.read_text().replace("FILL_IN", "rad"))
    assert convert.run([str(log), "--map", str(mapping), "--out", str(tmp_path / "BAG")]) == 0
    assert read_bag(tmp_path / "BAG").count > 0


@pytest.mark.parametrize(
    ("name", "way"),
    [
        (
            "passwd",
            "; give a folder of rosbag2 or its .mcap file, or make one of a log with convert",
        ),
        ("run.mcap", "; its first bytes are gone: copy it once more from where it was recorded"),
    ],
)
def test_what_is_no_bag_says_what_to_give(name: str, way: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"root:x:0")
    with pytest.raises(BagError, match="found bytes 72 6f 6f 74 3a 78 3a 30") as refused:
        read_bag(tmp_path / name)
    assert str(refused.value).endswith(way)


def test_a_folder_of_logs_names_one_of_them(tmp_path: Path) -> None:
    log = a_log(tmp_path, ".csv")
    with pytest.raises(BagError, match=r"with \.mcap files, found none.*convert") as refused:
        read_bag(tmp_path)
    assert str(log) in str(refused.value)


@pytest.mark.parametrize(
    ("name", "way"),
    [
        ("run.mf4", "an ASAM measurement file: export it as CSV or MAT"),
        ("run.MDF", "an ASAM measurement file: export it as CSV or MAT"),
        ("run.tdms", "a measurement file of LabVIEW: export it as .lvm or CSV"),
        ("run.xlsx", "a workbook: save its sheet as CSV"),
        ("run.h5", "an HDF5 file: write its signals as CSV, MAT"),
        ("run.blf", "frames of a bus: export the signals decoded from them as CSV or MAT"),
        ("run.mat.gz", "unpack it"),
        ("run.zip", "unpack it"),
        ("run.strange", "export it as CSV or MAT from the program that wrote it"),
        ("run", "export it as CSV or MAT from the program that wrote it"),
    ],
)
def test_a_log_of_another_kind_says_how_it_becomes_one(
    name: str, way: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_bytes(b"\x01\x02")
    with pytest.raises(BagError, match=r"expected \.csv, .* found '") as refused:
        read_log(path)
    assert way in str(refused.value)
    if name != "run" and "strange" not in name:
        with pytest.raises(BagError, match="expected an MCAP file") as refused:
            read_bag(path)
        assert way in str(refused.value)
        assert "convert" in str(refused.value)


def test_a_bag_in_the_place_of_a_log_is_told_to_be_one(
    tmp_path: Path, write_bag, run_columns
) -> None:
    bag = write_bag(run_columns(20))
    for path in (bag, next(bag.glob("*.mcap"))):
        with pytest.raises(BagError, match="a bag already: inspect, identify and diagnose take"):
            read_log(path)


def test_a_folder_in_the_place_of_a_log_is_told_to_be_one(tmp_path: Path) -> None:
    a_log(tmp_path, ".csv")
    with pytest.raises(BagError, match="found a folder; give it a log of the folder"):
        read_log(tmp_path)


def test_a_bag_of_sqlite_names_the_program_that_rewrites_it(tmp_path: Path) -> None:
    (tmp_path / "bag_0.db3").write_bytes(b"SQLite format 3\x00")
    way = f"rosbags-convert --src {tmp_path} --dst NEW --dst-storage mcap"
    for path in (tmp_path, tmp_path / "bag_0.db3"):
        with pytest.raises(BagError, match="rosbags-convert") as refused:
            read_bag(path)
        assert way in str(refused.value)
    (tmp_path / "metadata.yaml").write_text(
        "rosbag2_bagfile_information: {storage_identifier: sqlite3}", encoding="utf-8"
    )
    with pytest.raises(BagError, match="expected MCAP storage, found 'sqlite3'") as refused:
        read_bag(tmp_path)
    assert way in str(refused.value)
