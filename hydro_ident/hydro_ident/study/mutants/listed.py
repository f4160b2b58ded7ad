"""What is changed, and the tests that have to notice."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

_TEST = "hydro_hw_bridge/test"
_CORE = ("bridge_core", "supervision", "command_intake", "valve_frames")
#: Tests of one of these beside those of all.
_MORE = {
    "bridge_core": ("held_cycles", "standing_counter"),
    "supervision": ("standing_counter",),
}


@dataclass(frozen=True, slots=True)
class Target:
    """A module whose tests are tried.

    Attributes
    ----------
    name : str
    module : str
        As it is imported.
    tests : tuple of str
        Files or folders, from the repository's top.
    within : tuple of str
        Class and function of what is changed and covered; empty for all of the module.
    """

    name: str
    module: str
    tests: tuple[str, ...]
    within: tuple[str, ...] = ()

    @property
    def file(self) -> str:
        """From the repository's top."""
        return f"{self.module.partition('.')[0]}/{self.module.replace('.', '/')}.py"

    def test_files(self, root: Path) -> list[Path]:
        """Every file of its tests; in folders those of Python.

        Parameters
        ----------
        root : Path
            Top of the repository.
        """
        paths = [root / test for test in self.tests]
        return [file for p in paths for file in (p.rglob("*.py") if p.is_dir() else (p,))]

    def holds(self, where: str) -> bool:
        """Whether a place is of it.

        Parameters
        ----------
        where : str
            Class and function.
        """
        return not self.within or where in self.within


@dataclass(frozen=True, slots=True)
class Harmless:
    """A change that no test can or need notice.

    Attributes
    ----------
    target : str
        Name of the module's target.
    where : str
        Class and function.
    before, after : str
    why : str
    """

    target: str
    where: str
    before: str
    after: str
    why: str


TARGETS: tuple[Target, ...] = (
    *(
        Target(name, f"hydro_hw_bridge.gate.{name}", (f"{_TEST}/gate",))
        for name in ("gate", "gate_limits", "permissives", "amplifier_watch", "output_ramp")
    ),
    Target(
        "plausibility",
        "hydro_hw_bridge.monitoring.plausibility",
        (f"{_TEST}/test_plausibility.py", f"{_TEST}/test_plausibility_limits.py"),
    ),
    Target(
        "side_readings",
        "hydro_hw_bridge.monitoring.side_readings",
        (f"{_TEST}/test_side_readings.py",),
    ),
    *(
        Target(
            name,
            f"hydro_hw_bridge.core.{name}",
            tuple(
                f"{_TEST}/test_{test}.py"
                for test in (*_CORE, "watchdogs", "period_watch", *_MORE.get(name, ()))
            ),
        )
        for name in _CORE
    ),
    Target(
        "period_watch",
        "hydro_hw_bridge.monitoring.period_watch",
        (f"{_TEST}/test_period_watch.py",),
    ),
    Target(
        "valve_echo", "hydro_hw_bridge.monitoring.valve_echo", (f"{_TEST}/test_valve_echo.py",)
    ),
    Target(
        "held_voltages", "hydro_hw_bridge.gate.held_voltages", (f"{_TEST}/test_held_voltages.py",)
    ),
    Target(
        "bridge_turns", "hydro_hw_bridge.core.bridge_turns", (f"{_TEST}/test_bridge_turns.py",)
    ),
    Target("bus_health", "hydro_hw_bridge.bus.bus_health", (f"{_TEST}/test_bus_health.py",)),
    Target("link", "hydro_hw_bridge.bus.link", (f"{_TEST}/test_watchdogs.py",)),
    Target("amplifier", "hydro_hw_bridge.rig.amplifier", (f"{_TEST}/test_rig_amplifier.py",)),
    Target("assembler", "hydro_hw_bridge.protocol.assembler", (f"{_TEST}/assembler",)),
    Target("e2e", "hydro_hw_bridge.protocol.e2e", (f"{_TEST}/test_e2e.py",)),
    Target(
        "sample_clock", "hydro_hw_bridge.protocol.sample_clock", (f"{_TEST}/test_sample_clock.py",)
    ),
    Target("claims", "hydro_hw_bridge.bus.claims", (f"{_TEST}/test_claims.py",)),
    Target(
        "calibration_session",
        "hydro_hw_bridge.commissioning.calibration_session",
        (f"{_TEST}/test_calibration_watchdogs.py",),
    ),
    Target("own_frames", "hydro_hw_bridge.bus.own_frames", (f"{_TEST}/test_valve_frames.py",)),
    Target(
        "sample_join",
        "hydro_control.core.sample_join",
        ("hydro_control/test/test_join_and_parameters.py",),
    ),
    Target(
        "runaway",
        "hydro_control.monitoring.runaway",
        ("hydro_control/test/test_runaway.py", "hydro_control/test/test_runaway_edges.py"),
    ),
    Target(
        "following_error",
        "hydro_control.monitoring.following_error",
        ("hydro_control/test/test_following_error.py",),
    ),
    Target(
        "bad_samples",
        "hydro_control.monitoring.bad_samples",
        ("hydro_control/test/test_bad_sample_watch.py",),
    ),
    Target(
        "doubtful", "hydro_control.compensation.doubtful", ("hydro_control/test/test_doubtful.py",)
    ),
    Target("stamps", "hydro_control.monitoring.stamps", ("hydro_control/test/test_stamps.py",)),
    Target(
        "winding_down",
        "hydro_control.core.winding_down",
        ("hydro_control/test/test_winding_down.py",),
    ),
    Target("applied", "hydro_control.monitoring.applied", ("hydro_control/test/test_applied.py",)),
    Target(
        "device",
        "hydro_hw_bridge.rig.device",
        (f"{_TEST}/test_rig_fresh.py",),
        ("Device.takes",),
    ),
)
