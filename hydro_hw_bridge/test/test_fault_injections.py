"""Faults over many seeds, machine and bridge core to core: every promise of the safety case."""

from __future__ import annotations

import itertools
from collections import Counter

import pytest

from hydro_hw_bridge.faults.bench import Bench
from hydro_hw_bridge.faults.bus_faults import BRIDGE, DEVICE, LINK, BusFault
from hydro_hw_bridge.faults.command_faults import BAD, KINDS, CommandFault
from hydro_hw_bridge.faults.injection import AGE, AT_ONCE, STARVED, WATCHDOG, Injection
from hydro_hw_bridge.faults.injections import FAMILIES, drawn
from hydro_hw_bridge.faults.machine_faults import KINDS as MACHINE_KINDS
from hydro_hw_bridge.faults.machine_faults import MISSING, MachineFault
from hydro_hw_bridge.faults.naming import Named
from hydro_hw_bridge.faults.other_injections import ABSENT, GONE
from hydro_hw_bridge.faults.trial import Outcome, Trial
from hydro_model.robot import Robot

#: Of every family, and of every function that takes turns in one.
SEEDS_PER_FAMILY, SEEDS_PER_DRAW = 5, 2
AT = 20
TRIPS = Named(("trips",))


def kept(outcome: Outcome) -> None:
    assert outcome.broken == (), (outcome.injection, outcome.reason)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("lockstep", [False, True], ids=["real_time", "lockstep"])
