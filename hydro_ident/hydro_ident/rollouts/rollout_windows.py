"""Windows of recordings to roll a robot out over, and the roll-outs themselves.

A window gives the model the recorded valve voltages (and supply and tank pressure where recorded;
the joint torques of joints without cylinder) and the state at its first sample, and nothing else.
What the model remembers of the time before, commands on their way and internal states of effects,
it has from what was recorded then.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from hydro_ident.estimate.scoring.scores import HoldOut
from hydro_ident.estimate.signals.derivatives import FilterSettings, motion
from hydro_ident.estimate.signals.traces import Trace
from hydro_model.arrays import BoolArray
from hydro_model.effects import resolve, with_changes
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.robot import FloatArray, Robot

if TYPE_CHECKING:
    from hydro_model.simulation.simulate import Rollout

#: A roll-out is restarted after at most this long; shorter pieces than `SHORTEST_S` say nothing.
WINDOW_S, SHORTEST_S = 3.0, 0.5
#: Samples at the ends of a trace, and beside an impact, whose velocity the filter does not know
#: well.
_EDGE_S = 0.1
#: A piston is at a stop within this share of its stroke of either end.
STOP_SHARE = 1e-3
#: Internal states of effects follow what was recorded before a window, for at most so long: what
#: rings at 1 Hz with a thirtieth of its critical damping has half left of it then.
LEAD_S = 4.0


@dataclass(frozen=True, slots=True)
class Piece:
    """Samples of a trace to roll out from the first on.

    Attributes
    ----------
    trace : Trace
    begin, end : int
    velocity : (N, n) array
        Of the joints, over the whole trace.
    since : int
        First sample from which up to `begin` everything is known as well.
    """

    trace: Trace
    begin: int
    end: int
    velocity: FloatArray
    since: int

    @property
    def where(self) -> str:
        """Name of the recording and begin, for messages."""
        name = self.trace.label.rsplit("#", 1)[0]
        return f"{name} from {self.trace.time_s[self.begin]:.2f} s on"

    @property
    def seconds(self) -> float:
        """Its length."""
        return (self.end - self.begin) * self.trace.step_s


def usable_pieces(robot: Robot, trace: Trace, filters: FilterSettings) -> list[Piece]:
    """Stretches of a trace in which everything that a roll-out needs was recorded.

    And no piston was at a stop, which no model has.
    """
    from hydro_ident.bag.grid import runs

    known: BoolArray = np.asarray(np.isfinite(trace.q).all(axis=1) & ~at_stops(robot, trace))
    for values in (trace.valve_signal, trace.p_a, trace.p_b):
        known = np.asarray(known & np.isfinite(values).all(axis=1))
    dry = trace.joint_torque[:, list(robot.dry_joints)]
    known = np.asarray(known & np.isfinite(dry).all(axis=1))
    if not known.any() or not np.isfinite(trace.q).all():
        return []
    if trace.samples * trace.step_s < SHORTEST_S + 2.0 * _EDGE_S:
        return []
    _, velocity, _ = motion(trace.q, trace.step_s, filters.borne_at(trace.step_s))
    edge = math.ceil(_EDGE_S / trace.step_s)
    # A velocity that the filter does not know well does for what came before.
    first = edge if not known[:edge].all() else 0
    known[:edge] = known[trace.samples - edge :] = False
    least = round(SHORTEST_S / trace.step_s)
    return [
        Piece(trace, a, b, velocity, first if a == edge else a)
        for a, b in runs(known)
        if b - a >= least
    ]


def at_stops(robot: Robot, trace: Trace) -> BoolArray:
    """Samples about which some piston is at an end of its stroke, (N,).

    Parameters
    ----------
    robot : Robot
    trace : Trace
    """
    touched = np.zeros(trace.samples, dtype=np.bool_)
    for cylinder in robot.cylinders:
        x = stroke(cylinder, trace.q[:, robot.joint_index(cylinder.joint)])
        reach = STOP_SHARE * cylinder.stroke_m
        touched |= (x <= reach) | (x >= cylinder.stroke_m - reach)
    if not touched.any():
        return touched
    edge = math.ceil(_EDGE_S / trace.step_s)
    near = np.convolve(touched.astype(float), np.ones(2 * edge + 1))
    return np.asarray(near[edge : edge + trace.samples] > 0.5)


def windows(
    piece: Piece, split: HoldOut, window_s: float = WINDOW_S, held: bool = True
) -> list[Piece]:
    """Held-out stretches of a piece, or the others, in equal parts of at most `window_s`.

    Parameters
    ----------
    piece : Piece
    split : HoldOut
        Where it holds out nothing, every stretch is one of either kind.
    window_s : float
    held : bool
    """
    from hydro_ident.bag.grid import runs

    trace = piece.trace
    mask = np.ones(piece.end - piece.begin, dtype=bool)
    if split.every:
        time_s = trace.time_s[piece.begin : piece.end]
        mask = np.asarray(split.holds(trace.recording, time_s) == held)
    least = round(SHORTEST_S / trace.step_s)
    found = []
    for a, b in runs(mask):
        count = max(1, math.ceil((b - a) * trace.step_s / window_s))
        ends = np.linspace(a, b, count + 1).round().astype(int) + piece.begin
        found += [
            replace(piece, begin=int(s), end=int(e)) for s, e in pairwise(ends) if e - s >= least
        ]
    return found


def spread(pieces: Sequence[Piece], most: int) -> list[Piece]:
    """At most `most` of the windows, evenly spread: a day's bag needs no more."""
    if len(pieces) <= most:
        return list(pieces)
    return [pieces[k * len(pieces) // most] for k in range(most)]


def rolled_out(
    robot: Robot,
    piece: Piece,
    start: tuple[FloatArray, FloatArray, FloatArray] | None = None,
) -> Rollout:
    """The robot over a piece.

    Parameters
    ----------
    robot : Robot
    piece : Piece
    start : ((n,), (n,), (m, 2)) arrays, optional
        Positions, velocities and pressures; by default as recorded.

    Raises
    ------
    SimulationError
        It cannot be integrated.
    """
    from hydro_model.simulation.simulate import simulate

    trace, lead = piece.trace, _lead(robot, piece)
    at = slice(piece.begin - lead, piece.end)
    rated = [robot.valve_of(c.name).rated_voltage_v for c in robot.cylinders]
    rolled = simulate(
        robot,
        trace.time_s[at],
        trace.valve_signal[at] * np.array(rated),
        *_seen(piece, lead, start),
        supply=_measured(trace.supply[at], robot.supply_pressure_pa),
        tank=_measured(trace.tank[at], robot.tank_pressure_pa),
        torque=_driving_torque(robot, trace.joint_torque[at]),
        oil_c=None if trace.oil_c is None else trace.oil_c[at],
    )
    own = {f.name: getattr(rolled, f.name)[lead:] for f in fields(rolled) if f.name != "steps"}
    return replace(rolled, **own)


def _lead(robot: Robot, piece: Piece) -> int:
    """Samples before a piece of which the robot remembers something."""
    seconds = LEAD_S
    if not any(one.effect.states for one in resolve(robot)):
        changed = with_changes(robot)
        own = (v.command_delay_s for v in changed.valves)
        seconds = changed.command_delay_s + max(own, default=0.0)
    # The command that acts at the first sample may have been sent within an interval before.
    count = math.ceil(seconds / piece.trace.step_s) + 1 if seconds > 0.0 else 0
    return min(count, piece.begin - piece.since)


def _seen(
    piece: Piece, lead: int, start: tuple[FloatArray, FloatArray, FloatArray] | None
) -> list[FloatArray]:
    """Positions, velocities and pressures before a piece and at its first sample."""
    trace, rows = piece.trace, slice(piece.begin - lead, piece.begin + 1)
    pressures = np.stack([trace.p_a[rows], trace.p_b[rows]], axis=2)
    seen = [np.array(values) for values in (trace.q[rows], piece.velocity[rows], pressures)]
    for own, first in zip(seen, start or (), strict=False):
        own[-1] = first
    return seen


def _driving_torque(robot: Robot, seen: FloatArray) -> FloatArray:
    """Joint torques (N, n) that hold over the intervals, from readings at the samples.

    A reading that is held comes half an interval late, which feeds energy into a model that the
    fits, to whose rows it belongs at its own instant, know nothing of.
    """
    torque, dry = np.zeros((len(seen), robot.dof)), list(robot.dry_joints)
    torque[:, dry] = seen[:, dry]
    torque[:-1] = 0.5 * (torque[:-1] + torque[1:])
    return torque


def _measured(pressure: FloatArray, constant_pa: float) -> FloatArray | None:
    """A rail as recorded; None where it is the robot file's constant, on which effects act."""
    return None if bool(np.all(pressure == constant_pa)) else pressure
