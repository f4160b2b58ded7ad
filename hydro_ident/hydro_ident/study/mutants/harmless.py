"""Changes that no test can or need notice, each with the reason."""

from __future__ import annotations

from collections.abc import Iterator

from hydro_ident.study.mutants.listed import Harmless

_UNREAD = "the first value is never read: {}"
_NO_NEGATIVE = "counters begin at 0: any number below stands for none of them"
_HALF_A_WRAP = "half a wrap ahead and half a wrap back are the same place of a wrap"
_LENGTHS = "the lengths are equal by then: {}"
_DRIVING_FIRST = "it is read while driving alone, and what begins to drive sets it"


def _each(
    target: str, where: str, before: str, afters: tuple[str, ...], why: str
) -> Iterator[Harmless]:
    for after in afters:
        yield Harmless(target, where, before, after, why)


def _begins(
    target: str, where: str, name: str, values: tuple[str, ...], why: str, first: str = "0"
) -> Iterator[Harmless]:
    """An assignment in a constructor with other values; `pass`: without it."""
    before = f"self.{name} = {first}"
    afters = tuple("pass" if value == "pass" else f"self.{name} = {value}" for value in values)
    yield from _each(target, where, before, afters, why)


def _gate() -> Iterator[Harmless]:
    init = "Gate.__init__"
    no_defect = _UNREAD.format("it belongs to a defect, and there is none yet")
    yield from _begins("gate", init, "_defect_at", ("-1", "1"), no_defect)
    yield from _begins("gate", init, "_first", ("-1",), _NO_NEGATIVE)
    yield from _begins("gate", init, "_accepted", ("pass", "-1", "1"), _DRIVING_FIRST)
    yield from _begins("gate", init, "_command", ("pass",), _DRIVING_FIRST, "self._zero")
    end = " if self._newest is None else self._newest"
    yield Harmless(
        "gate", "Gate.arm", f"self._first = 0{end}", f"self._first = -1{end}", _NO_NEGATIVE
    )
    yield from _begins("gate", "Gate.forget", "_first", ("-1",), _NO_NEGATIVE)
    yield Harmless(
        "gate", "Gate.trip", "self._wait()", "pass",
        "while tripped the output is 0 V whatever was asked before, and clearing waits first",
    )  # fmt: skip
    yield Harmless(
        "gate", "Gate._follow", "return Outcome.ACCEPTED", "pass",
        "after the stop at 0 V the rate is judged from 0 V to 0 V: accepted again, the same",
    )  # fmt: skip
    judged = _LENGTHS.format("`_judge` has compared them")
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
            _UNREAD.format("it is asked while driving alone, and the newest cycle is known then"),
        )  # fmt: skip


def _output_ramp() -> Iterator[Harmless]:
    init = "OutputRamp.__init__"
    for after in ("pass", "self.begin( -1)", "self.begin( 1)"):
        yield Harmless("output_ramp", init, "self.begin(0)", after, _DRIVING_FIRST)
    before = "for value, before in zip(values, self.applied_v, strict="
    yield Harmless(
        "output_ramp", "OutputRamp.follow", f"{before}True)", f"{before}False)",
        _LENGTHS.format("the gate has compared them"),
    )  # fmt: skip


def _plausibility() -> Iterator[Harmless]:
    why = _UNREAD.format("it is the time of the last readings, and there are none yet")
    yield from _begins("plausibility", "ReadingsWatch.forget", "_at", ("-1", "1"), why)
    yield Harmless(
        "plausibility", "ReadingsWatch._jump", 'return ""', "pass",
        "None is as empty as the text: the encoders are looked at next, which give a text",
    )  # fmt: skip


def _side_readings() -> Iterator[Harmless]:
    first = "self._still_at_m = [{}] * len(self._cylinders)"
    why = _UNREAD.format("the first cycle of all sets it")
    afters = (first.format(" -1.0"), first.format(" 1.0"))
    yield from _each("side_readings", "SideWatch.forget", first.format("0.0"), afters, why)
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
    for name, words, why in (
        ("sync", "sync: Frame, counter: int", "the bridge's core says what the word means"),
        ("paced", "counter: int, at_s: float", "the bridge's core says what the word means"),
        ("_check", "status: Status, supply_pa: float", private),
        ("_stands", "name: str, reason: str", private),
    ):
        head = f"def {name}(self, {words}, *, active: bool) -> None:"
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
    yield from _begins(
        "valve_frames", "ValveFrames.__init__", "_stated = self._left", values, _NO_NEGATIVE, "-1"
    )
    unread = _UNREAD.format("it goes with an answer, which sets it")
    init = "ValveFrames.__init__"
    yield from _begins("valve_frames", init, "_asked", ("pass",), unread, "gate.output")