def test_every_promise_is_kept_over_many_seeds(trial: Trial, family: str, lockstep: bool) -> None:
    draws = len(FAMILIES[family])
    count = max(SEEDS_PER_FAMILY, SEEDS_PER_DRAW * draws)
    for seed in range(max(SEEDS_PER_FAMILY // 4, draws) if lockstep else count):
        kept(trial.run(drawn(seed, trial.codec, family), seed, lockstep=lockstep))


def test_kinds_take_turns_on_both_clocks_and_so_do_times(trial: Trial) -> None:
    """Every fifth injection of the campaign is in lockstep, every third of the controller's."""
    kinds: Counter[str] = Counter()
    faults: Counter[tuple[str, int]] = Counter()
    settings: dict[str, set[int]] = {}
    for seed in range(1200):
        injection = drawn(seed, trial.codec)
        if injection.group in ("publisher", "machine") or injection.kind in LINK:
            kinds[injection.kind] += 1
            faults[injection.kind, injection.fault.cycles] += 1
            settings.setdefault(injection.kind, set()).add(seed % 15)
    assert set(kinds) == {*KINDS, *MACHINE_KINDS, *LINK}
    assert max(kinds[kind] for kind in KINDS) - min(kinds[kind] for kind in KINDS) <= 1
    assert min(kinds.values()) >= 6
    assert min(faults[kind, cycles] for kind in ABSENT for cycles in GONE) >= 6
    # No kind is in lockstep, or of the controller, always or never by the order of things.
    assert min(len({number % 5 for number in seen}) for seen in settings.values()) >= 3
    assert min(len({number % 3 for number in seen}) for seen in settings.values()) >= 2


@pytest.mark.parametrize("family", ["lost", "late", "split"])
def test_what_starves_the_gate_is_held_to_a_time_and_nothing_else_stops(
    trial: Trial, family: str
) -> None:
    """Samples or sync frames that stay away for five cycles; four are driven over."""
    stopped = set()
    for seed in range(24):
        injection = drawn(seed, trial.codec, family)
        outcome = trial.run(injection, seed)
        kept(outcome)
        assert outcome.tripped == (injection.limit_cycles is not None), injection
        stopped.add(outcome.tripped)
    assert stopped == {False, True}


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_command_never_reaches_the_valves(trial: Trial, kind: str) -> None:
    amount = 11.0 if kind == "beyond" else 6.0
    injection = Injection("publisher", CommandFault(kind, AT, 1, amount, 1), AT_ONCE, TRIPS)
    outcome = trial.run(injection, 1)
    kept(outcome)
    assert outcome.tripped
    assert outcome.stop_cycles == 1


@pytest.mark.parametrize("kind", MISSING)
def test_a_permissive_that_opens_stops_within_its_cycle_and_stays_so(
    trial: Trial, kind: str
) -> None:
    named = Named(("trips",), MISSING[kind])
    outcome = trial.run(Injection("machine", MachineFault(kind, AT, 1), AT_ONCE, named), 2)
    kept(outcome)
    assert outcome.tripped  # although it was open for one cycle only


def test_a_supply_that_loses_its_pressure_comes_back_by_the_pump_alone(trial: Trial) -> None:
    low_pa = 1.0e6
    fault = MachineFault("supply", AT, 3, low_pa)
    outcome = trial.run(Injection("machine", fault, AT_ONCE, TRIPS), 2)
    kept(outcome)
    shown = {s.counter: s.readings.pressures_pa for s in trial.bench.samples}
    supply = trial.codec.pressure_names.index("supply")
    first = trial.bench.samples[0].counter
    assert shown[first + AT - 1][supply] > 15.0e6
    for cycle in range(AT, AT + 3):
        assert shown[first + cycle][supply] == pytest.approx(low_pa, abs=2.0e5)
    # 18.7 MPa with a lag of 80 ms: 10.5 MPa are missing after 46 ms.
    assert 7.0e6 < shown[first + AT + 25][supply] < 10.0e6


def test_in_lockstep_a_cycle_that_is_sent_again_shows_the_supply_as_before(trial: Trial) -> None:
    """Else one cycle would come in two versions, which is another fault."""
    faults = (BusFault("lost", AT, 12, BRIDGE), MachineFault("supply", AT + 1, 2))
    bench = Bench(
        trial.make_rig(1),
        trial.codec,
        trial.limits,
        trial.make_commander(1),
        bus=faults[:1],
        machine=faults[1:],
        lockstep=True,
    )
    bench.run(AT + 3)
    assert bench.absent() == {faults[1]}
    assert bench.core.assembler.counters.contradicted == 0


def test_too_little_supply_stops_within_its_cycle(trial: Trial, robot: Robot) -> None:
    signal = trial.codec.mapping.pressures["supply"].signal
    # 2 MPa less than the minimum, in the transducer's counts: a pressure that can be.
    raw = trial.codec.layout.signals[signal]
    fault = BusFault("jump", AT, 2, DEVICE, (), signal, round(-17.5e6 / raw.scale))
    outcome = trial.run(Injection("bus", fault, AT_ONCE, TRIPS), 3)
    kept(outcome)
    assert outcome.reason.startswith("supply pressure")


@pytest.mark.parametrize(("cycles", "stop"), [(60, WATCHDOG), (12, 13), (4, None)])
def test_a_bridge_that_stands_still_is_answered_by_the_watchdog_or_by_itself_as_it_goes_on(
    trial: Trial, cycles: int, stop: int | None
) -> None:
    """What waited meanwhile, frames of the machine and commands, drives nothing."""
    fault = MachineFault("bridge_stopped", AT, cycles)
    named = Named() if stop is None else Named(("trips",), "no command for")
    outcome = trial.run(Injection("machine", fault, stop, named), 4)
    kept(outcome)
    assert outcome.stop_cycles == stop
    assert trial.bench.rows[AT + cycles - 1].watchdog == (cycles > WATCHDOG)


def test_a_dead_bridge_is_answered_by_the_amplifiers_watchdog(trial: Trial) -> None:
    injection = Injection("machine", MachineFault("bridge_dead", AT, 60), WATCHDOG, Named())
    outcome = trial.run(injection, 4)
    kept(outcome)
    assert outcome.stop_cycles == WATCHDOG  # 50 ms of device time, no more and no less


@pytest.mark.parametrize("cycles", [1, 2, 3, 6, 20, 49])
def test_valve_frames_lost_as_driving_begins_cost_time_and_no_step(
    trial: Trial, cycles: int
) -> None:
    """The amplifiers come on at 0 V, whenever the first frame comes through."""
    bench = Bench(
        trial.make_rig(1),
        trial.codec,
        trial.limits,
        trial.make_commander(1),
        bus=[BusFault("lost", 0, cycles, BRIDGE)],
    )
    bench.run(cycles + 30)
    driven = [row.voltages for row in bench.rows if row.enabled]
    assert not any(row.enabled for row in bench.rows[:cycles])
    assert driven[0] == (0.0, 0.0)
    assert any(driven[-1])
    steps = [
        max(abs(b - a) for a, b in zip(*pair, strict=True)) for pair in itertools.pairwise(driven)
    ]
    assert max(steps) <= trial.limits.legal_step_v + 1e-9
    assert bench.core.gate.trips == 0


@pytest.mark.parametrize("seed", [1, 3])
@pytest.mark.parametrize("cycles", [8, 12, 20, 24])
def test_valve_frames_lost_while_driving_are_followed_by_no_step(
    trial: Trial, cycles: int, seed: int
) -> None:
    """The output goes on from what the amplifiers took last, and is at the command soon after."""
    fault = BusFault("lost", AT, cycles, BRIDGE)
    outcome = trial.run(Injection("bus", fault, None, Named(("valve_frames_lost",))), seed)
    kept(outcome)
    assert outcome.step_v <= 2.0 * trial.limits.legal_step_v + 1e-9
    assert not outcome.tripped
    bench = trial.bench
    held = {row.voltages for row in bench.rows[AT : AT + cycles]}
    assert len(held) == 1
    bench.run(20)
    for _ in range(50):
        asked = bench.core.gate._command
        bench.step()
        assert bench.rows[-1].voltages == pytest.approx(asked, abs=1e-3)


def test_valve_frames_that_are_the_same_again_are_ended_by_the_watchdog(trial: Trial) -> None:
    """A controller of the bus that sends its buffer on and on: the first is in time for 10 ms."""
    named = Named(("valve_frames_refused",), "watchdog shut them down")
    fault = BusFault("frozen", AT, 40, BRIDGE)
    outcome = trial.run(Injection("bus", fault, AGE + WATCHDOG, named), 1)
    kept(outcome)
    assert outcome.stop_cycles == AGE + WATCHDOG


def test_amplifiers_that_never_hear_of_enable_trip_it(trial: Trial) -> None:
    bench = Bench(
        trial.make_rig(1),
        trial.codec,
        trial.limits,
        trial.make_commander(1),
        bus=[BusFault("lost", 0, 200, BRIDGE)],
    )
    bench.run(100)
    assert bench.core.gate.reason == "the amplifiers did not come on within 100 ms"


def test_a_silent_controller_is_answered_by_the_gate(trial: Trial) -> None:
    outcome = trial.run(Injection("publisher", CommandFault("silent", AT, 20), AGE, TRIPS), 5)
    kept(outcome)
    assert outcome.stop_cycles == AGE
    assert outcome.reason == "no command for 12 ms (limit 10 ms)"


@pytest.mark.parametrize(
    ("kind", "alone", "stop"),
    [("frozen", False, AGE + 1), ("frozen", True, AGE + 1), ("wild", True, AGE)],
)
def test_a_sample_counter_that_stands_still_stops_in_real_time(
    trial: Trial, kind: str, alone: bool, stop: int
) -> None:
    """Of all frames, or of the sync frame alone while the others go on; so does a wild one."""
    fault = BusFault(kind, AT, 40, frames=trial.codec.device_ids[:1] if alone else ())
    outcome = trial.run(Injection("bus", fault, stop, Named()), 6)
    kept(outcome)
    assert "sample counter stood still" in outcome.reason


@pytest.mark.parametrize("late", range(1, 31))
def test_valve_frames_that_are_late_on_the_bus_never_drive_for_long(
    trial: Trial, late: int
) -> None:
    fault = BusFault("late", AT, 60, BRIDGE, amount=late)
    limit = WATCHDOG if late > STARVED else None
    kept(trial.run(Injection("bus", fault, limit, TRIPS if limit else Named()), late))


@pytest.mark.parametrize("late", [*range(1, 16), 23])
def test_machine_frames_that_are_all_late_never_drive_for_long(trial: Trial, late: int) -> None:
    """The bridge's clock is the machine's: what it sees is silence, and the end of the lateness.

    Frames in time then come between those that are late: the gate is without a sample, of which
    the last was as late.
    """
    cycles = 60
    fault = BusFault("late", AT, cycles, DEVICE, amount=late)
    limit = AGE if late > STARVED else cycles + AGE - late if 2 * late >= STARVED else None
    outcome = trial.run(Injection("bus", fault, limit, TRIPS if limit else Named()), late)
    kept(outcome)
    assert outcome.stop_cycles == limit


@pytest.mark.parametrize("late", range(17, 32))
def test_a_frame_far_too_late_is_in_no_sample(trial: Trial, late: int) -> None:
    fault = BusFault("late", AT, 2, DEVICE, (trial.codec.device_ids[1],), amount=late)
    kept(trial.run(Injection("bus", fault, None, Named(("cycles_incomplete",))), late))


def test_a_frame_of_exactly_sixteen_cycles_ago_contradicts_the_present_one(trial: Trial) -> None:
    """Its alive counter is that of the present cycle: which is the device's nobody can tell."""
    fault = BusFault("late", AT, 1, DEVICE, (trial.codec.device_ids[1],), amount=16)
    reason = "two different frames ENCODERS of one cycle"
    named = Named(("cycles_contradicted",), reason)
    outcome = trial.run(Injection("bus", fault, None, named), 1)
    kept(outcome)
    assert reason in outcome.reason


@pytest.mark.parametrize("joint", ["lift", "tilt"])
def test_an_encoder_that_is_stuck_ends_driving(trial: Trial, joint: str) -> None:
    signal = trial.codec.mapping.joints[joint].signal
    fault = BusFault("stuck", AT, 600, DEVICE, (), signal)
    named = Named(("readings_stuck",), f"{joint}: encoder stuck")
    outcome = trial.run(Injection("bus", fault, None, named), 1)
    kept(outcome)
    assert f"{joint}: encoder stuck" in outcome.reason


def test_a_clock_that_steps_changes_no_voltage(trial: Trial) -> None:
    runs = []
    for amount_s in (0.0, -3600.0, 0.5):
        fault = MachineFault("clock_step", AT, 1, amount_s)
        kept(trial.run(Injection("machine", fault, None, Named()), 7))
        runs.append((trial.bench.rows, [s.stamp_ns for s in trial.bench.samples]))
    assert runs[0] == runs[1] == runs[2]


def test_the_same_seed_gives_the_same_run(trial: Trial) -> None:
    rows = []
    for _ in range(2):
        trial.run(drawn(4, trial.codec), 4)
        rows.append(trial.bench.rows)
    assert rows[0] == rows[1]


def test_a_pressure_that_is_stuck_is_named_and_stops_nothing(trial: Trial) -> None:
    signal = trial.codec.mapping.pressures["supply"].signal
    named = Named(("readings_still",), "pressure supply without any noise")
    injection = Injection("bus", BusFault("stuck", AT, 1010, DEVICE, (), signal), None, named)
    outcome = trial.run(injection, 1)
    kept(outcome)
    assert not outcome.tripped
    assert trial.bench.rows[-1].enabled
