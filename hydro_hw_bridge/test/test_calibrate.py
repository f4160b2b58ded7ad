"""`calibrate` on the bus of the simulated machine."""

from __future__ import annotations

import errno
import json
import os
import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from hydro_hw_bridge.bus import claims
from hydro_hw_bridge.bus.bus_open import open_bus
from hydro_hw_bridge.bus.claims import Claim
from hydro_hw_bridge.commissioning import calibrate as command
from hydro_hw_bridge.commissioning import calibration_session
from hydro_hw_bridge.protocol.calibration import channels_hash, load_calibration
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import CommandFrame

pytestmark = pytest.mark.processes
#: How long to wait for what must come, however busy the machine is.
PATIENCE_S = 240.0
PORT = 2_000 + (os.getpid() + 1_000) % 5_000
CAN = f"udp_multicast:239.74.163.2:{PORT}"


def executable(name: str) -> str:
    from ament_index_python.packages import get_package_prefix

    return str(Path(get_package_prefix("hydro_hw_bridge")) / "lib/hydro_hw_bridge" / name)


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[subprocess.Popen[bytes]]:
    """The simulated machine with its pump off."""
    with (tmp_path / "rig.txt").open("wb") as log:
        arguments = [executable("sim_rig"), "--can", CAN, "--off", "pump"]
        process = subprocess.Popen(arguments, stdout=log, stderr=log)
    yield process
    process.terminate()
    process.wait(PATIENCE_S)


def calibrate(folder: Path, *arguments: str) -> tuple[int, str, str]:
    done = subprocess.run(
        [executable("calibrate"), "--can", CAN, "--out", str(folder), *arguments],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert "Traceback" not in done.stderr
    return done.returncode, done.stdout.strip(), done.stderr


@pytest.fixture
def within(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """`calibrate` in this process, whose ends are not its."""
    monkeypatch.setattr(command, "on_end", lambda end: None)

    def run(folder: Path, *arguments: str) -> tuple[int, str, str]:
        code = command.main(["--can", CAN, "--out", str(folder), *arguments])
        said = capfd.readouterr()
        return code, said.out.strip(), said.err

    return run


def wait_for(codec: Codec) -> None:
    """Until the machine is on the bus: it compiles its plant first."""
    with open_bus(CAN, codec.device_ids) as bus:
        assert bus.receive(PATIENCE_S) is not None


def test_the_whole_calibration_of_a_machine_with_a_valve_wired_the_other_way(
    rig: subprocess.Popen[bytes], codec: Codec, tmp_path: Path
) -> None:
    content = yaml.safe_load(codec.mapping.source.read_text(encoding="utf-8"))
    content["valves"]["tilt_valve"]["command"]["sign"] = -1
    content["joints"]["lift"]["offset"] = 0.01
    content["pressures"]["supply"]["offset"] = 50_000.0
    mapping = tmp_path / "wrong.mapping.yaml"
    mapping.write_text(yaml.safe_dump(content), encoding="utf-8")
    files = ("--mapping", str(mapping), "--dbc", str(codec.mapping.dbc))
    wait_for(codec)

    with open_bus(CAN, codec.device_ids) as bus:
        taken: dict[str, bytes] = {}
        while len(taken) < len(codec.device_ids):
            message = bus.receive(PATIENCE_S)
            frame = None if message is None else codec.receive(message)
            if frame is not None:
                taken[frame.name] = frame.data
        stands_at = codec.readings(taken).positions

    code, first, told = calibrate(
        tmp_path, *files, "--zeros", "--reference", f"lift={stands_at[0]:.6f}"
    )
    assert code == 0
    found = load_calibration(Path(first))
    # What was measured is told with its units, not only where it is kept.
    shown = re.findall(r"^  (\S+) +([-+][\d.]+) (Pa|rad)\b", told, re.M)
    units = dict.fromkeys(codec.pressure_names, "Pa") | {"lift": "rad"}
    assert {name: unit for name, _, unit in shown} == units
    told_zeros = {name: float(value) for name, value, unit in shown if unit == "Pa"}
    assert told_zeros == pytest.approx(found.pressure_zero_pa, abs=0.06)
    assert Path(first).name == f"{found.name}.calibration.yaml"
    assert set(found.pressure_zero_pa) == set(codec.pressure_names)
    assert found.pressure_zero_pa["supply"] == pytest.approx(50e3, abs=2e3)
    assert found.pressure_zero_pa["tank"] == pytest.approx(0.0, abs=2e3)
    assert found.position_offset == {"lift": pytest.approx(-0.01, abs=1e-5)}

    os.kill(rig.pid, signal.SIGUSR1)
    asked = ("--signs", "--from", first, "--json", "-")
    code, second, told = calibrate(tmp_path, *files, *asked)
    assert (code, second) == (2, "")
    assert "expected tilt=VALUE after --reference, or --from a calibration that has it" in told
    asked += ("--reference", f"tilt={stands_at[1]:.6f}")
    asked += ("--turned", "tilt_valve")
    code, second, told = calibrate(tmp_path, *files, *asked)
    assert code == 0, told
    data = json.loads(second)
    assert "valve signs: lift_valve +1, tilt_valve -1" in told.splitlines()
    both = load_calibration(Path(data["file"]))
    kept = ("pressure_zero_pa", "position_offset", "valve_sign")
    assert {key: data[key] for key in kept} == {key: getattr(both, key) for key in kept}
    wrong = Codec.load(codec.mapping.dbc, mapping, codec.robot).mapping
    assert found.channels == both.channels == channels_hash(wrong) != channels_hash(codec.mapping)
    assert both.valve_sign == {"lift_valve": 1, "tilt_valve": -1}
    assert both.pressure_zero_pa == found.pressure_zero_pa
    assert both.position_offset == found.position_offset | {"tilt": pytest.approx(0.0, abs=1e-5)}

    before = set(tmp_path.iterdir())
    code, out, told = calibrate(tmp_path, *files, "--signs", "--from", data["file"])
    assert (code, out) == (1, "")
    assert "retracted by tilt_valve: crossed hoses or swapped coils, or an encoder" in told
    assert set(tmp_path.iterdir()) == before

    code, out, told = calibrate(tmp_path, *files, "--zeros", "--wait", "0.5")
    assert (code, out) == (1, "")
    assert told.splitlines()[-1] == "calibrate: pump is on, expected it off, for 0.5 s"


def test_a_claimed_bus_is_refused(codec: Codec, tmp_path: Path) -> None:
    with open_bus(CAN, codec.bridge_ids) as bus:
        claim = Claim(bus, codec)
        arguments = [executable("calibrate"), "--can", CAN, "--out", str(tmp_path), "--zeros"]
        process = subprocess.Popen(
            arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        while process.poll() is None:
            claim.send()
            bus.receive(0.05)
        _, told = process.communicate()
    assert process.returncode == 2
    assert told.startswith(f"calibrate: another bridge (instance {claim.instance:08x})")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP], ids=["term", "hup"])
def test_signals_end_it_at_zero_volts(
    codec: Codec, tmp_path: Path, number: signal.Signals
) -> None:
    arguments = [executable("calibrate"), "--can", CAN, "--out", str(tmp_path), "--zeros"]
    with (
        open_bus(CAN, codec.bridge_ids) as bus,
        subprocess.Popen(
            [executable("sim_rig"), "--can", CAN, "--real-time"], stdout=subprocess.PIPE, text=True
        ) as rig,
    ):
        assert rig.stdout is not None
        assert "ready" in rig.stdout.readline()
        process = subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True)
        assert process.stderr is not None
        assert "waiting for the pump to be off" in process.stderr.readline()
        commands: list[CommandFrame] = []
        ended_at = time.monotonic() + PATIENCE_S
        while time.monotonic() < ended_at:
            message = bus.receive(0.02)
            frame = None if message is None else codec.receive(message)
            if frame is not None and frame.role == "command":
                if not commands:
                    process.send_signal(number)
                commands.append(codec.decode_command(frame))
            if process.poll() is not None:
                ended_at = min(ended_at, time.monotonic() + 0.3)
        rig.terminate()
    assert process.returncode == 130
    assert process.stderr.read() == ""
    assert len(commands) >= 5
    assert (commands[-1].voltages, commands[-1].enable) == ((0.0, 0.0), False)
    assert list(tmp_path.iterdir()) == []