def _held_voltages() -> Iterator[Harmless]:
    sent = "def sent(self, voltages: tuple[float, ...], *, told: bool) -> None:"
    yield Harmless(
        "held_voltages", "HeldVoltages.sent", sent, sent.replace("*,", "/,"),
        "every caller names the word, and one that does not is as right",
    )  # fmt: skip
    said = 'return f"the amplifiers took no valve frame for {} * self._patience_s:.0f}} ms"'
    yield from _each(
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
            _LENGTHS.format(why),
        )  # fmt: skip


def _turns() -> Iterator[Harmless]:
    named = "every caller names the word, and one that does not is as right"
    for target, where, before in (
        (
            "bridge_turns", "BridgeTurns.received",
            "self, frame: Frame | None, arrival: Arrival | None, now_s: float, *, idle: bool",
        ),
        (
            "bridge_turns", "BridgeTurns._silence",
            "def _silence(self, now_s: float, *, idle: bool) -> Step:",
        ),
        ("winding_down", "WindingDown.answered", "def answered(self, *, zero: bool) -> None:"),
    ):  # fmt: skip
        yield Harmless(target, where, before, before.replace("*", "/"), named)
    first = "return self.core.receive(frame, {} if arrival is None else arrival.ros_ns)"
    yield from _each(
        "bridge_turns", "BridgeTurns._frame", first.format("0"),
        (first.format("-1"), first.format("1")),
        _UNREAD.format("it is asked of a first sync frame alone, which has an arrival"),
    )  # fmt: skip


def _amplifier() -> Iterator[Harmless]:
    init = "Amplifier.__init__"
    before = "self._patience = max(1, round(WATCHDOG_S / cycle_s))"
    yield Harmless(
        "amplifier", init, before, before.replace("(1,", "( 0,"),
        "a missing frame is counted before it is compared: none and one are the same patience",
    )  # fmt: skip
    yield from _begins("amplifier", init, "_missing", ("-1", "1"), _DRIVING_FIRST)
    yield Harmless(
        "amplifier", "Amplifier._off", "self._queue.extend([self._zero] * self._delay)", "pass",
        "until the queue has filled again the output stays at the 0 V that it was switched to",
    )  # fmt: skip


def _assembler() -> Iterator[Harmless]:
    init = "Assembler.__init__"
    why = _UNREAD.format("no frame is taken before the first sync frame, which sets it")
    for name, first, values in (
        ("_kind", "CycleKind.NEW", ("pass",)),
        ("_data: dict[str, bytes]", "{}", ("pass",)),
        ("_first_try", "True", ("pass", "False")),
        ("_leapt: int | None", "None", ("pass",)),
        ("_idle", "False", ("pass", "True")),
        ("_spoilt_sync", "False", ("pass", "True")),
    ):
        yield from _begins("assembler", init, name, values, why, first)
    why = "the first cycle takes one from it and leaves none below 0: it begins with 0"
    yield from _begins("assembler", init, "_wary", ("-1", "1"), why)
    rest = " if self.counter is None else (counter - self.counter) % _WRAP"
    afters = (f"ahead = -1{rest}", f"ahead = 1{rest}")
    why = "the first sync frame begins a cycle, and nothing that is at most 1 ahead was lost"
    yield from _each("assembler", "Assembler._sync", f"ahead = 0{rest}", afters, why)


def _sample_clock() -> Iterator[Harmless]:
    init = "SampleClock.__init__"
    given = "def __init__(self, period_ns: int, *, whole_seconds: bool = False) -> None:"
    yield Harmless(
        "sample_clock", init, given, given.replace("*", "/"),
        "the bridge's core says what the word means",
    )  # fmt: skip
    why = _UNREAD.format("no counter is extended before `start`, which sets it")
    yield from _begins("sample_clock", init, "_last", ("pass", "-1", "1"), why)
    ahead = "self._last += (counter - self._last + _HALF) % _WRAP - _HALF"
    yield Harmless(
        "sample_clock", "SampleClock.extend", ahead, ahead.replace("+ _HALF", "- _HALF"),
        _HALF_A_WRAP,
    )  # fmt: skip


