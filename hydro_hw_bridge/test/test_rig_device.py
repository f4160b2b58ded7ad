"""`sim_rig` as a process on a real multicast bus, driven by a scripted bridge."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import numpy as np
import pytest

from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.bus.bus_open import open_bus
from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import Readings
from hydro_hw_bridge.rig import device as device_module
from hydro_hw_bridge.rig.command import run as run_rig
from hydro_hw_bridge.rig.truth_log import part_of, read_truth_log
from hydro_model.command_line.command import run_command

pytestmark = pytest.mark.processes
BUS = f"udp_multicast:239.74.163.2:{2_000 + (os.getpid() + 2_500) % 5_000}"
#: How long to wait for what must come, however busy the machine is.
PATIENCE_S = 120.0
MAIN = "from hydro_hw_bridge.rig.command import main; raise SystemExit(main())"
#: Alone on its bus it need not listen for another device for as long as one may be silent.
ALONE = f"from hydro_hw_bridge.rig import device; device.LISTEN_S = 0.1; {MAIN}"
Policy = Callable[[Readings], tuple[tuple[float, float], bool] | None]


def _command(*arguments: str) -> list[str]:
    return [sys.executable, "-c", MAIN, *arguments]


@contextmanager
def _rig(*arguments: str) -> Iterator["subprocess.Popen[str]"]:
    pipe = subprocess.PIPE
    options = ("--can", BUS, "--joints", "0.5", "-1.5", *arguments)
    command = [sys.executable, "-c", ALONE, *options]
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            if not line.startswith(f"sim_rig: ready on {BUS}: xs031"):
                raise AssertionError(process.communicate()[1])
            yield process
        finally:
            if process.poll() is None:
                process.kill()


class _Bridge:
    """Answers cycles as a policy says; keeps the messages of each."""

    def __init__(self, codec: Codec, bus: Bus) -> None:
        self.codec, self.bus = codec, bus
        self.cycles: list[list[can.Message]] = []
        #: Skip to the newest cycle: one that fell behind would answer too late for ever.
        self.newest_alone = False

    def receive(self) -> Readings | None:
        readings = self._next(PATIENCE_S)
        while self.newest_alone and (newer := self._next(0.0)) is not None:
            readings = newer
        return readings

    def _next(self, timeout_s: float) -> Readings | None:
        data: dict[str, bytes] = {}
        messages: list[can.Message] = []
        while len(data) < len(self.codec.cycle_frames):
            message = self.bus.receive(timeout_s)
            if message is None:
                return None
            frame = self.codec.receive(message)
            assert frame is not None
            assert frame.intact
            if frame.role == "sync":
                data, messages = {}, []
            data[frame.name] = frame.data
            messages.append(message)
        self.cycles.append(messages)
        return self.codec.readings(data)

    def answer(self, counter: int, voltages: tuple[float, float], enable: bool) -> None:
        assert self.bus.send(self.codec.encode_command(counter, voltages, enable))

    def run(self, cycles: int, policy: Policy) -> list[Readings]:
        """As many different cycles; repeats are answered too, but not counted."""
        out: list[Readings] = []
        while True:
            readings = self.receive()
            assert readings is not None, "the device fell silent"
            if not out or readings.counter != out[-1].counter:
                out.append(readings)
            if (answer := policy(readings)) is not None:
                self.answer(readings.counter, *answer)
            if len(out) == cycles:
                return out

    def until(self, reached: Callable[[Readings], bool], policy: Policy) -> Readings:
        """Run until a cycle is as wanted, at most 3000 cycles."""
        for _ in range(3000):
            readings = self.receive()
            assert readings is not None, "the device fell silent"
            if reached(readings):
                return readings
            if (answer := policy(readings)) is not None:
                self.answer(readings.counter, *answer)
        raise AssertionError("never reached")


def _silent(readings: Readings) -> None:
    return None


@pytest.fixture(name="bridge")
def _bridge(codec: Codec) -> Iterator[_Bridge]:
    with open_bus(BUS, codec.device_ids) as bus:
        yield _Bridge(codec, bus)


def _sine(readings: Readings) -> tuple[tuple[float, float], bool]:
    k = readings.counter
    return (2.0 * np.sin(0.03 * k), -2.0 * np.sin(0.03 * k)), True


def _summary(process: "subprocess.Popen[str]") -> str:
    out, err = process.communicate(timeout=PATIENCE_S)
    assert err == ""
    return out


def test_lockstep_run_is_the_same_to_the_byte(bridge: _Bridge, tmp_path: Path) -> None:
    files = []
    for run in range(2):
        files.append(tmp_path / f"{run}.npz")
        with _rig("--cycles", "100", "--seed", "7", "--truth-out", str(files[-1])) as process:
            # The second time the answers come late: device time does not care.
            seen: set[int] = set()

            def policy(
                readings: Readings, run: int = run, seen: set[int] = seen
            ) -> tuple[tuple[float, float], bool]:
                if run == 1 and readings.counter % 40 == 20 and readings.counter not in seen:
                    seen.add(readings.counter)
                    time.sleep(0.05)
                return _sine(readings)

            readings = bridge.run(100, policy)
            assert [r.counter for r in readings] == list(range(100))
            assert "100 cycles (0.200 s)" in _summary(process)
            assert process.returncode == 0
    records = [read_truth_log(file) for file in files]
    assert records[0].complete
    assert records[0].rows.shape == (100, len(records[0].names))
    assert records[0].rows.tobytes() == records[1].rows.tobytes()
    assert records[0].facts == {"robot": "xs031", "truth": "realistic", "seed": 7}
    moved = np.ptp(records[0].columns("position"), axis=0)
    assert (moved > 1e-3).all()
    assert not part_of(files[0]).exists()


def test_unanswered_cycle_is_repeated_bit_by_bit_and_taken_once(bridge: _Bridge) -> None:
    with _rig("--cycles", "3") as process:
        # Parked: repeated under the same counter.
        silent = [bridge.receive() for _ in range(3)]
        for reading in silent:
            assert reading is not None
            assert reading == silent[0]
            assert reading.counter == 0
            assert reading.status.parked
            assert reading.status.lockstep
        first = [bytes(m.data) for m in bridge.cycles[0]]
        assert [bytes(m.data) for m in bridge.cycles[2]] == first
        # Wrong answers change nothing; two answers to one cycle count once.
        bridge.answer(7, (9.0, 9.0), True)
        torn = bridge.codec.encode_command(0, (9.0, 9.0), True)
        torn.data[3] ^= 1
        bridge.bus.send(torn)
        bridge.answer(0, (1.0, 1.0), True)
        bridge.answer(0, (1.0, 1.0), True)
        one = bridge.until(lambda r: r.counter == 1, _silent)
        assert not one.status.parked
        # Moving: repeated too.
        assert bridge.receive() == one
        bridge.answer(1, (0.0, 0.0), True)
        bridge.until(lambda r: r.counter == 2, _silent)
        bridge.answer(2, (0.0, 0.0), True)
        summary = _summary(process)
    assert "3 cycles" in summary
    assert "2 stale and 1 corrupt" in summary


def test_disabled_answers_let_time_pass_and_the_machine_stand(bridge: _Bridge) -> None:
    with _rig("--cycles", "50") as process:
        readings = bridge.run(50, lambda r: ((5.0, 5.0), False))
        assert all(r.status.parked and not r.status.amplifier_enabled for r in readings)
        assert np.ptp([r.positions[0] for r in readings]) < 5e-5
        _summary(process)


def test_amplifier_watchdog_in_real_time(bridge: _Bridge) -> None:
    bridge.newest_alone = True
    with _rig("--real-time", "--truth", "ideal"):
        bridge.until(lambda r: r.status.amplifier_enabled, _sine)
        tripped = bridge.until(lambda r: r.status.amplifier_watchdog, _silent)
        assert not tripped.status.amplifier_enabled
        # Latched: enabled frames alone do not bring it back, off and on does.
        for readings in bridge.run(40, lambda r: ((1.0, 1.0), True)):
            assert readings.status.amplifier_watchdog
            assert not readings.status.amplifier_enabled
        bridge.until(lambda r: not r.status.amplifier_watchdog, lambda r: ((0.0, 0.0), False))
        bridge.until(lambda r: r.status.amplifier_enabled, lambda r: ((0.0, 0.0), True))


def test_inputs_from_the_command_line_and_by_signal(bridge: _Bridge) -> None:
    with _rig("--off", "emergency_stop", "pump") as process:
        first = bridge.until(lambda r: True, _silent)
        assert not first.status.emergency_stop_ok
        assert not first.status.pump_on
        assert first.status.enable_switch
        assert abs(first.pressures_pa[4]) < 5e4
        process.send_signal(signal.SIGUSR1)
        on = bridge.until(lambda r: r.status.pump_on, lambda r: ((0.0, 0.0), False))
        assert on.status.emergency_stop_ok
        process.send_signal(signal.SIGUSR2)
        pressed = bridge.until(
            lambda r: not r.status.emergency_stop_ok, lambda r: ((0.0, 0.0), False)
        )
        assert pressed.status.parked


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_ended_by_signal_the_side_file_is_whole(
    bridge: _Bridge, tmp_path: Path, number: signal.Signals
) -> None:
    out = tmp_path / "truth.npz"
    with _rig("--truth-out", str(out)) as process:
        bridge.run(30, _sine)
        process.send_signal(number)
        assert "watchdog trips" in _summary(process)
        assert process.returncode == 0
    record = read_truth_log(out)
    assert record.complete
    np.testing.assert_array_equal(record.column("counter")[:30], np.arange(30))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["truth.npz"]


def test_killed_the_rows_so_far_are_there(bridge: _Bridge, tmp_path: Path) -> None:
    out = tmp_path / "truth.npz"
    with _rig("--truth-out", str(out)) as process:
        bridge.run(520, _sine)
        process.kill()
        process.wait()
    record = read_truth_log(out)
    assert not record.complete
    np.testing.assert_array_equal(record.column("counter"), np.arange(500))


def test_second_device_is_refused(bridge: _Bridge) -> None:
    pipe = subprocess.PIPE
    with (
        _rig(),
        subprocess.Popen(_command("--can", BUS), stdout=pipe, stderr=pipe, text=True) as second,
    ):
        while second.poll() is None:  # the first is answered, so it speaks all the time
            readings = bridge.receive()
            assert readings is not None
            bridge.answer(readings.counter, (0.0, 0.0), False)
        _, told = second.communicate()
    assert second.returncode == 2
    assert told.count("\n") == 1
    assert "expected to be the only device" in told


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--can", "socketcan:can97"], "can97"),
        (["--can", "udp_multicast:10.0.0.1"], "expected udp_multicast:GROUP"),
        (["--truth", "absent.yaml"], "no truth 'absent.yaml'"),
        (["--robot", "absent"], "no robot file 'absent'"),
        (["--mapping", "absent.yaml"], "absent.yaml"),
        (["--tip", "9", "0", "0"], "no pose within the joint limits"),
        (["--joints", "0.5"], "expected 2 joint positions"),
        (["--truth-out", "/proc/none/truth.npz"], "cannot be written"),
        (["--duration", "-1"], "expected seconds above 0"),
    ],
)
def test_bad_usage_is_one_line_and_exit_2(
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
) -> None:
    """One of them as a process of its own, too."""
    monkeypatch.setattr(device_module, "LISTEN_S", 0.1)
    words = arguments if "--can" in arguments else [*arguments, "--can", BUS]
    ended = [(run_command("sim_rig", run_rig, words), *capfd.readouterr())]
    if "--robot" in arguments:
        done = subprocess.run(
            _command(*words), capture_output=True, text=True, check=False, timeout=PATIENCE_S
        )
        ended.append((done.returncode, done.stdout, done.stderr))
    for code, out, told in ended:
        assert (code, out) == (2, "")
        assert message in told
        assert told.count("\n") == 1
        assert told.startswith("sim_rig: ")


@pytest.mark.parametrize("seed", ["-1", "x", "1.5"])
def test_a_seed_that_is_none_is_said_so(seed: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        run_rig(["--seed", seed])
    told = f"argument --seed: expected a whole number of 0 or more, found '{seed}'"
    assert capsys.readouterr().err == f"sim_rig: error: {told}; see sim_rig --help\n"


def test_existing_side_file_is_left_alone(tmp_path: Path) -> None:
    out = tmp_path / "truth.npz"
    out.write_text("precious")
    done = subprocess.run(
        _command("--can", BUS, "--truth-out", str(out)),
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE_S,
    )
    assert done.returncode == 2
    assert "exists already" in done.stderr
    assert out.read_text() == "precious"


def test_help_is_quick_to_import() -> None:
    script = (
        "import sys\nsys.argv = ['sim_rig', '--help']\nfrom hydro_hw_bridge.rig import command\n"
        "try:\n    command.main()\nexcept SystemExit as end:\n"
        "    sys.exit(end.code or any(m in sys.modules for m in ('numba', 'scipy', 'can')))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False)
    assert done.returncode == 0
    assert b"--truth-out" in done.stdout


@pytest.mark.parametrize("content", [b"", b"text", b"{}\n", b'{"schema": "x"}\n'])
def test_files_that_are_no_side_file_are_named(tmp_path: Path, content: bytes) -> None:
    for path in (tmp_path / "a.npz", part_of(tmp_path / "b.npz")):
        path.write_bytes(content)
    for name in ("a.npz", "b.npz", "c.npz"):
        with pytest.raises(BridgeError, match=rf"{name}.* expected a truth file of sim_rig"):
            read_truth_log(tmp_path / name)
