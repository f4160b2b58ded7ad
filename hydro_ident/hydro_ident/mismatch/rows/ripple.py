"""What reading pressures once per command makes of a force: the ripple of a held signal.

A valve's signal u is held over an interval h, while the motion asks for a ramp: held minus ramp is
a saw tooth of the height of the change per interval D. Its flow q' (held - ramp), per unit of the
signal q', fills the chamber's volume V, so that the pressure swings about its mean by

    r(phase) = (B / V) q' D (phase / 2 - phase^2 / (2 h) - h / 12),

and a sensor that reads at one phase of every interval (that of the stamps, in step with the
commands) is off by as much, B / V q' D times a time of up to h / 12. The mass does not feel it: it
is far too quick. What multiplies the column below is fitted, cylinder by cylinder, with the base.

In a motion of few frequencies the column looks like what depends on the position, gravity in a
tilted base say, and free to be anything it would take that. Stamps and commands in step, the
phase is the command's delay within its interval, and the coefficient follows from B: where the
fit does not speak against that it is known beforehand. Where it speaks for no ripple at all
(a signal that is not held, a sensor that averages) that is known. Another possible one stays
free, as the reading's phase is not known then; an impossible one is something else's doing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_ident.estimate.signals.traces import Trace
from hydro_model.hydraulics.cylinder import chamber_volumes
from hydro_model.hydraulics.valve import edge_flows
from hydro_model.robot import FloatArray, Robot

#: Volumes are taken to be no less than this share of what the piston sweeps.
_LEAST_VOLUME = 0.02
#: No oil is stiffer.
_STIFFEST_PA = 2.5e9
#: A fitted coefficient speaks against one that is further than so many deviations.
_DEVIATIONS = 3.0
#: What the phase is known to, as a share of the largest ripple.
_KNOWN = 0.1


def ripple_name(cylinder: str) -> str:
    """What the coefficient of a cylinder's ripple is called; in Pa s."""
    return f"{cylinder}.pressure_ripple"


def largest_ripple(cycle_s: float) -> float:
    """Bound of a ripple's coefficient for commands at such an interval, Pa s."""
    return _STIFFEST_PA * cycle_s / 12.0


def held_ripple(modulus_pa: float, delay_s: float, cycle_s: float) -> float:
    """Coefficient of readings in step with the commands, Pa s.

    Parameters
    ----------
    modulus_pa : float
    delay_s : float
        Of the command; the phase is what is left of it within an interval.
    cycle_s : float
        Interval of commands and readings.
    """
    phase = delay_s % cycle_s
    return modulus_pa * (phase / 2.0 - phase**2 / (2.0 * cycle_s) - cycle_s / 12.0)


def in_step(valve_signals: Sequence[FloatArray]) -> bool:
    """Whether commands change with every reading, where they change.

    Of commands that are held over several readings the phase differs from one to the next.

    Parameters
    ----------
    valve_signals : sequence of (N,) array
    """
    changes = [np.flatnonzero(np.diff(u[np.isfinite(u)])) for u in valve_signals]
    gaps = np.concatenate([np.diff(at) for at in changes]) if changes else np.zeros(0)
    return bool(gaps.size and np.median(gaps) == 1.0)


def known_ripple(
    fitted: float, std: float, modulus_pa: float, delay_s: float, cycle_s: float
) -> tuple[float, float] | None:
    """A ripple's coefficient and its deviation beforehand, Pa s; None where nothing is known.

    Parameters
    ----------
    fitted, std : float
        Coefficient of a fit that is free to choose it, and its deviation.
    modulus_pa, delay_s, cycle_s : float
        As `held_ripple`.
    """
    unit = modulus_pa * cycle_s / 12.0
    held = held_ripple(modulus_pa, delay_s, cycle_s)
    nearer = min((held, 0.0), key=lambda value: abs(fitted - value))
    if abs(fitted - nearer) <= _DEVIATIONS * std:
        return nearer, _KNOWN * unit
    possible = -unit <= fitted <= 0.5 * unit
    return None if possible else (held, _KNOWN * unit)


def ripple_force(robot: Robot, index: int, trace: Trace) -> FloatArray:
    """Force of a cylinder's ripple per unit of modulus times time, (N,); 0 where not known.

    Parameters
    ----------
    robot : Robot
        With current edges.
    index : int
        Of the cylinder.
    trace : Trace
    """
    cylinder = robot.cylinders[index]
    u = trace.valve_signal[:, index]
    sign = np.where(u >= 0.0, 1.0, -1.0)
    p_a, p_b = trace.p_a[:, index], trace.p_b[:, index]
    flows = edge_flows(robot.valve_of(cylinder.name), sign, p_a, p_b, trace.supply, trace.tank)
    volumes = chamber_volumes(cylinder, trace.stroke[:, index])
    areas = cylinder.area_a_m2, cylinder.area_b_m2
    least = _LEAST_VOLUME * cylinder.stroke_m
    a, b = (
        area * flow * sign / np.maximum(volume, least * area)
        for area, flow, volume in zip(areas, flows, volumes, strict=True)
    )
    force = (a - b) * np.gradient(u)
    return np.where(np.isfinite(force), force, 0.0)