def _runaway() -> Iterator[Harmless]:
    watch, ends = "RunawayWatch", "_driven_range"
    why = _UNREAD.format("with the first sample driving begins, which sets it")
    yield from _begins("runaway", f"{watch}.__init__", "_in_a_row", ("pass", "-1", "1"), why)
    judge = "def judge(self, stamp_s: float, q: FloatArray, *, driven: bool) -> str:"
    yield Harmless(
        "runaway", f"{watch}.judge", judge, judge.replace("*", "/"),
        "the controller's core says what the word means",
    )  # fmt: skip
    for looking in ("_beyond", "_too_fast"):
        yield Harmless(
            "runaway", f"{watch}.{looking}", 'return ""', "pass",
            "None is as empty as the text: it is only asked whether there is anything",
        )  # fmt: skip
    fast = "if tip_speed > self._tip_fastest:"
    yield Harmless(
        "runaway", f"{watch}._too_fast", fast, fast.replace(">", ">="),
        "a root of squares is not exactly a limit but by chance, and may be either then",
    )  # fmt: skip
    grid = "by a step of a hundredth of the reach more or less, it ends before the lever does"
    yield from _each("runaway", "", "_STEPS = 100", ("_STEPS = 101", "_STEPS = 99"), grid)
    short = "short = arm {} np.sign(arm[{}]) {} SHORTEST_LEVER_M"
    before = short.format("*", "0", "<")
    yield Harmless(
        "runaway", ends, before, short.format("*", " 1", "<"),
        "a lever of 5 mm and more does not turn over within a hundredth of the reach",
    )  # fmt: skip
    yield Harmless(
        "runaway", ends, before, short.format("/", "0", "<"),
        "divided by 1 or -1 is multiplied by it",
    )  # fmt: skip
    yield Harmless(
        "runaway", ends, before, short.format("*", "0", "<="),
        "a lever computed along a grid is not exactly 5 mm but by chance, and may be either then",
    )  # fmt: skip


def _following_error() -> Iterator[Harmless]:
    judge = "self, stamp_s: float, q: FloatArray, q_d: FloatArray, epoch: int, *, held: bool"
    yield Harmless(
        "following_error", "FollowingWatch.judge", judge, judge.replace("*", "/"),
        "the controller's core says what the word means",
    )  # fmt: skip
    joints = "for i, (far, most) in enumerate(zip(behind, self._most, strict=True)):"
    yield Harmless(
        "following_error", "FollowingWatch.judge", joints, joints.replace("True", "False"),
        _LENGTHS.format("the law has refused positions that are not one of each joint"),
    )  # fmt: skip
    forwards = "since, forwards = self._since[i], far {} 0.0"
    yield Harmless(
        "following_error", "FollowingWatch._stuck", forwards.format(">"), forwards.format(">="),
        "a joint that is further away than it may be is not at 0 from where it shall be",
    )  # fmt: skip


def _doubtful() -> Iterator[Harmless]:
    near = "bound not in (0.0, spec.typical) and abs(value - bound) {} _AT_BOUND * abs(bound)"
    yield Harmless(
        "doubtful", "_at_bound", near.format("<="), near.format("<"),
        "a fit ends at a bound or away from it: exactly a millionth off it may be either",
    )  # fmt: skip
    yield Harmless(
        "doubtful", "_doubt", 'return ""', "pass",
        "None is as empty as the text, and its caller gives the text on",
    )  # fmt: skip
    spanning = (
        "spanning = (i for i, p in enumerate(effect.parameters) if p.lower <= 0.0 {} p.upper)"
    )
    yield Harmless(
        "doubtful", "_sizes", spanning.format("<="), spanning.format("<"),
        "the catalogue has no parameter of which 0 is the highest value",
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


def _sample_join() -> Iterator[Harmless]:
    of_one = "of_rails = tuple(None if rail is None else rail[{}] for rail in rails)"
    yield Harmless(
        "sample_join", "SampleJoin.add_pressures", of_one.format("0"), of_one.format(" -1"),
        "one name was asked for: the first of its values is the last",
    )  # fmt: skip
    yield Harmless(
        "sample_join", "SampleJoin.newest", "return None", "pass",
        "a function that ends without a value gives None, too",
    )  # fmt: skip


def _applied() -> Iterator[Harmless]:
    named = "every caller names the word, and one that does not is as right"
    for where, arguments in (
        ("commanded", "stamp_ns: int, voltage_v: FloatArray"),
        ("_judge", "commanded: FloatArray, applied: FloatArray"),
    ):
        before = f"def {where}(self, {arguments}, *, moving: bool) -> None:"
        after = before.replace("*", "/")
        yield Harmless("applied", f"AppliedWatch.{where}", before, after, named)


def _stamps() -> Iterator[Harmless]:
    off = "if abs(steps - max(1, round(steps))) {} _OFF:"
    yield Harmless(
        "stamps", "StampWatch.follows", off.format(">"), off.format(">="),
        "no number of samples less a whole one is the very float 0.1: it has finer digits",
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
    *_runaway(),
    *_following_error(),
    *_doubtful(),
    *_claims(),
    *_calibration_session(),
    *_sample_join(),
    *_applied(),
    *_stamps(),
)
