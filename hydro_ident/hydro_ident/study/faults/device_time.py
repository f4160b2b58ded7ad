"""The greater part of the campaign: in device time, deterministic, core to core."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from hydro_hw_bridge.faults.bench import Commander, WatchedCodec
from hydro_hw_bridge.faults.injection import AT_ONCE
from hydro_hw_bridge.faults.injections import drawn
from hydro_hw_bridge.faults.trial import Outcome, Trial
from hydro_hw_bridge.faults.wave import Wave
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.node.parameters import PARAMETERS
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_ident.study.faults.controller import CoreCommander
from hydro_model.robot import Robot

#: Every so manieth injection is in lockstep; every so manieth is of the real controller's loop.
LOCKSTEP_EVERY, CONTROLLER_EVERY = 5, 3
#: Stops that take their time by their nature: a joint at rest is no fault for half a second, and
#: the first valve frame of those that are the same again is in time for as long as it may be old.
SLOW = ("bus: stuck (encoder)", "bus: frozen (bridge)")
_DEFAULT = {rule.name: rule.default for rule in PARAMETERS}


def limits_of(robot: Robot) -> GateLimits:
    """The limits of a gate with the bridge's default parameters."""
    period_s = 1.0 / robot.sensors.rate_hz
    return GateLimits(
        valve_names=robot.valve_names,
        rated_voltage_v=tuple(valve.rated_voltage_v for valve in robot.valves),
        period_s=period_s,
        slew_v_s=float(_DEFAULT["slew_limit_v_s"]),
        max_age_cycles=int(1e-3 * float(_DEFAULT["max_age_ms"]) / period_s + 1e-6),
        min_supply_pa=float(_DEFAULT["min_supply_pa"]),
        reenable_slew_v_s=float(_DEFAULT["reenable_slew_v_s"]),
    )


def make_trial(robot: Robot) -> Trial:
    """A trial of a robot with the shipped bus, and both publishers by turns."""
    codec = WatchedCodec.load(None, None, robot)
    limits, truth = limits_of(robot), load_truth("realistic", robot)

    def commander(seed: int) -> Commander:
        if seed % CONTROLLER_EVERY == 0:
            return CoreCommander(robot)
        return Wave(
            robot.valve_names,
            limits.rated_voltage_v,
            limits.legal_step_v,
            frequency_hz=2.0 + seed % 4,
            period_s=limits.period_s,
        )

    return Trial(codec, limits, lambda seed: RigCore(robot, truth, seed=seed), commander)


def run(
    robot: Robot, seeds: Iterable[int], told: Callable[[Outcome], None] = lambda _: None
) -> list[Outcome]:
    """Run the injections of some seeds.

    Parameters
    ----------
    robot : Robot
    seeds : iterable of int
    told : callable
        Of every outcome.

    Returns
    -------
    list of Outcome
    """
    trial = make_trial(robot)
    found = []
    for seed in seeds:
        lockstep = seed % LOCKSTEP_EVERY == LOCKSTEP_EVERY - 1
        injection = drawn(seed, trial.codec)
        # An encoder is known to be stuck under an open valve alone, and the wave opens them.
        other = int(injection.kind == "stuck (encoder)" and seed % CONTROLLER_EVERY == 0)
        found.append(trial.run(injection, seed + other, lockstep=lockstep))
        told(found[-1])
    return found


def summary(found: list[Outcome], period_s: float) -> dict[str, Any]:
    """Outcomes as they are published.

    Parameters
    ----------
    found : list of Outcome
    period_s : float
        Of the device's cycle.
    """
    by_kind: dict[str, list[Outcome]] = {}
    for one in found:
        by_kind.setdefault(f"{one.injection.group}: {one.injection.kind}", []).append(one)
    groups = {kind: _row(of, 1e3 * period_s) for kind, of in by_kind.items()}
    return {
        "injections": len(found),
        "lockstep": sum(one.lockstep for one in found),
        "tripped": sum(one.tripped for one in found),
        "stops_promised": sum(row["stops_promised"] for row in groups.values()),
        "worst_ms": max(row["worst_ms"] for key, row in groups.items() if key not in SLOW),
        "largest_step_v": max(one.step_v for one in found),
        "largest_reenable_step_v": max(
            (one.reenable_step_v for one in found if one.tripped), default=0.0
        ),
        "kinds": dict(sorted(groups.items())),
        "silent": _silent(found),
        "broken": [
            {
                "kind": one.injection.kind,
                "fault": str(one.injection.fault),
                "what": list(one.broken),
            }
            for one in found
            if one.broken
        ],
    }


def _row(found: list[Outcome], cycle_ms: float) -> dict[str, Any]:
    """A kind as a whole, and by each promise that injections of it were held to."""
    promises: dict[int, dict[str, Any]] = {}
    for one in found:
        limit = one.injection.limit_cycles
        if limit is None or one.stop_cycles is None or (one.lockstep and limit > AT_ONCE):
            continue
        row = promises.setdefault(
            limit, {"promised_ms": cycle_ms * limit, "stops_promised": 0, "worst_ms": 0.0}
        )
        row["stops_promised"] += 1
        row["worst_ms"] = max(row["worst_ms"], cycle_ms * one.stop_cycles)
    rows = [promises[limit] for limit in sorted(promises)]
    return {
        "injections": len(found),
        "stops_promised": sum(row["stops_promised"] for row in rows),
        "promised_ms": max((row["promised_ms"] for row in rows), default=0.0),
        "worst_ms": max((row["worst_ms"] for row in rows), default=0.0),
        "promises": rows,
    }


def _silent(found: list[Outcome]) -> dict[str, dict[str, int]]:
    """How often nothing had to show, by what the injection was, and how often it did show."""
    rows: dict[str, dict[str, int]] = {}
    for one in found:
        key = one.injection.silent(lockstep=one.lockstep)
        if key:
            row = rows.setdefault(key, {"injections": 0, "named_all_the_same": 0})
            row["injections"] += 1
            row["named_all_the_same"] += bool(one.named)
    return dict(sorted(rows.items()))
