"""Bags for the tests of this folder."""

from __future__ import annotations

import json
import re
import struct
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag import mcap_gather, mcap_records, stretches
from hydro_ident.bag.recording import Recording
from hydro_ident.bag.stretch_cycles import Known
from hydro_ident.bag.writer import BagWriter
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot
from hydro_msgs_docs.cdr import JOINT_STATE, POINT_STAMPED
from hydro_msgs_docs.middleware import prepare_middleware

# Fast DDS reads its settings once in a process, whichever test makes the first node.
prepare_middleware()

START_NS = 1_700_000_000_000_000_000
PERIOD_NS = 2_000_000

#: Topic -> (names or None, field -> (N, k) array); rows of NaN are not written.
Columns = Mapping[str, tuple[tuple[str, ...], Mapping[str, np.ndarray]]]
WriteBag = Callable[..., Path]


def pytest_configure(config: pytest.Config) -> None:
    """Declare the marker of this folder's own."""
    config.addinivalue_line("markers", "study: makes and diagnoses cases of the study (minutes)")


@pytest.fixture(scope="session")
def robot() -> Robot:
    return load_robot("xs031")


def _write_bag(
    folder: Path,
    columns: Columns,
    *,
    name: str = "bag",
    stamps: np.ndarray | None = None,
    repeat: Mapping[str, int] | None = None,
    **options: object,
) -> Path:
    count = max(len(next(iter(fields.values()))) for _, fields in columns.values())
    stamps = START_NS + PERIOD_NS * np.arange(count) if stamps is None else stamps
    with BagWriter(folder / name, **options) as writer:  # type: ignore[arg-type]
        for topic, (names, _) in columns.items():
            writer.add_topic(topic, JOINT_STATE if names else POINT_STAMPED)
        for k in range(count):
            for topic, (names, fields) in columns.items():
                values = {f: v[k] for f, v in fields.items() if k < len(v)}
                if not values or np.isnan(next(iter(values.values()))).any():
                    continue
                for _ in range((repeat or {}).get(topic, 0) + 1 if k == 0 else 1):
                    writer.write_stamped(topic, int(stamps[k]), values, names=names)
    return folder / name


@pytest.fixture
def write_bag(tmp_path: Path) -> WriteBag:
    """Writes columns by the project's writer; returns the bag's directory."""
    return partial(_write_bag, tmp_path)


@pytest.fixture(scope="session")
def write_bag_in() -> WriteBag:
    """As `write_bag`, into a folder that is given first: for what several tests share."""
    return _write_bag


@pytest.fixture
def without_checksums() -> Callable[[Path], Path]:
    """Takes the checksums out of a bag's files, which other writers may leave out."""

    def strip(path: Path) -> Path:
        for file in path.glob("*.mcap"):
            data, at = bytearray(file.read_bytes()), 8
            while at < len(data) - 8:
                opcode, length = struct.unpack_from("<BQ", data, at)
                field = {0x06: at + 9 + 24, 0x0F: at + 9}.get(opcode)  # of a chunk, of all data
                if field is not None:
                    data[field : field + 4] = bytes(4)
                at += 9 + length
            file.write_bytes(data)
        return path

    return strip


@pytest.fixture
def run_columns(robot: Robot) -> Callable[[int], dict[str, tuple[tuple[str, ...], dict]]]:
    """A plausible run of the reference crane, absolute pressures, every cycle topic."""

    def columns(count: int) -> dict[str, tuple[tuple[str, ...], dict]]:
        rng = np.random.default_rng(3)
        t = np.arange(count)[:, None] * 2e-3
        q = np.array([0.8, -1.2]) + 0.2 * np.sin(t * [3.0, 4.0])
        pressure = 5e6 + 1e4 * rng.normal(size=(count, len(robot.pressure_names)))
        volts = np.clip(rng.normal(size=(count, 2)), -9.0, 9.0)
        tip = np.column_stack([2.0 + 0.1 * np.sin(t), 0.0 * t, 0.1 * t])
        return {
            "/joint_states": (robot.joint_names, {"position": q, "velocity": 0.0 * q}),
            "/chamber_pressures": (robot.pressure_names, {"effort": pressure}),
            "/valve_command": (robot.valve_names, {"effort": volts}),
            "/valve_state": (robot.valve_names, {"effort": volts, "position": volts / 10}),
            "/joint_reference": (
                robot.joint_names,
                {"position": q + 0.01, "velocity": 0.5 * q, "effort": 1e4 * q},
            ),
            "/tip_reference": ((), {"point": tip}),
        }

    return columns


