"""What is wrong with a recording's signals: stuck, saturated, out of range, latched.

Findings are plain sentences with numbers; nothing is repaired.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from hydro_ident.bag.ends import Ends
from hydro_ident.bag.gaps import GapCount
from hydro_ident.bag.reading_rate import SecondLook
from hydro_ident.bag.recorded_run import Recording
from hydro_ident.bag.stamp_jitter import StampJitter
from hydro_ident.inspecting.mistaken_inputs import mistaken_voltages
from hydro_ident.inspecting.mistaken_pressures import mistaken_pressures
from hydro_ident.inspecting.signal_look import FULL_SHARE, SignalLook, look_at, parts_of
from hydro_ident.logs.plausible import rate_warning

#: A noisy transducer never repeats its reading this long, an encoder not while its valve is open.
STUCK_S = 1.0
#: Signals may touch a joint limit by an encoder's noise.
_LIMIT_MARGIN = 1e-3
#: Below this share of the samples the end of a range was touched: single peaks of commands, spikes
#: of transducers, which the filters spread over too few rows to move a fit. It is told all the
#: same: a controller that clips, or a range that is too small, begins so.
_TOUCHED = 1e-3
#: Longer than this, all together, it is worth a look in however long a recording.
_BRIEF_S = 0.1


@dataclass(frozen=True, slots=True)
class Finding:
    """One irregularity.

    Attributes
    ----------
    signal : str
        What it is about, e.g. `lift_cylinder/a`.
    kind : str
        `unit`, `stuck`, `saturated`, `limit`, `range`, `not_finite`, `latched`, `interpolated`,
        `held`, `jitter`, `gap`, `unused` (messages), `apart` (joints and pressures begin or end),
        or `other`: the bag names another robot, or was recorded with another calibration or
        mapping than the first of several.
    text : str
        In words, with numbers.
    harmless : bool
        Worth knowing, and nothing that makes a recording worse.
    """

    signal: str
    kind: str
    text: str
    harmless: bool = False


def find_irregularities(recording: Recording) -> list[Finding]:
    """Look over a recording's signals.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    list of Finding
        Empty for a healthy recording.
    """
    gaps, look = GapCount(), look_at(recording)
    gaps.add(recording.gaps)
    second, jitter = SecondLook(look.changes, recording.period_s), StampJitter(recording.period_s)
    for part in parts_of(recording):
        second.add(part)
        jitter.add(part)
    return irregularities(look, (second, jitter), gaps, recording.dead, recording.ends)


def irregularities(
    look: SignalLook,
    against: tuple[SecondLook, StampJitter],
    gaps: GapCount,
    dead: Mapping[str, float],
    ends: Ends,
) -> list[Finding]:
    """What two looks at a recording's signals found.

    Parameters
    ----------
    look : SignalLook
    against : SecondLook and StampJitter
        What a second look counts against the period that the first one found.
    gaps : GapCount
        Of the cycles.
    dead : mapping of str to float
    ends : Ends
        As of `Recording`.

    Returns
    -------
    list of Finding
    """
    second, jitter = against
    period_s = second.period_s
    return [
        *_gaps(gaps, look.first_ns),
        *_interpolated(second),
        *_jitter(jitter),
        *_latched(look, period_s),
        *_joints(look, period_s),
        *_units(look, period_s, dead),
        *_pressures(look, period_s, dead),
        *_valves(look, period_s),
        *(Finding(topic, "apart", text) for topic, text in ends.told(period_s)),
    ]


def _gaps(gaps: GapCount, first_ns: int) -> list[Finding]:
    longest = gaps.told(first_ns)
    if longest is None:
        return []
    text = (
        f"{gaps.count} gap{'s' if gaps.count > 1 else ''}, {gaps.missing} cycles missing; the"
        f" longest, {longest.length_s:.3f} s ({longest.missing} cycles), after"
        f" {longest.after_s:.3f} s"
    )
    return [Finding("cycles", "gap", text)]


def _interpolated(second: SecondLook) -> list[Finding]:
    every = second.every()
    found = [] if every == 1 else [Finding("cycles", "interpolated", second.text(every))]
    return [*found, *(Finding(held.name, "held", held.text) for held in second.held())]


def _jitter(jitter: StampJitter) -> list[Finding]:
    if not jitter.uneven:
        return []
    of_readings = jitter.of_readings
    text = {
        True: "readings were taken at them: they are interpolated to even times before use",
        False: "readings were taken at even times: they are used as such",
        None: "readings do not tell whether they were taken at them: they are used as even",
    }[of_readings]
    return [Finding("cycles", "jitter", f"{jitter.text}; {text}", harmless=not of_readings)]


def _latched(look: SignalLook, period_s: float) -> list[Finding]:
    latched = look.latched
    if not latched.count:
        return []
    text = (
        f"the gate held 0 V against the command for {latched.cycles * period_s:.2f} s in"
        f" {latched.count} spans, first at {look.seconds(latched.first_ns):.2f} s"
    )
    return [Finding("valves", "latched", text)]


def _joints(look: SignalLook, period_s: float) -> Iterator[Finding]:
    spans, robot = look.spans["q"], look.robot
    with_valves = {valve.cylinder for valve in robot.valves if "valve_v" in look.spans}
    driven = {c.joint for c in robot.cylinders if c.name in with_valves}
    for i, joint in enumerate(robot.joints):
        if not spans.there[i]:
            continue
        yield from _not_finite(joint.name, look.cycles - int(spans.finite[i]))
        below, above = spans.least[i], spans.most[i]
        if below < joint.lower - _LIMIT_MARGIN or above > joint.upper + _LIMIT_MARGIN:
            text = (
                f"from {below:.4f} to {above:.4f}, outside its limits"
                f" {joint.lower:.4f} to {joint.upper:.4f}"
            )
            yield Finding(joint.name, "limit", text)
        if joint.name in driven:
            held = look.held["q"][i]
            when = " although its valve was open"
            yield from _stuck(look, joint.name, (held.longest, held.since_ns), period_s, when)


def _units(look: SignalLook, period_s: float, dead: Mapping[str, float]) -> list[Finding]:
    pressures = mistaken_pressures(look.robot, look.spans, dead)
    rate = rate_warning(look.robot, period_s)
    voltages = mistaken_voltages(look.robot, look.spans)
    return [
        *([Finding("cycles", "unit", rate)] if rate else []),
        *([] if pressures is None else [Finding(pressures[0], "unit", pressures[1])]),
        *([Finding("valves", "unit", voltages)] if voltages else []),
    ]


def _pressures(look: SignalLook, period_s: float, dead: Mapping[str, float]) -> Iterator[Finding]:
    robot, count = look.robot, look.cycles
    read = {name: (kind, i) for name, kind, i in look.pressures()}
    # Dead transducers' columns are not looked at; what they read says why.
    for name in dict.fromkeys((*read, *(name for name in dead if "/" in name))):
        if name in dead:
            low_pa = dead[name]
            stretch = count - 1, look.second_ns
            full = count if low_pa >= FULL_SHARE * robot.sensors.pressure_range_pa else 0
            void = count if low_pa < -robot.atmospheric_pressure_pa else 0
        else:
            kind, i = read[name]
            low_pa, held = float(look.spans[kind].least[i]), look.held[kind][i]
            stretch = held.longest, held.since_ns
            full, void = int(look.full[kind][i]), int(look.void[kind][i])
            yield from _not_finite(name, count - int(look.spans[kind].finite[i]))
        yield from _stuck(look, name, stretch, period_s)
        yield from _ends(look, name, (full, void, low_pa), period_s)


def _ends(
    look: SignalLook, name: str, seen: tuple[int, int, float], period_s: float
) -> Iterator[Finding]:
    """Of a pressure: samples at the end of its range, those below vacuum, the lowest in Pa."""
    full, void, low_pa = seen
    if full:
        full_bar = look.robot.sensors.pressure_range_pa / 1e5
        where = f"at the end of its range ({full_bar:.0f} bar)"
        yield _part(look, (name, "saturated"), full, where, period_s)
    if void:
        low_bar = (low_pa + look.robot.atmospheric_pressure_pa) / 1e5
        where = (
            f"below vacuum (down to {low_bar:.2f} bar absolute):"
            " gauge recorded as absolute, or a zero that is off"
        )
        yield _part(look, (name, "range"), void, where, period_s)


def _valves(look: SignalLook, period_s: float) -> Iterator[Finding]:
    if "valve_v" in look.spans:
        for valve, full in zip(look.robot.valves, look.full["valve_v"], strict=True):
            if full:
                where = f"at {valve.rated_voltage_v:g} V"
                yield _part(look, (valve.name, "saturated"), int(full), where, period_s)


def _part(
    look: SignalLook, what: tuple[str, str], count: int, where: str, period_s: float
) -> Finding:
    """Of a signal, and a kind, that is somewhere in `count` samples: a share, or how many."""
    share = count / look.cycles
    if share >= _TOUCHED:
        return Finding(*what, f"{share:.1%} of the time {where}")
    text = f"{count} of {look.cycles} samples {where}"
    return Finding(*what, text, harmless=count * period_s < _BRIEF_S)


def _not_finite(name: str, count: int) -> list[Finding]:
    text = f"{count} samples are not finite or beyond any physical size"
    return [Finding(name, "not_finite", text)] if count else []


def _stuck(
    look: SignalLook, name: str, stretch: tuple[int, int], period_s: float, when: str = ""
) -> list[Finding]:
    """Of the longest stretch of bit-identical readings: how many, and the first one's stamp."""
    length, since_ns = stretch
    if not length or length < STUCK_S / period_s:
        return []
    text = f"unchanged for {length * period_s:.2f} s from {look.seconds(since_ns):.2f} s on{when}"
    return [Finding(name, "stuck", text)]
