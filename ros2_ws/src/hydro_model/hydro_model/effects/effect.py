"""What an effect is: a name, an equation, parameters and laws that the whole product shares.

A law is plain scalar Python in numba's subset, ``law(s, p) -> float``, with `s` the signals of one
cylinder (`hydro_model.signals`) and `p` the effect's parameters in the order of
`Effect.parameters`. It is written once: the roll-out calls it compiled, the identification
evaluates it over a recording, the controller compensates it, the report prints its equation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from hydro_model.errors import RobotError
from hydro_model.robot import FloatArray
from hydro_model.signals import SIGNAL_COUNT


class Row(Protocol):
    """Numbers by index: an array, or a pointer in compiled code."""

    def __getitem__(self, index: int, /) -> float: ...


Law = Callable[[Row, Row], float]


class Stage(Enum):
    """Where in the model a law's value enters, and its unit.

    Every stage but `SIGNAL` adds: laws of one stage are summed. `SIGNAL` laws map the valve
    signal one after the other, in catalogue order.
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
        The laws are proportional to it while the effect's other linear parameters are zero.
    optional : bool
        A robot file may leave it out and then gets `typical`: shape parameters that few data
        can tell.
    """

    name: str
    unit: str
    text: str
    lower: float
    upper: float
    typical: float
    linear: bool = False
    optional: bool = False


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
    """

    rate: Law
    initial: Law
    scale: float


@dataclass(frozen=True, slots=True)
class Effect:
    """A named piece of physics.

    Attributes
    ----------
    name : str
        Name of the contract.
    channel : str
        Residual it shows in: ``force``, ``flow`` or ``timing``.
    equation, source : str
        For the report: the law in words of mathematics, and where it is from.
    parameters : tuple of ParameterSpec
    terms : tuple of Term
        What it adds where; the first is the one that names its size.
    looks_like : tuple of str
        What a fit may take for it.
    separating_experiment : str
        The run that tells them apart.
    states : tuple of InternalState
    needs_cylinder : bool
        False where the laws look at the motion alone, so that the effect can act on a joint
        without cylinder, too: piston velocity is then the joint's, and N is N m on a revolute
        joint.
    """

    name: str
    channel: str
    equation: str
    source: str
    parameters: tuple[ParameterSpec, ...]
    terms: tuple[Term, ...]
    looks_like: tuple[str, ...]
    separating_experiment: str
    states: tuple[InternalState, ...] = ()
    needs_cylinder: bool = True

    @property
    def robot_wide(self) -> bool:
        """Acts once for the robot instead of once per cylinder."""
        return self.terms[0].stage in ROBOT_STAGES

    @property
    def typical(self) -> FloatArray:
        """Typical parameter values, in parameter order."""
        return np.array([parameter.typical for parameter in self.parameters])

    def term(self, stage: Stage | None = None) -> Term:
        """Its term at a stage, or the first one; raises RobotError where there is none."""
        if stage is None:
            return self.terms[0]
        for term in self.terms:
            if term.stage is stage:
                return term
        known = ", ".join(t.stage.value for t in self.terms)
        raise RobotError(f"effect '{self.name}' has no {stage.value} law (it has: {known})")

    def values(self, given: Mapping[str, float], where: str) -> FloatArray:
        """Parameter values in order, checked.

        Parameters
        ----------
        given : mapping of str to float
            By parameter name; optional ones may be absent.
        where : str
            Place of the mapping, for messages.

        Raises
        ------
        RobotError
            A name is unknown or missing, or a value is outside its bounds.
        """
        names = [parameter.name for parameter in self.parameters]
        unknown = [name for name in given if name not in names]
        if unknown:
            raise RobotError(
                f"{where}: effect '{self.name}' has no parameter '{unknown[0]}'"
                f" (known: {', '.join(names)})"
            )
        return np.array([self._value(parameter, given, where) for parameter in self.parameters])

    def _value(self, spec: ParameterSpec, given: Mapping[str, float], where: str) -> float:
        if spec.name not in given:
            if spec.optional:
                return spec.typical
            raise RobotError(
                f"{where}: effect '{self.name}' needs parameter '{spec.name}' in {spec.unit}"
            )
        value = float(given[spec.name])
        if not spec.lower <= value <= spec.upper:
            raise RobotError(
                f"{where}: {self.name}.{spec.name} should be {spec.lower:g} to {spec.upper:g}"
                f" {spec.unit}, found {value:g}"
            )
        return value

    def evaluate(
        self,
        signals: ArrayLike,
        parameters: ArrayLike,
        stage: Stage | None = None,
        sample_time_s: float | None = None,
    ) -> FloatArray:
        """One of its laws over a recording.

        Parameters
        ----------
        signals : (N, SIGNAL_COUNT) array
            Columns by `hydro_model.signals`; those the law does not use may hold anything.
        parameters : array
            In the order of `parameters`.
        stage : Stage, optional
            Default: the first term.
        sample_time_s : float, optional
            Needed by effects with internal states, which are integrated from rest at the first
            row with every row held for this long.

        Returns
        -------
        (N,) array
            In the unit of the stage.

        Raises
        ------
        RobotError
            Shapes do not fit, the stage is not one of the effect's, or `sample_time_s` is
            missing.
        """
        from hydro_model.effects.compiled import evaluate_law, integrate_states

        rows, values = self._checked(signals, parameters)
        law = self.term(stage).law
        if self.states:
            if sample_time_s is None:
                raise RobotError(f"effect '{self.name}' has internal states: give sample_time_s")
            rows = integrate_states(self.states, rows, values, sample_time_s)
        return evaluate_law(law, rows, values)

    def columns(
        self, signals: ArrayLike, parameters: ArrayLike, stage: Stage | None = None
    ) -> FloatArray:
        """Regressor columns of its linear parameters at a stage.

        Parameters
        ----------
        signals : (N, SIGNAL_COUNT) array
        parameters : array
            Values of the parameters that are not linear; the linear ones are ignored.
        stage : Stage, optional
            Default: the first term.

        Returns
        -------
        (N, k) array
            One column per linear parameter, in parameter order: the law at its unit.
        """
        rows, values = self._checked(signals, parameters)
        linear = [i for i, parameter in enumerate(self.parameters) if parameter.linear]
        out = np.empty((len(rows), len(linear)))
        for column, index in enumerate(linear):
            unit = values.copy()
            unit[linear] = 0.0
            unit[index] = 1.0
            out[:, column] = self.evaluate(rows, unit, stage)
        return out

    def _checked(self, signals: ArrayLike, parameters: ArrayLike) -> tuple[FloatArray, FloatArray]:
        rows = np.ascontiguousarray(signals, dtype=float)
        values = np.ascontiguousarray(parameters, dtype=float)
        if rows.ndim != 2 or rows.shape[1] != SIGNAL_COUNT:
            raise RobotError(
                f"effect '{self.name}': expected signals of shape (N, {SIGNAL_COUNT}),"
                f" found {rows.shape}"
            )
        if values.shape != (len(self.parameters),):
            raise RobotError(
                f"effect '{self.name}': expected {len(self.parameters)} parameters,"
                f" found shape {values.shape}"
            )
        return rows, values