def test_a_silent_bus_is_said(
    tmp_path: Path, within: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(claims, "LISTEN_S", 0.02)
    monkeypatch.setattr(claims, "CONTEST_S", 0.02)
    assert calibration_session.SILENCE_S == 3.0
    monkeypatch.setattr(calibration_session, "SILENCE_S", 0.2)
    code, _, told = within(tmp_path, "--zeros")
    assert code == 1
    assert f"nothing from the device on {CAN} for 0.2 s" in told


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((), "nothing to do: expected --zeros, --reference or --signs"),
        (("--signs", "--percent", "5.1"), "--percent should be above 0 and at most 5"),
        (("--signs", "--percent", "0"), "--percent should be above 0"),
        (("--signs",), "found none of lift, tilt: a wrong zero can turn the sign around"),
        (("--signs", "--reference", "tilt=-1.5"), "found none of lift: a wrong zero"),
        (("--reference", "wrist=1"), "has no joint 'wrist'"),
        (("--reference", "lift=up"), "should be JOINT=VALUE with a number, found 'lift=up'"),
        (("--reference", "lift=9"), "should be within its limits"),
        (("--signs", "--turned", "valve"), "(lift_valve, tilt_valve), found 'valve'"),
        (("--zeros", "--robot", "nowhere"), "no robot file 'nowhere'"),
        (("--zeros", "--mapping", "/nowhere"), "no mapping file '/nowhere'"),
        (("--zeros", "--from", "/nowhere"), "no calibration file '/nowhere'"),
        (("--zeros", "--out", "/nowhere"), "--out should be a folder, found '/nowhere'"),
        (("--zeros", "--can", "can77"), "cannot open CAN bus socketcan:can77"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(
    tmp_path: Path, within: Callable[..., Any], arguments: tuple[str, ...], text: str
) -> None:
    """One of them as a process of its own, too."""
    for run in (within, calibrate) if "--can" in arguments else (within,):
        code, out, told = run(tmp_path, *arguments)
        assert (code, out) == (2, "")
        assert told.startswith("calibrate: ")
        assert text in told
        assert told.count("\n") == 1


def test_where_files_cannot_be_linked_what_was_measured_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def link(*_: object) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "link", link)
    path, part = tmp_path / "a.calibration.yaml", tmp_path / "a.part"
    part.write_text("measured", encoding="utf-8")
    command._name(part, path)
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [(path.name, "measured")]
    part.write_text("another", encoding="utf-8")
    with pytest.raises(FileExistsError):
        command._name(part, path)
    assert path.read_text() == "measured"
