"""What judges injections: that a promise that is not kept is told, and what has to show."""

from __future__ import annotations

from dataclasses import replace

import pytest

from hydro_hw_bridge.faults.bus_faults import BRIDGE, DEVICE, BusFault
from hydro_hw_bridge.faults.command_faults import CommandFault
from hydro_hw_bridge.faults.injection import AGE, AT_ONCE, Injection
from hydro_hw_bridge.faults.injections import FAMILIES, drawn
from hydro_hw_bridge.faults.line import FaultLine
from hydro_hw_bridge.faults.machine_faults import MachineFault
from hydro_hw_bridge.faults.naming import SILENT, Diagnosis, Named
from hydro_hw_bridge.faults.trial import Outcome, Trial

AT = 20
TRIPS = Named(("trips",))


def kept(outcome: Outcome) -> None:
    assert outcome.broken == (), (outcome.injection, outcome.reason)


def test_a_broken_promise_is_told(trial: Trial) -> None:
    """The judge itself: a harmless fault of which a stop is promised."""
    outcome = trial.run(Injection("publisher", CommandFault("twice", AT), AT_ONCE, TRIPS), 8)
    assert [text.partition(" ")[0] for text in outcome.broken] == ["0", "shows"]


def test_a_trip_that_is_none_of_a_fault_is_told(trial: Trial) -> None:
    """Nobody asked for it: driving on was right, and so a stop is a broken promise."""
    named = Named(("cycles_incomplete",))
    missing = "ENCODERS, PRESSURES_1, PRESSURES_2, VALVE_FEEDBACK"
    said = f"tripped: no whole cycle for 12 ms, missing {missing} (limit 10 ms)"
    for cycles, told in ((4, ()), (5, (said,))):
        injection = Injection("bus", BusFault("split", AT, cycles), None, named)
        assert trial.run(injection, 1).broken == told
        assert trial.run(replace(injection, may_trip="no whole cycle"), 1).broken == ()


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


def test_a_step_that_is_too_large_is_told(trial: Trial) -> None:
    """The page says so: the same frame again and again is counted in the place of others."""
    named = Named(("valve_frames_refused",))
    again = Injection("bus", BusFault("frozen", AT, 20, BRIDGE), None, named)
    assert trial.run(again, 1).broken == ("step of 5.271 V per cycle",)


def test_every_fault_has_to_show_or_is_argued(trial: Trial) -> None:
    for family, draws in FAMILIES.items():
        for seed in range(100 * len(draws)):
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


def test_a_jump_in_cycles_none_of_which_is_whole_has_nothing_to_show(trial: Trial) -> None:
    signal = trial.codec.mapping.joints["lift"].signal
    jump = BusFault("jump", AT + 1, 2, DEVICE, (), signal, 1 << 20)
    for lost, absent in ((4, {jump}), (2, set())):
        gone = BusFault("lost", AT, lost, DEVICE, (trial.codec.device_ids[1],))
        parts = tuple(Injection("bus", fault, None, TRIPS) for fault in (gone, jump))
        trial.run(Injection("several", gone, None, Named(), parts=parts), 1)
        assert trial.bench.absent() == absent


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
