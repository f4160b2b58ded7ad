"""Columns of the effects that a robot file lists, from the one catalogue of hydro_model.

`identify` fits the linear parameters of listed effects and the null bias of valves, and never
adds an effect. What it cannot fit is taken as listed: other laws on the valve signal shape it,
bodies and payloads take their torque off the measured one, a tilt turns gravity, errors of
sensors are undone. Laws that bend the flow of the valve's own edges, and those of single
chambers, have no place in the chambers' balances: `ListedEffects.ignored` names them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from hydro_ident.estimate.effects.held_effects import (
    corrected,
    cylinder_signals,
    held_torque,
    known_motion,
    moving_signals,
)
from hydro_ident.estimate.effects.listed_laws import (
    NULL_BIAS,
    acting,
    bends_edges,
    fits,
    in_chambers,
    is_bias,
    is_dead,
    linear_names,
    looks_at,
    middle,
)
from hydro_ident.estimate.flows.chambers import OVER_BULK, Chamber
from hydro_ident.estimate.flows.rails import railed
from hydro_ident.estimate.forces.inertial import Motion
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.traces import Trace, last_known
from hydro_model.effects import with_changes
from hydro_model.effects.catalogue import ActiveEffect, resolve, target_name
from hydro_model.effects.law import COMPLIANCE, FLOW, VOLUME, Stage
from hydro_model.effects.signals import (
    PISTON_VELOCITY,
    PRESSURE_A,
    PRESSURE_B,
    VALVE_SIGNAL,
)
from hydro_model.hydraulics.cylinder import chamber_volumes
from hydro_model.hydraulics.valve import edge_flows
from hydro_model.robot import FloatArray, Robot

_RAILS = (Stage.SUPPLY, Stage.TANK)


@dataclass(frozen=True, slots=True)
class ListedEffects:
    """The effects of a robot file, as columns of the two regressions.

    Attributes
    ----------
    robot : Robot
    active : tuple of ActiveEffect
    filters : FilterSettings
        Of the motion that laws in the chambers look at.
    """

    robot: Robot
    active: tuple[ActiveEffect, ...]
    filters: FilterSettings = field(default_factory=FilterSettings)

    @property
    def level(self) -> Robot:
        """The robot with gravity as a listed tilt turns it."""
        return replace(self.robot, gravity_m_s2=with_changes(self.robot).gravity_m_s2)

    @property
    def changes(self) -> tuple[ActiveEffect, ...]:
        """Listed effects that change the robot's bodies, and are not fitted."""
        return tuple(
            one for one in self.active if one.effect.change and "force" in one.effect.channels
        )

    @property
    def errors(self) -> tuple[ActiveEffect, ...]:
        """Listed effects of instruments."""
        return tuple(one for one in self.active if one.effect.reading is not None)

    @staticmethod
    def of(robot: Robot) -> ListedEffects:
        """The listed effects of a robot; raises RobotError where one is not in the catalogue."""
        return ListedEffects(robot, resolve(robot))

    @property
    def force_names(self) -> tuple[str, ...]:
        """Names `<owner>.<effect>.<parameter>` of the fitted friction parameters.

        The owner is a cylinder, or a joint without cylinder; the robot where one cause acts on
        all of it.
        """
        return tuple(
            f"{owner}.{name}" for owner, own in self._by_owner for name in linear_names(own[0])
        )

    @property
    def force_values(self) -> tuple[float, ...]:
        """Their values as listed, by `force_names`."""
        return tuple(
            float(value)
            for _, (one, *_) in self._by_owner
            for spec, value in zip(one.effect.parameters, one.parameters, strict=True)
            if spec.linear
        )

    @property
    def _rubbing(self) -> list[ActiveEffect]:
        """Fitted friction: laws without a change of the robot, which are taken as listed."""
        return [one for one in self._with(Stage.FRICTION) if one.effect.change is None]

    @property
    def _by_owner(self) -> list[tuple[str, list[ActiveEffect]]]:
        """Fitted friction with the owner of its numbers, at every target that has them."""
        whole = {spec.name for spec in self.robot.effects if spec.target == self.robot.name}
        result: dict[tuple[str, str], list[ActiveEffect]] = {}
        for one in self._rubbing:
            # A ground under the tip acts on every joint at once, and is as stiff at each.
            shared = one.effect.shared and one.effect.name in whole
            owner = self.robot.name if shared else target_name(self.robot, one)
            result.setdefault((owner, one.effect.name), []).append(one)
        return [(owner, own) for (owner, _), own in result.items()]

    def force_columns(self, trace: Trace, moved: Motion) -> FloatArray:
        """Piston forces (joint forces without cylinder) of unit parameters, (N, n, e)."""
        columns = []
        for _, own in self._by_owner:
            count = len(linear_names(own[0]))
            block = np.zeros((trace.samples, self.robot.dof, count))
            for one in own:
                at, signals = moving_signals(self.robot, one, trace, moved)
                unit = one.effect.columns(signals, one.parameters, Stage.FRICTION, trace.step_s)
                block[:, at] += unit
            columns.append(block)
        if not columns:
            return np.zeros((trace.samples, self.robot.dof, 0))
        return np.concatenate(columns, axis=2)

    def held_torque(self, trace: Trace, moved: Motion) -> FloatArray:
        """Joint torques (N, n) of the listed `changes` and of their laws, in the level's gravity.

        A payload on a tilted base weighs along the tilted gravity.
        """
        return held_torque(self.level, self.changes, trace, moved)

    def corrected(self, trace: Trace) -> Trace:
        """The trace without the listed errors of its instruments, to first order in their size."""
        return corrected(self.robot, self.errors, trace)

    def chamber_columns(
        self, chamber: Chamber, trace: Trace
    ) -> tuple[tuple[str, ...], FloatArray]:
        """Names and interval integrals (N - 1, e) of a chamber's linear effect parameters."""
        signals = self._wet_signals(trace, chamber.index)
        pressure = signals[:, PRESSURE_A if chamber.side == "a" else PRESSURE_B]
        side = 0 if chamber.side == "a" else 1
        volume = chamber_volumes(chamber.cylinder, trace.stroke[:, chamber.index])[side]
        # Air is in the dead volume as well; of that the fit starts from what is listed.
        volume = volume + self._dead_volume(chamber)
        rise = -np.diff(pressure)[:, None]
        names: list[str] = []
        columns = [np.zeros((trace.samples - 1, 0))]
        for one in self.active:
            if one.cylinder != chamber.index or bends_edges(one):
                continue
            if is_bias(one):
                names.append(NULL_BIAS)
                columns.append(self._bias_slope(chamber, trace)[:, None] * trace.step_s)
            for stages, suffix in ((FLOW, ""), (VOLUME, OVER_BULK), (COMPLIANCE, "")):
                stage = stages[chamber.side]
                if not any(term.stage is stage for term in one.effect.terms):
                    continue
                unit = one.effect.columns(signals, one.parameters, stage, trace.step_s)
                weight = volume[:, None] if stages is COMPLIANCE else 1.0
                factor = trace.step_s if stages is FLOW else rise
                integral = middle(unit * weight) * factor
                own = acting(one, stage)
                pairs = zip(linear_names(one), own, strict=True)
                names += [f"{name}{suffix}" for name, on in pairs if on]
                columns.append(integral[:, own])
        return tuple(names), np.concatenate(columns, axis=1)

    def _wet_signals(self, trace: Trace, index: int) -> FloatArray:
        """Signals of a cylinder, with its motion where a law in its chambers looks at that."""
        own = [o for o in self.active if o.cylinder == index and in_chambers(o)]
        quick = any(PISTON_VELOCITY in looks_at(one) for one in own)
        moved = known_motion(trace, self.filters) if quick else None
        return cylinder_signals(self.robot, trace, index, moved)

    def _dead_volume(self, chamber: Chamber) -> float:
        """Dead volume of a chamber as it is listed at present, m^3."""
        at = 0 if chamber.side == "a" else 1
        own = [o for o in self.active if is_dead(o) and o.cylinder == chamber.index]
        return float(sum(one.parameters[at] for one in own))

    def holds_air(self, one: ActiveEffect) -> bool:
        """Whether what is listed is the dead volume of a cylinder with compliance listed.

        Parameters
        ----------
        one : ActiveEffect
        """
        soft = [o for o in self.active if set(COMPLIANCE.values()) & set(o.effect.stages)]
        return is_dead(one) and any(o.cylinder == one.cylinder for o in soft)

    @property
    def biases(self) -> dict[str, float]:
        """Null bias by `<cylinder>.valve_null_bias.bias` where it is listed."""
        return {
            f"{self.cylinder_name(one)}.{NULL_BIAS}": float(one.parameters[0])
            for one in self.active
            if is_bias(one)
        }

    def with_signal_laws(self, trace: Trace) -> Trace:
        """The trace as the balances are to see it.

        Without the listed errors of sensors, with the valve signals passed through the listed
        laws on them, and with rails that nobody recorded as the listed laws have them give way.
        """
        trace = self._with_spools(self.corrected(trace))
        stages = [s for s, read in zip(_RAILS, trace.rails_read, strict=True) if not read]
        rails = [one for one in self.rails if set(stages) & set(one.effect.stages)]
        if not rails:
            return trace
        return railed(self.robot, trace, rails, [self.robot.command_delay_s] * trace.p_a.shape[1])

    @property
    def iterated(self) -> bool:
        """Whether rows of balances depend on what they are fitted for: `listed_steps.stepped`."""
        held = any(self.holds_air(one) for one in self.active)
        return bool(self.biases or self.rails or held)

    @property
    def rails(self) -> list[ActiveEffect]:
        """Listed effects by which rails give way."""
        return [one for stage in _RAILS for one in self._with(stage)]

    def _with_spools(self, trace: Trace) -> Trace:
        chosen = [one for one in self._with(Stage.SIGNAL) if one.cylinder is not None]
        if not chosen:
            return trace
        result = trace.valve_signal.copy()
        for one in chosen:
            index = one.cylinder or 0
            signals = cylinder_signals(self.robot, trace, index)
            known = np.isfinite(result[:, index])
            before = result[:, index]
            if trace.latched is not None:
                before = np.where(trace.latched, 0.0, before)
            signals[:, VALVE_SIGNAL] = last_known(before)
            # The balance holds the signal over an interval, within which a spool still moves.
            law = one.effect.held_mean(signals, one.parameters, Stage.SIGNAL, trace.step_s)
            result[:, index] = np.where(known, law, np.nan)
        return replace(trace, valve_signal=result)

    def _bias_slope(self, chamber: Chamber, trace: Trace) -> FloatArray:
        """Derivative of the chamber's valve flow with respect to the signal, per interval."""
        i = chamber.index
        valve = self.robot.valve_of(chamber.cylinder.name)
        side = np.where(trace.valve_signal[:, i] > 0.0, 1.0, -1.0)
        rails = (trace.p_a[:, i], trace.p_b[:, i], trace.supply, trace.tank)
        flow = edge_flows(valve, side, *rails)[0 if chamber.side == "a" else 1]
        return middle(flow * side)

    @property
    def held(self) -> tuple[str, ...]:
        """Listed effects whose parameters are taken as listed, by name."""
        fitted = [*self._rubbing, *(o for o in self.active if is_bias(o))]
        fitted += [o for o in self.active if in_chambers(o) and not bends_edges(o)]
        names = [o.effect.name for o in self.active if o not in fitted or not fits(o)]
        return tuple(n for n in dict.fromkeys(names) if n not in self.ignored)

    @property
    def ignored(self) -> tuple[str, ...]:
        """Listed effects that neither fit nor balances know of, by name."""
        return tuple(dict.fromkeys(one.effect.name for one in self.active if bends_edges(one)))

    def _with(self, stage: Stage) -> list[ActiveEffect]:
        return [o for o in self.active if any(t.stage is stage for t in o.terms)]

    def cylinder_name(self, one: ActiveEffect) -> str:
        """Name of the cylinder that an effect is listed at; the first's where it is at none.

        Parameters
        ----------
        one : ActiveEffect
        """
        return self.robot.cylinders[one.cylinder or 0].name
