"""Changes that no test can or need notice, each with the reason; here those of the bridge."""

from __future__ import annotations

from collections.abc import Iterator

from hydro_ident.study.mutants.arguments import (
    DRIVING_FIRST,
    HALF_A_WRAP,
    LENGTHS,
    NO_NEGATIVE,
    UNREAD,
    begins,
    each,
)
from hydro_ident.study.mutants.harmless_control import OF_CONTROL
from hydro_ident.study.mutants.listed import Harmless


def _gate() -> Iterator[Harmless]:
    init = "Gate.__init__"
    no_defect = UNREAD.format("it belongs to a defect, and there is none yet")
    yield from begins("gate", init, "_defect_at", ("-1", "1"), no_defect)
    yield from begins("gate", init, "_first", ("-1",), NO_NEGATIVE)
    yield from begins("gate", init, "_accepted", ("pass", "-1", "1"), DRIVING_FIRST)
    yield from begins("gate", init, "_command", ("pass",), DRIVING_FIRST, "self._zero")
    end = " if self._newest is None else self._newest"
    yield Harmless(
        "gate", "Gate.arm", f"self._first = 0{end}", f"self._first = -1{end}", NO_NEGATIVE
    )
    yield from begins("gate", "Gate.forget", "_first", ("-1",), NO_NEGATIVE)
    yield Harmless(
        "gate", "Gate.trip", "self._wait()", "pass",
        "while tripped the output is 0 V whatever was asked before, and clearing waits first",
    )  # fmt: skip
    yield Harmless(
        "gate", "Gate._follow", "return Outcome.ACCEPTED", "pass",
        "after the stop at 0 V the rate is judged from 0 V to 0 V: accepted again, the same",
    )  # fmt: skip
    judged = LENGTHS.format("`_judge` has compared them")
    for where, before in (
        ("Gate._follow", "self.limits.valve_names, values, self._command, strict="),
        ("Gate._judge", "at = dict(zip(names, voltages, strict="),
    ):
        rest = {"Gate._follow": "", "Gate._judge": "))"}[where]
        yield Harmless("gate", where, f"{before}True{rest}", f"{before}False{rest}", judged)


def _permissives() -> Iterator[Harmless]:
    yield Harmless(
        "permissives", "missing_permissive", 'return ""', "pass",
        "None is as empty as the text: both are only asked whether there is anything",
    )  # fmt: skip
    asked = "def missing_permissive(inputs: Inputs | None, limits: GateLimits, {}, settled: bool)"
    yield Harmless(
        "permissives", "missing_permissive",
        f"{asked.format('*')} -> str:", f"{asked.format('/')} -> str:",
        "the gate gives inputs and limits by their place and says what the word means",
    )  # fmt: skip


def _driven_cycles() -> Iterator[Harmless]:
    known = "if self._newest is None else self._ramp.driven_cycles(self._newest)"
    for other in ("-1", "1"):
        yield Harmless(
            "gate", "Gate._driven_cycles", f"return 0 {known}", f"return {other} {known}",
            UNREAD.format("it is asked while driving alone, and the newest cycle is known then"),
        )  # fmt: skip


def _output_ramp() -> Iterator[Harmless]:
    init = "OutputRamp.__init__"
    for after in ("pass", "self.begin( -1)", "self.begin( 1)"):
        yield Harmless("output_ramp", init, "self.begin(0)", after, DRIVING_FIRST)
    before = "for value, before in zip(values, self.applied_v, strict="
    yield Harmless(
        "output_ramp", "OutputRamp.follow", f"{before}True)", f"{before}False)",
        LENGTHS.format("the gate has compared them"),
    )  # fmt: skip


def _plausibility() -> Iterator[Harmless]:
    why = UNREAD.format("it is the time of the last readings, and there are none yet")
    yield from begins("plausibility", "ReadingsWatch.forget", "_at", ("-1", "1"), why)
    yield Harmless(
        "plausibility", "ReadingsWatch._jump", 'return ""', "pass",
        "None is as empty as the text: the encoders are looked at next, which give a text",
    )  # fmt: skip


def _side_readings() -> Iterator[Harmless]:
    first = "self._still_at_m = [{}] * len(self._cylinders)"
    why = UNREAD.format("the first cycle of all sets it")
    afters = (first.format(" -1.0"), first.format(" 1.0"))
    yield from each("side_readings", "SideWatch.forget", first.format("0.0"), afters, why)
    most = "if moved {} STUCK_SHARE * cylinder.stroke_m + STUCK_COUNTS * self._counts[i]:"
    yield Harmless(
        "side_readings", "SideWatch._stuck", most.format("<="), most.format("<"),
        "a way that is computed from angles is not exactly at the limit but by chance",
    )  # fmt: skip


