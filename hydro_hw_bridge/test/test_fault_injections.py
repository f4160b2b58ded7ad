"""Faults over many seeds, machine and bridge core to core: every promise of the safety case."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest

from hydro_hw_bridge.faults.bench import Bench, WatchedCodec
from hydro_hw_bridge.faults.bus_faults import BRIDGE, DEVICE, BusFault
from hydro_hw_bridge.faults.command_faults import BAD, CommandFault
from hydro_hw_bridge.faults.injection import AGE, AT_ONCE, STARVED, WATCHDOG, Injection
from hydro_hw_bridge.faults.injections import FAMILIES, drawn
from hydro_hw_bridge.faults.line import FaultLine
from hydro_hw_bridge.faults.machine_faults import MISSING, MachineFault
from hydro_hw_bridge.faults.naming import SILENT, Diagnosis, Named
from hydro_hw_bridge.faults.trial import Outcome, Trial
from hydro_hw_bridge.faults.wave import Wave
from hydro_hw_bridge.gate_limits import GateLimits
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_model.robot import Robot

SEEDS_PER_FAMILY = 8
AT = 20
TRIPS = Named(("trips",))


@pytest.fixture(scope="module")
def trial(robot: Robot) -> Trial:
    codec = WatchedCodec.load(None, None, robot)
    truth = load_truth("realistic", robot)
    rated = tuple(valve.rated_voltage_v for valve in robot.valves)
    limits = GateLimits(robot.valve_names, rated, 0.002, 1000.0, 5, 2.0e6)

    def commander(seed: int) -> Wave:
        return Wave(
            robot.valve_names, rated, 2.0, frequency_hz=2.0 + seed % 4, period_s=limits.period_s
        )

    return Trial(codec, limits, lambda seed: RigCore(robot, truth, seed=seed), commander)


def kept(outcome: Outcome) -> None:
    assert outcome.broken == (), (outcome.injection, outcome.reason)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("lockstep", [False, True], ids=["real_time", "lockstep"])
def test_every_promise_is_kept_over_many_seeds(trial: Trial, family: str, lockstep: bool) -> None:
    for seed in range(SEEDS_PER_FAMILY // 4 if lockstep else SEEDS_PER_FAMILY):
        kept(trial.run(drawn(seed, trial.codec, family), seed, lockstep=lockstep))


@pytest.mark.parametrize("family", ["lost", "late", "split"])
def test_what_starves_the_gate_is_held_to_a_time_and_nothing_else_stops(
    trial: Trial, family: str
) -> None:
    """Samples or sync frames that stay away for five cycles; four are driven over."""
    stopped = set()
    for seed in range(40):
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


def test_a_sample_counter_that_stands_still_stops_in_real_time(trial: Trial) -> None:
    outcome = trial.run(Injection("bus", BusFault("frozen", AT, 40), AGE + 1, Named()), 6)
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


def test_a_broken_promise_is_told(trial: Trial) -> None:
    """The judge itself: a harmless fault of which a stop is promised."""
    outcome = trial.run(Injection("publisher", CommandFault("twice", AT), AT_ONCE, TRIPS), 8)
    assert [text.partition(" ")[0] for text in outcome.broken] == ["0", "shows"]


def test_a_trip_that_is_none_of_a_fault_is_told(trial: Trial) -> None:
    """Nobody asked for it: driving on was right, and so a stop is a broken promise."""
    named = Named(("cycles_incomplete",))
    for cycles, told in ((4, ()), (5, ("tripped: no command for 12 ms (limit 10 ms)",))):
        injection = Injection("bus", BusFault("split", AT, cycles), None, named)
        assert trial.run(injection, 1).broken == told
        assert trial.run(replace(injection, may_trip="no command"), 1).broken == ()


def test_a_command_that_is_held_for_longer_than_its_age_is_told(trial: Trial) -> None:
    """A gate that lets commands be older drives on with what the amplifiers hold."""
    lax = replace(trial, limits=replace(trial.limits, max_age_cycles=12))
    named = Named(("cycles_incomplete",))
    for cycles, told in (
        (AGE, ()),
        (AGE + 1, ("a command 7 cycles old at the valves, promised at most 6",)),
        (10, ("a command 10 cycles old at the valves, promised at most 6",)),
    ):
        outcome = lax.run(Injection("bus", BusFault("split", AT, cycles), None, named), 1)
        assert outcome.broken == told
    # What the bridge sends is another matter: nobody but the amplifiers can tell that it is gone.
    # The page says what then comes through: a step as large as what was commanded meanwhile.
    lost = Injection("bus", BusFault("lost", AT, 20, BRIDGE), None, Named(("valve_frames_lost",)))
    [step] = trial.run(lost, 1).broken
    assert step == "step of 6.223 V per cycle"


def test_every_fault_has_to_show_or_is_argued(trial: Trial) -> None:
    for family in FAMILIES:
        for seed in range(100):
            injection = drawn(seed, trial.codec, family)
            for part in injection.parts or (injection,):
                for lockstep in (False, True):
                    named = part.naming(lockstep=lockstep)
                    assert bool(named.shows or named.says) != bool(named.silent), part
                    assert not named.silent or len(SILENT[named.silent]) > 20


def test_what_has_to_show_and_does_not_is_told(trial: Trial) -> None:
    now = Diagnosis({"trips": 1, "cycles_lost": 2, "cycles_complete": 9}, ("", "pump is off"))
    before = Diagnosis({"trips": 1, "cycles_lost": 0, "cycles_complete": 5}, ("", ""))
    assert now.grown(before) == {"cycles_lost"}
    assert now.lacks(Named(("trips", "cycles_lost"), "pump"), before) == []
    assert now.lacks(Named(("trips",)), before) == ["shows in none of trips"]
    assert now.lacks(Named(says="enable"), before) == [
        "said nowhere: 'enable' (found: pump is off)"
    ]
    # Of several, each has to: the second grows a counter that the first does not.
    parts = (
        Injection("machine", MachineFault("pump", AT), None, Named(("cycles_lost",))),
        Injection("publisher", CommandFault("twice", AT), None, Named(("commands_repeated",))),
    )
    both = Injection("several", parts[0].fault, None, Named(), parts=parts)
    assert both.kind == "2 faults"
    assert both.unnamed(now, before, lockstep=False) == [
        "twice: shows in none of commands_repeated, trips"
    ]
    assert both.unnamed(now, before, {parts[1].fault}, lockstep=False) == []
    # Whatever several are: a permissive that is open stops at once, and each shows.
    kept(trial.run(replace(both, parts=tuple(_shown(part) for part in parts)), 9))
    assert not trial.bench.rows[AT].permitted
    assert trial.bench.rows[AT].stopped


def _shown(part: Injection) -> Injection:
    return replace(part, named=TRIPS)


@pytest.mark.parametrize("kind", ["babble", "foreign"])
def test_frames_of_others_are_many_and_of_the_right_length(trial: Trial, kind: str) -> None:
    codec, cycles = trial.codec, 400
    line = FaultLine(codec, [BusFault(kind, 0, cycles, amount=10, seed=3)])
    trial.run(drawn(0, codec, "lost"), 0)
    device = trial.bench.device
    own, others = 0, []
    for counter in range(cycles):
        device.core.counter = counter
        sent = {bytes(m.data) for m in device.frames()}
        for message in device.frames():
            for one in line.take(message, DEVICE):
                known = bytes(one.data) in sent and one.arbitration_id in codec.device_ids
                own += known
                others += [] if known else [(counter, one)]
    assert own == cycles * len(codec.device_ids)
    assert len(others) == pytest.approx(10 * cycles, rel=0.05)
    frames = [(counter, codec.receive(one)) for counter, one in others]
    whole = [(counter, f) for counter, f in frames if f is not None and len(f.data) == 8]
    assert len(whole) > 0.7 * len(others)
    intact = sum(f.intact for _, f in whole)
    if kind == "foreign":
        assert intact == len(others)
        assert all(f.alive == counter & 15 for counter, f in whole)
    else:
        assert 1 <= intact < 0.01 * len(whole)  # by chance: one in 256


def test_a_pressure_that_is_stuck_is_named_and_stops_nothing(trial: Trial) -> None:
    signal = trial.codec.mapping.pressures["supply"].signal
    named = Named(("readings_still",), "pressure supply without any noise")
    injection = Injection("bus", BusFault("stuck", AT, 1010, DEVICE, (), signal), None, named)
    outcome = trial.run(injection, 1)
    kept(outcome)
    assert not outcome.tripped
    assert trial.bench.rows[-1].enabled