@dataclass(frozen=True)
class SimulatedRun:
    """A simulated run of the reference crane as its sensors see it, gauge pressures."""

    robot: Robot
    q: np.ndarray
    p_a: np.ndarray
    p_b: np.ndarray
    voltage: np.ndarray

    def columns(self) -> dict[str, tuple[tuple[str, ...], dict[str, np.ndarray]]]:
        """Topics of a bag, to be thinned out by a test; absolute pressures."""
        robot, count = self.robot, len(self.q)
        gauge = np.zeros((count, 6))
        gauge[:, 0:4:2], gauge[:, 1:4:2] = self.p_a, self.p_b
        gauge[:, 4], gauge[:, 5] = robot.supply_pressure_pa, robot.tank_pressure_pa
        absolute = gauge + robot.atmospheric_pressure_pa
        return {
            "/joint_states": (robot.joint_names, {"position": self.q}),
            "/chamber_pressures": (robot.pressure_names, {"effort": absolute}),
            "/valve_state": (robot.valve_names, {"effort": self.voltage}),
        }

    def recording(self, name: str = "run", **changes: object) -> Recording:
        """The run as a recording under the reference crane's robot file, some fields changed."""
        count, rail = len(self.q), np.ones(len(self.q))
        given = Recording(
            path=Path(name), robot=load_robot("xs031"), period_s=PERIOD_NS * 1e-9,
            stamp_ns=START_NS + PERIOD_NS * np.arange(count), q=self.q, stroke=None, effort=None,
            p_a=self.p_a, p_b=self.p_b, supply=self.robot.supply_pressure_pa * rail,
            tank=self.robot.tank_pressure_pa * rail, valve_v=self.voltage,
            valve_source="/valve_state", command_v=self.voltage, spool=None,
            latched=np.zeros(count, dtype=bool), q_ref=None, qd_ref=None, force_ref=None,
            tip_ref=None, temperature_stamp_ns=None, temperature_c=None, losses=(), gaps=(),
            duplicates={}, notes=(), metadata={},
        )  # fmt: skip
        return replace(given, **changes)  # type: ignore[arg-type]


def _motion(t: float, phase: float, scale: float = 1.0) -> np.ndarray:
    fade = np.clip(t / 2.0, 0.0, 1.0)
    fade = fade * fade * (3.0 - 2.0 * fade)
    slow = np.sin(2 * np.pi * np.array([0.11, 0.17]) * t + phase * np.clip(t / 2.0, 0.0, 1.0))
    quick = np.sin(2 * np.pi * (np.array([0.5, 0.6]) + 0.03 * t) * t)
    return np.array([0.55, -1.2]) + fade * scale * (
        np.array([0.35, 0.5]) * slow + np.array([0.006, 0.008]) * quick
    )


def simulated_run(
    robot: Robot,
    seconds: float,
    seed: int = 0,
    scale: float = 1.0,
    noisy: bool = True,
    pace: float = 1.0,
) -> SimulatedRun:
    """Drive the model along a motion by a slow loop, then roll it out in one piece.

    `scale` is that of the motion's amplitude, `pace` that of its time; `noisy` are the sensors.
    """
    from hydro_model.hydraulics.cylinder import lever
    from hydro_model.simulation.simulate import simulate

    step = PERIOD_NS * 1e-9
    time = np.arange(round(seconds / step) + 1) * step
    voltage, instant, phase = np.zeros((time.size, 2)), replace(robot, command_delay_s=0.0), seed
    path = partial(_motion, phase=phase, scale=scale)
    q, qd, pressures = path(0.0), np.zeros(2), None
    for k in range(0, time.size - 1, 10):
        piece = slice(k, min(k + 11, time.size))
        ahead, later = (path(pace * (time[k] + dt)) for dt in (0.02, 0.021))
        for i, cylinder in enumerate(robot.cylinders):
            speed = (later[i] - ahead[i]) / 0.001 + 2.0 * (ahead[i] - q[i])
            flow = float(lever(cylinder, q[i])) * speed * cylinder.area_a_m2
            voltage[piece, i] = np.clip(10.0 * flow / (9e-7 * 2800.0), -9.0, 9.0)
        out = simulate(instant, time[piece], voltage[piece], q, qd, pressures)
        q, qd = out.q[-1], out.qd[-1]
        pressures = np.stack([out.p_a[-1], out.p_b[-1]], axis=1)
    out = simulate(robot, time, voltage, path(0.0))
    if not noisy:
        return SimulatedRun(robot, out.q, out.p_a, out.p_b, voltage)
    rng, count = np.random.default_rng(seed), 2 * np.pi / 2**20
    return SimulatedRun(
        robot,
        count * np.round(out.q / count + rng.normal(0, 0.5, out.q.shape)),
        1e3 * np.round(out.p_a / 1e3 + rng.normal(0, 4, out.p_a.shape)),
        1e3 * np.round(out.p_b / 1e3 + rng.normal(0, 4, out.p_b.shape)),
        voltage,
    )


def true_crane(payload_kg: float = 0.0, bulk: float = 1.0) -> Robot:
    """The reference crane as it really is in the simulated runs."""
    robot = load_robot("xs031")
    inertia = robot.link_inertia.copy()
    inertia[1] *= 1.12
    reach = float(robot.tip_offset_m[0])
    inertia[1, [0, 1, 7, 9]] += payload_kg * np.array([1.0, reach, reach**2, reach**2])
    return replace(
        robot,
        link_inertia=inertia,
        cylinders=tuple(
            replace(c, viscous_friction=b, bulk_modulus_pa=bulk * k)
            for c, b, k in zip(robot.cylinders, (3.2e4, 4.1e4), (8.2e8, 7.4e8), strict=True)
        ),
        command_delay_s=0.0013,
    )