def _bridge_core() -> Iterator[Harmless]:
    unheard = "unheard_s: float = 0.0,"
    yield Harmless(
        "bridge_core", "BridgeCore.command", unheard, unheard.replace("0.0", "-1.0"),
        "no time and less than none are both shorter than a command may be old",
    )  # fmt: skip


def _supervision() -> Iterator[Harmless]:
    private = "a private function, whose callers say what the word means"
    core = "the bridge's core says what the word means"
    for name, words, more, why in (
        ("sync", "sync: Frame, counter: int", "advanced: bool, ", core),
        ("paced", "counter: int, at_s: float", "", core),
        ("_check", "status: Status", "", private),
        ("_stands", "name: str, reason: str", "", private),
    ):
        head = f"def {name}(self, {words}, *, {more}active: bool) -> None:"
        where = f"Supervision.{name}"
        yield Harmless("supervision", where, head, head.replace("*", "/"), why)


def _period_watch() -> Iterator[Harmless]:
    again = "if ahead_s <= 0.0:"
    yield Harmless(
        "period_watch", "PeriodWatch._count", again, again.replace("<=", "<"),
        "neither ahead nor behind, this cycle is as good to count from as the one before",
    )  # fmt: skip
    grace = "if self._ahead_s <= GRACE_S:"
    yield Harmless(
        "period_watch", "PeriodWatch.look", grace, grace.replace("<=", "<"),
        "a clock's reading is not exactly at the limit but by chance, and may be told or not then",
    )  # fmt: skip


def _period_words() -> Iterator[Harmless]:
    words = 'f" {1e3 * self._period_s:.3g} ms (rate_hz of the robot file): correct one of both"'
    for other in (" 1001.0", " 999.0"):
        yield Harmless(
            "period_watch", "PeriodWatch.look", words, words.replace("1e3", other),
            "three digits of a period are told, a thousandth of it is not",
        )  # fmt: skip


def _command_intake() -> Iterator[Harmless]:
    old = "outdated = counter is not None and counter < self._whole[0]"
    yield Harmless(
        "command_intake", "CommandIntake._answerable", old, old.replace("<", "<="),
        "the oldest sample that is known is among those that are known",
    )  # fmt: skip


def _valve_frames() -> Iterator[Harmless]:
    values = ("- 2", "~1")
    yield from begins(
        "valve_frames", "ValveFrames.__init__", "_stated = self._left", values, NO_NEGATIVE, "-1"
    )
    unread = UNREAD.format("it goes with an answer, which sets it")
    init = "ValveFrames.__init__"
    yield from begins("valve_frames", init, "_asked", ("pass",), unread, "gate.output")


def _held_voltages() -> Iterator[Harmless]:
    sent = "def sent(self, voltages: tuple[float, ...], *, told: bool) -> None:"
    yield Harmless(
        "held_voltages", "HeldVoltages.sent", sent, sent.replace("*,", "/,"),
        "every caller names the word, and one that does not is as right",
    )  # fmt: skip
    said = 'return f"the amplifiers took no valve frame for {} * self._patience_s:.0f}} ms"'
    yield from each(
        "held_voltages", "HeldVoltages.complaint", said.format("{1e3"),
        (said.format("{ 1001.0"), said.format("{ 999.0")),
        "whole milliseconds are told, a thousandth of 60 is not",
    )  # fmt: skip
    for before, why in (
        ("held = tuple(zip(*self._frames, strict=True))", "frames are of one codec's valves"),
        (
            "for value, last, of in zip(wanted, before, held, strict=True)",
            "the gate has compared the command's, and all others are as many as its valves",
        ),
    ):
        yield Harmless(
            "held_voltages", "HeldVoltages.towards", before, before.replace("True", "False"),
            LENGTHS.format(why),
        )  # fmt: skip


