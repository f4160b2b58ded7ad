"""The pieces of an effect: laws, the stages they enter at, parameters, internal states.

A law is plain scalar Python in numba's subset, ``law(s, p) -> float``, with `s` the signals of one
cylinder (`hydro_model.effects.signals`) and `p` the effect's parameters in the order of
`Effect.parameters`. It calls nothing but `math` and the built-ins min, max and abs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Protocol


class Row(Protocol):
    """Numbers by index: an array, or a pointer in compiled code."""

    def __getitem__(self, index: int, /) -> float: ...


Law = Callable[[Row, Row], float]


class Stage(Enum):
    """Where in the model a law's value enters, and its unit.

    Every stage but `SIGNAL` adds: laws of one stage are summed. `SIGNAL` laws map the valve
    signal one after the other, in catalogue order. So do flow laws of effects that need the valve:
    each sees the valve's flow with what those before it add (`Effect.needs_valve`).
    """

    FRICTION = "friction"  # N, opposes piston motion
    SIGNAL = "signal"  # valve signal in, valve signal out
    FLOW_A = "flow_a"  # m^3/s, added into chamber A
    FLOW_B = "flow_b"  # m^3/s, added into chamber B
    VOLUME_A = "volume_a"  # m^3, added to chamber A
    VOLUME_B = "volume_b"  # m^3, added to chamber B
    COMPLIANCE_A = "compliance_a"  # 1/Pa, added to 1/beta of chamber A
    COMPLIANCE_B = "compliance_b"  # 1/Pa, added to 1/beta of chamber B
    SUPPLY = "supply"  # Pa, added to the supply pressure of the whole robot
    TANK = "tank"  # Pa, added to the tank pressure of the whole robot


#: Stages of a chamber's balance, by its side.
FLOW = {"a": Stage.FLOW_A, "b": Stage.FLOW_B}
VOLUME = {"a": Stage.VOLUME_A, "b": Stage.VOLUME_B}
COMPLIANCE = {"a": Stage.COMPLIANCE_A, "b": Stage.COMPLIANCE_B}
#: Stages of laws that act once for the robot, not once per cylinder.
ROBOT_STAGES = frozenset({Stage.SUPPLY, Stage.TANK})


@dataclass(frozen=True, slots=True)
class ParameterSpec:
    """A parameter of an effect.

    Attributes
    ----------
    name, unit, text : str
    lower, upper : float
        Physical bounds, inclusive.
    typical : float
        Size on a crane of this class (PHYSICS notes), a start for searches.
    linear : bool
        The laws (or what a `change` does to the force, a `reading` to its channels) are
        proportional to it while the effect's other linear parameters are zero.
    optional : bool
        A robot file may leave it out and then gets the default: shape parameters that few data
        can tell.
    default : float or None
        What a robot file that leaves it out gets; None: `typical`.
    """

    name: str
    unit: str
    text: str
    lower: float
    upper: float
    typical: float
    linear: bool = False
    optional: bool = False
    default: float | None = None

    @property
    def usual(self) -> float:
        """What a robot file that leaves it out gets."""
        return self.typical if self.default is None else self.default

    def left_out(self, value: float) -> bool:
        """Whether a robot file may have left it out: a value of its own is hardly this one."""
        return self.optional and value == self.usual


@dataclass(frozen=True, slots=True)
class Term:
    """One contribution of an effect to the model.

    Attributes
    ----------
    stage : Stage
    law : callable
    """

    stage: Stage
    law: Law


@dataclass(frozen=True, slots=True)
class InternalState:
    """An internal state of an effect.

    Attributes
    ----------
    rate : callable
        Law of its time derivative.
    initial : callable
        Law of its value at rest, from the signals at the start.
    scale : float
        Typical size, for the integrator's error control.
    linear : bool
        Rates of all the effect's states are linear in them, with constant coefficients, and look
        at nothing else that moves between samples: a recording is followed exactly.
    averaged : bool
        Along a recording the effect's laws see the means of linear states until the next sample:
        quicker than the samples, they swing within each in step with the commands.
    after : callable or None
        Law of its value some time later, which has behind the parameters that time, in s, and the
        signals at its end, by their indices: until then `HELD_SIGNALS` are held and the rest moves
        evenly. Where it is known, a recording is followed by it.
    needs : int or None
        Index of a parameter that is zero where no law looks at the state.
    """

    rate: Law
    initial: Law
    scale: float
    linear: bool = False
    averaged: bool = False
    after: Law | None = None
    needs: int | None = None


def nothing(s: Row, p: Row) -> float:
    """The law that is zero: the rest value of many a state."""
    return 0.0