@pytest.fixture(scope="session")
def crane_run() -> SimulatedRun:
    """18 s of the true crane."""
    return simulated_run(true_crane(), 18.0)


@pytest.fixture(scope="session")
def lay_out() -> Callable[..., Any]:
    """Rows and refitted base of the datasheet's structure, as a diagnosis of a run starts with.

    Takes a run, those to verify on, and the effects that the robot's file lists.
    """
    from hydro_ident.identify.survey import survey_source
    from hydro_ident.mismatch.settings import DiagnosisSettings
    from hydro_ident.mismatch.split.residuals import Residuals, residuals
    from hydro_ident.recordings.sources import sources_of

    def laid(
        run: SimulatedRun,
        others: Sequence[SimulatedRun] = (),
        listed: tuple[EffectSpec, ...] = (),
    ) -> Residuals:
        robot = replace(load_robot("xs031"), effects=listed)
        sources = sources_of([run.recording()])
        checked = sources_of([one.recording(f"check{k}") for k, one in enumerate(others)])
        surveys = [survey_source(source, robot) for source in (*sources, *checked)]
        work = residuals(robot, sources, checked, surveys, DiagnosisSettings())
        assert work is not None
        return work

    return laid


@pytest.fixture(scope="session")
def make_run() -> tuple[Callable[..., Robot], Callable[..., SimulatedRun]]:
    """`true_crane` and `simulated_run`, for other machines and motions."""
    return true_crane, simulated_run


class ReportReader(HTMLParser):
    """Of a report: collects sections, addresses and figures, and checks that tags close."""

    #: Sections in the order of the questions.
    ORDER = (
        *("verdict", "health", "excitation", "parameters", "predictions", "laws"),
        *("correlation", "free_run", "control", "provenance"),
    )

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.sections: tuple[str, ...] = ()
        self.addresses: list[str] = []
        self.figures: list[dict[str, Any]] = []
        self.text = ""
        self.style = ""
        self._json = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.addresses += [v or "" for k, v in attrs if k in ("src", "href", "srcset", "action")]
        if tag == "section":
            self.sections += (given.get("id") or "",)
        self._json = given.get("type") == "application/json"
        if tag not in ("meta", "wbr"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._json:
            self.figures.append(json.loads(data))
            self._json = False
        elif self.open and self.open[-1] == "style":
            self.style += data
        elif self.open and self.open[-1] != "script":
            self.text += data


@pytest.fixture(scope="session")
def read() -> Callable[[str], ReportReader]:
    """Reads a report."""

    def one(report: str) -> ReportReader:
        reader = ReportReader()
        reader.feed(report)
        assert reader.open == []
        return reader

    return one


@pytest.fixture
def figures_of(read: Callable[[str], ReportReader]) -> Callable[[str], list[dict[str, Any]]]:
    """A report's figures, when plotly takes them and each axis has a title with its unit."""
    go = pytest.importorskip("plotly.graph_objects", reason="plotly is not installed")

    def checked(report: str) -> list[dict[str, Any]]:
        figures = read(report).figures
        for figure in figures:
            # Plotly's own validators: a misspelt or impossible property raises. Names that begin
            # with two dashes are colours of the style sheet, which the page's script looks up.
            go.Figure(json.loads(re.sub(r'"--[a-z]+"', '"#000000"', json.dumps(figure))))
            axes = [k for k in figure["layout"] if re.match(r"[xy]axis", k)]
            assert {t["yaxis"] for t in figure["data"]} <= {k.replace("axis", "") for k in axes}
            for axis in axes:
                title = figure["layout"][axis]["title"]["text"]
                assert re.search(r" in \S+|\(no unit\)|\(name\)", title), title
        return figures

    return checked


@pytest.fixture
def browser_check() -> Callable[..., dict[str, Any]]:
    """Opens a report in Chromium, at every width or some: what `check_report.py` measured."""
    script = Path(__file__).parents[2] / "scripts" / "check_report.py"
    which = subprocess.run([sys.executable, script, "--which"], capture_output=True, text=True)
    if which.returncode:
        pytest.skip(f"the report is not opened: {which.stderr.strip()}")

    def check(report: Path, *widths: int) -> dict[str, Any]:
        at = ["--widths", *map(str, widths)] if widths else []
        done = subprocess.run(
            [sys.executable, script, report, *at], capture_output=True, text=True, timeout=900
        )
        assert done.stdout, done.stderr
        answer: dict[str, Any] = json.loads(done.stdout)
        return answer

    return check


@pytest.fixture
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Lets the reader hand on messages in blocks of so many."""

    def blocks(rows: int) -> None:
        for module in (mcap_gather, mcap_records):
            monkeypatch.setattr(module, "BLOCK_ROWS", rows)

    return blocks


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch) -> list[Known]:
    """What was taken for granted in each passage over a bag."""
    met, passage = list[Known](), stretches.Passage

    def noted(*arguments: Any) -> stretches.Passage:
        made = passage(*arguments)
        met.append(made.known)
        return made

    monkeypatch.setattr(stretches, "Passage", noted)
    return met