def _turns() -> Iterator[Harmless]:
    named = "every caller names the word, and one that does not is as right"
    for target, where, before in (
        ("bridge_turns", "BridgeTurns.received", "*,"),
        ("winding_down", "WindingDown.answered", "def answered(self, *, zero: bool) -> None:"),
    ):  # fmt: skip
        yield Harmless(target, where, before, before.replace("*", "/"), named)
    first = "return self.core.receive(frame, {} if arrival is None else arrival.ros_ns)"
    yield from each(
        "bridge_turns", "BridgeTurns._frame", first.format("0"),
        (first.format("-1"), first.format("1")),
        UNREAD.format("it is asked of a first sync frame alone, which has an arrival"),
    )  # fmt: skip


def _amplifier() -> Iterator[Harmless]:
    init = "Amplifier.__init__"
    before = "self._patience = max(1, round(WATCHDOG_S / cycle_s))"
    yield Harmless(
        "amplifier", init, before, before.replace("(1,", "( 0,"),
        "a missing frame is counted before it is compared: none and one are the same patience",
    )  # fmt: skip
    yield from begins("amplifier", init, "_missing", ("-1", "1"), DRIVING_FIRST)
    yield Harmless(
        "amplifier", "Amplifier._off", "self._queue.extend([self._zero] * self._delay)", "pass",
        "until the queue has filled again the output stays at the 0 V that it was switched to",
    )  # fmt: skip


def _assembler() -> Iterator[Harmless]:
    init = "Assembler.__init__"
    why = UNREAD.format("no frame is taken before the first sync frame, which sets it")
    for name, first, values in (
        ("_kind", "CycleKind.NEW", ("pass",)),
        ("_data: dict[str, bytes]", "{}", ("pass",)),
        ("_first_try", "True", ("pass", "False")),
        ("_leapt: int | None", "None", ("pass",)),
        ("_idle", "False", ("pass", "True")),
        ("_spoilt_sync", "False", ("pass", "True")),
    ):
        yield from begins("assembler", init, name, values, why, first)
    why = "the first cycle takes one from it and leaves none below 0: it begins with 0"
    yield from begins("assembler", init, "_wary", ("-1", "1"), why)
    rest = " if self.counter is None else (counter - self.counter) % _WRAP"
    afters = (f"ahead = -1{rest}", f"ahead = 1{rest}")
    why = "the first sync frame begins a cycle, and nothing that is at most 1 ahead was lost"
    yield from each("assembler", "Assembler._sync", f"ahead = 0{rest}", afters, why)


def _sample_clock() -> Iterator[Harmless]:
    init = "SampleClock.__init__"
    given = "def __init__(self, period_ns: int, *, whole_seconds: bool = False) -> None:"
    yield Harmless(
        "sample_clock", init, given, given.replace("*", "/"),
        "the bridge's core says what the word means",
    )  # fmt: skip
    why = UNREAD.format("no counter is extended before `start`, which sets it")
    yield from begins("sample_clock", init, "_last", ("pass", "-1", "1"), why)
    ahead = "self._last += (counter - self._last + _HALF) % _WRAP - _HALF"
    yield Harmless(
        "sample_clock", "SampleClock.extend", ahead, ahead.replace("+ _HALF", "- _HALF"),
        HALF_A_WRAP,
    )  # fmt: skip


def _claims() -> Iterator[Harmless]:
    listen = "def _listen(self, duration_s: float, *, claiming: bool) -> None:"
    yield Harmless(
        "claims", "Claim._listen", listen, listen.replace("*", "/"),
        "a private function, whose callers say what the word means",
    )  # fmt: skip
    other = "if other != self.instance and (not claiming or other < self.instance):"
    yield Harmless(
        "claims", "Claim._listen", other, other.replace("other <", "other <="),
        "an instance of the same number has been left out just before",
    )  # fmt: skip


def _calibration_session() -> Iterator[Harmless]:
    due = "if now - self._claimed_at {} CLAIM_PERIOD_S:"
    yield Harmless(
        "calibration_session", "Session.cycles", due.format(">"), due.format(">="),
        "a clock's reading is not exactly at the limit but by chance, and may be either then",
    )  # fmt: skip


HARMLESS: tuple[Harmless, ...] = (
    *_gate(),
    *_permissives(),
    *_driven_cycles(),
    *_output_ramp(),
    *_plausibility(),
    *_side_readings(),
    *_bridge_core(),
    *_supervision(),
    *_period_watch(),
    *_period_words(),
    *_command_intake(),
    *_valve_frames(),
    *_held_voltages(),
    *_turns(),
    *_amplifier(),
    *_assembler(),
    *_sample_clock(),
    *_claims(),
    *_calibration_session(),
    *OF_CONTROL,
)
