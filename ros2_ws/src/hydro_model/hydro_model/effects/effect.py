"""What an effect is: a name, an equation, parameters and the physics that all parts share.

The physics is written once, in one of three forms, and everything else (roll-out, identification,
controller, report) uses it. Laws (`hydro_model.effects.law`) add to one cylinder's equations. A
*change* turns the robot into the one that has the effect: masses, gravity, delays. A *reading*
turns true signals into what the sensors show; it acts on no machine, only on what is recorded.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from hydro_model.effects.law import (
    ROBOT_STAGES,
    InternalState,
    Law,
    ParameterSpec,
    Row,
    Stage,
    Term,
)
from hydro_model.effects.readings import Readings
from hydro_model.effects.signals import SIGNAL_COUNT, STATE_0
from hydro_model.errors import RobotError
from hydro_model.robot import FloatArray, Robot

if TYPE_CHECKING:
    from hydro_model.effects.bending import KnownTorques

__all__ = [
    "CHANNELS",
    "ROBOT_STAGES",
    "Effect",
    "InternalState",
    "Law",
    "ParameterSpec",
    "ReadingChange",
    "RobotChange",
    "Row",
    "Stage",
    "Term",
]

#: (robot, target, parameters) to the robot that has the effect. The target is one of
#: `hydro_model.effects.catalogue.targets`.
RobotChange = Callable[[Robot, str, FloatArray], Robot]
#: (true readings, index, parameters) to what the sensors show. The index is that of the joint for
#: targets of kind ``joint``, of the cylinder for ``cylinder``, and that in `Robot.pressure_names`
#: for ``pressure``; 0 for ``robot``.
ReadingChange = Callable[[Readings, int, FloatArray], Readings]
#: (signals, parameters, sample time) to internal states over a recording.
KnownStates = Callable[[FloatArray, FloatArray, float], FloatArray]

#: Kinds of residual channels.
CHANNELS = ("force", "flow_a", "flow_b", "timing")


@dataclass(frozen=True, slots=True)
class Effect:
    """A named piece of physics.

    Attributes
    ----------
    name : str
        Name of the contract.
    channel : str
        Family of the contract: ``force``, ``flow`` or ``timing``.
    equation, source : str
        For the report: the law in words of mathematics, and where it is from.
    parameters : tuple of ParameterSpec
    terms : tuple of Term
        What it adds where; the first is the one that names its size. Empty where `change` or
        `reading` says it all.
    looks_like : tuple of str
        What a fit may take for it.
    separating_experiment : str
        The run that tells them apart.
    states : tuple of InternalState
    known_states : callable or None
        (signals, parameters, sample time in s) to what a whole recording tells of the states,
        (N, k), where it tells more than their rates do.
    known_torques : callable or None
        (load of the joint, parameters, sample time in s, states at the first sample beyond those
        at rest) to what all joints' torques gain by it, (N, n): where a recording tells more than
        the laws see, in the place of `change` and laws.
    needs_cylinder : bool
        False where the laws look at the motion alone, so that the effect can act on a joint
        without cylinder, too: piston velocity is then the joint's, and N is N m on a revolute
        joint.
    drive_only : bool
        Its targets are joints without cylinder alone.
    channels : tuple of str
        The kinds of residual channels it can show in, of `CHANNELS`; strongest first.
    acts_on : str
        Kind of its targets: ``cylinder`` (or a joint without, see `needs_cylinder`), ``joint``,
        ``pressure`` (a pressure's name) or ``robot``.
    change : callable or None
        The robot that has the effect.
    reading : callable or None
        What the sensors show.
    undo : callable or None
        What the sensors would show without its `reading`; None: that of the opposite sign.
    start : str
        Name of the parameter that is the time from which the `change` holds, in seconds on the
        recording's time axis; empty where it always does.
    duration : str
        Name of the parameter over which it comes about, evenly, its start in the middle.
    end, end_duration : str
        As `start` and `duration`, of when the `change` goes again.
    head_start : str
        Name of the parameter that is for how long it has been under way when a recording begins;
        empty where that does not matter.
    needs_other_joint : bool
        Looks at another joint: not for a robot with a single one.
    shared : bool
        All its targets may have it from one cause, by the same amount: tried together, too.
    needs_valve : bool
        Looks at the edges' flows or coefficients, in proportion to which it acts. What its laws
        add to the valve's flow the laws behind it see: restrictions in series multiply.
    needs_tip : bool
        Looks at the height of the tip, which a roll-out computes for such effects only.
    sided : bool
        Sits at a single chamber: its targets are chambers, tried one by one.
    limits : str
        What the form leaves out, for the report; empty where it is all there is to say.
    elsewhere : Effect or None
        What goes by the same name at other things: a joint without cylinder, a single valve.
    stages : tuple of Stage
        Those that its laws enter at.
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
    known_states: KnownStates | None = None
    known_torques: KnownTorques | None = None
    needs_cylinder: bool = True
    drive_only: bool = False
    channels: tuple[str, ...] = ("force",)
    acts_on: str = "cylinder"
    change: RobotChange | None = None
    reading: ReadingChange | None = None
    undo: ReadingChange | None = None
    start: str = ""
    duration: str = ""
    end: str = ""
    end_duration: str = ""
    head_start: str = ""
    needs_other_joint: bool = False
    shared: bool = False
    needs_valve: bool = False
    needs_tip: bool = False
    sided: bool = False
    limits: str = ""
    elsewhere: Effect | None = None
    stages: tuple[Stage, ...] = field(init=False)

    def __post_init__(self) -> None:
        stages = tuple(dict.fromkeys(term.stage for term in self.terms))
        object.__setattr__(self, "stages", stages)

    @property
    def forms(self) -> tuple[Effect, ...]:
        """All that goes by this name: at cylinders, and at drives where that differs."""
        return (self,) if self.elsewhere is None else (self, self.elsewhere)

    def undone(self, seen: Readings, index: int, parameters: FloatArray) -> Readings:
        """What the sensors would show without its reading.

        Parameters
        ----------
        seen : Readings
        index : int
            As of `reading`.
        parameters : array
        """
        if self.reading is None:
            return seen
        if self.undo is not None:
            return self.undo(seen, index, parameters)
        return self.reading(seen, index, -parameters)

    @property
    def edges(self) -> tuple[str, ...]:
        """Names of the parameters that say when it comes and goes: each recording has its own."""
        names = (self.start, self.duration, self.end, self.end_duration, self.head_start)
        return tuple(name for name in names if name)

    @property
    def sizes(self) -> tuple[int, ...]:
        """Parameters that say how large it is: the linear ones, else one that it grows with."""
        if self.name != "base_tilt":
            return self.linear or (0,)
        # The tilt about y, but where that is held at none.
        return (1 if self.parameters[1].lower < self.parameters[1].upper else 0,)

    @property
    def robot_wide(self) -> bool:
        """Acts once for the robot instead of once per cylinder."""
        return self.acts_on == "robot"

    @property
    def typical(self) -> FloatArray:
        """Typical parameter values, in parameter order."""
        return np.array([parameter.typical for parameter in self.parameters])

    @property
    def linear(self) -> tuple[int, ...]:
        """Indices of its linear parameters."""
        return tuple(i for i, parameter in enumerate(self.parameters) if parameter.linear)

    def term(self, stage: Stage | None = None) -> Term:
        """Its term at a stage, or the first one; raises RobotError where there is none."""
        if stage is None and self.terms:
            return self.terms[0]
        for term in self.terms:
            if term.stage is stage:
                return term
        wanted = "" if stage is None else f"{stage.value} "
        known = ", ".join(t.stage.value for t in self.terms) or "none"
        raise RobotError(f"effect '{self.name}' has no {wanted}law (it has: {known})")

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
                return spec.usual
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
            Columns by `hydro_model.effects.signals`; those the law does not use may hold anything.
        parameters : array
            In the order of `parameters`.
        stage : Stage, optional
            Default: the first term.
        sample_time_s : float, optional
            Needed by effects with internal states. Where the recording does not tell them they are
            integrated from rest at the first row; between rows the valve's signal and flows are
            held, the rest moves evenly.

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
        from hydro_model.effects.compiled import evaluate_law
        from hydro_model.effects.internal_states import follow_states

        rows, values = self._checked(signals, parameters)
        law = self.term(stage).law
        if self._moves(values):
            if sample_time_s is None:
                raise RobotError(f"effect '{self.name}' has internal states: give sample_time_s")
            if self.known_states is not None:
                known = self.known_states(rows, values, sample_time_s)
                rows = rows.copy()
                rows[:, STATE_0 : STATE_0 + len(self.states)] = known
                return evaluate_law(law, rows, values)
            return follow_states(self.states, law, rows, values, sample_time_s)
        return evaluate_law(law, rows, values)

    def held_mean(
        self,
        signals: ArrayLike,
        parameters: ArrayLike,
        stage: Stage,
        sample_time_s: float,
    ) -> FloatArray:
        """One of its laws, averaged from each sample to the next while all signals are held.

        A law with internal states moves meanwhile: its value at the sample, or half way to that
        at the next, is off by a good part of an interval.

        Parameters
        ----------
        signals : (N, SIGNAL_COUNT) array
            As of `evaluate`.
        parameters : array
        stage : Stage
        sample_time_s : float

        Returns
        -------
        (N,) array
            In the unit of the stage.

        Raises
        ------
        RobotError
            As `evaluate`.
        """
        from hydro_model.effects.internal_states import held_means

        rows, values = self._checked(signals, parameters)
        if not self._moves(values) or self.known_states is not None:
            return self.evaluate(rows, values, stage, sample_time_s)
        return held_means(self.states, self.term(stage).law, rows, values, sample_time_s)

    def columns(
        self,
        signals: ArrayLike,
        parameters: ArrayLike,
        stage: Stage | None = None,
        sample_time_s: float | None = None,
    ) -> FloatArray:
        """Regressor columns of its linear parameters at a stage.

        Parameters
        ----------
        signals : (N, SIGNAL_COUNT) array
        parameters : array
            Values of the parameters that are not linear; the linear ones are ignored.
        stage : Stage, optional
            Default: the first term.
        sample_time_s : float, optional
            Needed by effects with internal states.

        Returns
        -------
        (N, k) array
            One column per linear parameter, in parameter order: the law at its unit.
        """
        rows, values = self._checked(signals, parameters)
        linear = list(self.linear)
        out = np.empty((len(rows), len(linear)))
        for column, index in enumerate(linear):
            unit = values.copy()
            unit[linear] = 0.0
            unit[index] = 1.0
            out[:, column] = self.evaluate(rows, unit, stage, sample_time_s)
        return out

    def _moves(self, values: FloatArray) -> bool:
        """Whether a law looks at internal states at such parameters."""
        return any(s.needs is None or values[s.needs] != 0.0 for s in self.states)

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
