"""Columns of the effects that a robot file lists, from the one catalogue of hydro_model.

`identify` fits the linear parameters of listed effects and the null bias of valves, and never
adds an effect. What it cannot fit is taken as listed: other laws on the valve signal shape it,
bodies and payloads take their torque off the measured one, a tilt turns gravity, errors of
sensors are undone. Laws that bend the flow of the valve's own edges, and those of single
chambers, have no place in the chambers' balances: `ListedEffects.ignored` names them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hydro_ident.estimate.chambers import INVERSE_BULK, Chamber
from hydro_ident.estimate.held_effects import (
    corrected,
    cylinder_signals,
    held_torque,
    moving_signals,
)
from hydro_ident.estimate.hydraulics import CylinderFit, HydraulicFit
from hydro_ident.estimate.inertial import Motion
from hydro_ident.estimate.traces import Trace, last_known
from hydro_model.cylinder import chamber_volumes
from hydro_model.effects import with_changes
from hydro_model.effects.catalogue import ActiveEffect, resolve, target_name
from hydro_model.effects.effect import Stage
from hydro_model.robot import FloatArray, Robot, Valve
from hydro_model.signals import PRESSURE_A, PRESSURE_B, SIGNAL_COUNT, VALVE_SIGNAL
from hydro_model.valve import edge_flows

#: The one law on the valve signal that is fitted, by Gauss-Newton steps.
NULL_BIAS = "valve_null_bias.bias"
#: A dead volume enters the balance as V0 / beta: fitted under this suffix, then divided.
OVER_BULK = "/bulk_modulus"
_FLOW = {"a": Stage.FLOW_A, "b": Stage.FLOW_B}
_VOLUME = {"a": Stage.VOLUME_A, "b": Stage.VOLUME_B}
_COMPLIANCE = {"a": Stage.COMPLIANCE_A, "b": Stage.COMPLIANCE_B}


@dataclass(frozen=True, slots=True)
class ListedEffects:
    """The effects of a robot file, as columns of the two regressions.

    Attributes
    ----------
    robot : Robot
    active : tuple of ActiveEffect
    """

    robot: Robot
    active: tuple[ActiveEffect, ...]

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

        The owner is a cylinder, or a joint without cylinder.
        """
        return tuple(
            f"{target_name(self.robot, one)}.{name}"
            for one in self._rubbing
            for name in _linear_names(one)
        )

    @property
    def _rubbing(self) -> list[ActiveEffect]:
        """Fitted friction: laws without a change of the robot, which are taken as listed."""
        return [one for one in self._with(Stage.FRICTION) if one.effect.change is None]

    def force_columns(self, trace: Trace, moved: Motion) -> FloatArray:
        """Piston forces (joint forces without cylinder) of unit parameters, (N, n, e)."""
        columns = []
        for one in self._rubbing:
            at, signals = moving_signals(self.robot, one, trace, moved)
            unit = one.effect.columns(signals, one.parameters, Stage.FRICTION, trace.step_s)
            block = np.zeros((unit.shape[0], self.robot.dof, unit.shape[1]))
            block[:, at] = unit
            columns.append(block)
        if not columns:
            return np.zeros((trace.samples, self.robot.dof, 0))
        return np.concatenate(columns, axis=2)

    def held_torque(self, trace: Trace, moved: Motion) -> FloatArray:
        """Joint torques (N, n) of the listed `changes` and of their laws."""
        return held_torque(self.robot, self.changes, trace, moved)

    def corrected(self, trace: Trace) -> Trace:
        """The trace without the listed errors of its instruments, to first order in their size."""
        return corrected(self.robot, self.errors, trace)

    def chamber_columns(
        self, chamber: Chamber, trace: Trace
    ) -> tuple[tuple[str, ...], FloatArray]:
        """Names and interval integrals (N - 1, e) of a chamber's linear effect parameters."""
        signals = cylinder_signals(self.robot, trace, chamber.index)
        pressure = signals[:, PRESSURE_A if chamber.side == "a" else PRESSURE_B]
        side = 0 if chamber.side == "a" else 1
        volume = chamber_volumes(chamber.cylinder, trace.stroke[:, chamber.index])[side]
        # Air is in the dead volume as well; of that the fit starts from what is listed.
        volume = volume + self._dead_volume(chamber)
        rise = -np.diff(pressure)[:, None]
        names: list[str] = []
        columns = [np.zeros((trace.samples - 1, 0))]
        for one in self.active:
            if one.cylinder != chamber.index or _bends_edges(one):
                continue
            if _is_bias(one):
                names.append(NULL_BIAS)
                columns.append(self._bias_slope(chamber, trace)[:, None] * trace.step_s)
            for stages, suffix in ((_FLOW, ""), (_VOLUME, OVER_BULK), (_COMPLIANCE, "")):
                stage = stages[chamber.side]
                if not any(term.stage is stage for term in one.effect.terms):
                    continue
                unit = one.effect.columns(signals, one.parameters, stage, trace.step_s)
                weight = volume[:, None] if stages is _COMPLIANCE else 1.0
                factor = trace.step_s if stages is _FLOW else rise
                integral = _middle(unit * weight) * factor
                acting = _acting(one, stage)
                pairs = zip(_linear_names(one), acting, strict=True)
                names += [f"{name}{suffix}" for name, on in pairs if on]
                columns.append(integral[:, acting])
        return tuple(names), np.concatenate(columns, axis=1)

    def _dead_volume(self, chamber: Chamber) -> float:
        """Dead volume of a chamber as it is listed at present, m^3."""
        at = 0 if chamber.side == "a" else 1
        own = [o for o in self.active if _is_dead(o) and o.cylinder == chamber.index]
        return float(sum(one.parameters[at] for one in own))

    @property
    def moves(self) -> bool:
        """Whether columns depend on what is fitted: null biases, and dead volumes beside air."""
        return any(_is_bias(one) or self._holds_air(one) for one in self.active)

    def _holds_air(self, one: ActiveEffect) -> bool:
        """Whether what is listed is the dead volume of a cylinder with compliance listed."""
        soft = [o for o in self.active if set(_COMPLIANCE.values()) & set(o.effect.stages)]
        return _is_dead(one) and any(o.cylinder == one.cylinder for o in soft)

    @property
    def biases(self) -> dict[str, float]:
        """Null bias by `<cylinder>.valve_null_bias.bias` where it is listed."""
        return {
            f"{self._cylinder_name(one)}.{NULL_BIAS}": float(one.parameters[0])
            for one in self.active
            if _is_bias(one)
        }

    def refined(self, fit: HydraulicFit) -> tuple[ListedEffects, float]:
        """One Gauss-Newton step of what columns depend on, and its largest size.

        Parameters
        ----------
        fit : HydraulicFit
            Of traces with these laws; its `NULL_BIAS` is the step of a null bias.

        Returns
        -------
        effects : ListedEffects
            With null biases and dead volumes beside air moved, and the fitted edges for the next
            slope.
        largest : float
            Of biases, and of volumes in m^3.
        """
        found = {c.cylinder: c for c in fit.cylinders}
        active, valves, largest = [], list(self.robot.valves), 0.0
        for one in self.active:
            own = found.get(self._cylinder_name(one))
            bounds, moved = one.effect.parameters, one.parameters
            if own is not None and _is_bias(one) and NULL_BIAS in own.names:
                moved = moved + own.value(NULL_BIAS)[0]
                at = self.robot.valve_names.index(self.robot.valve_of(own.cylinder).name)
                valves[at] = _with_edges(valves[at], own)
            elif own is not None and self._holds_air(one):
                moved = _dead_volumes(one, own)
            moved = np.clip(moved, [p.lower for p in bounds], [p.upper for p in bounds])
            largest = max(largest, float(np.abs(moved - one.parameters).max(initial=0.0)))
            active.append(replace(one, parameters=moved))
        return ListedEffects(replace(self.robot, valves=tuple(valves)), tuple(active)), largest

    def with_signal_laws(self, trace: Trace) -> Trace:
        """The trace as the balances are to see it.

        Without the listed errors of sensors, and with the valve signals passed through the listed
        laws on them.
        """
        trace = self.corrected(trace)
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
        return _middle(flow * side)

    @property
    def held(self) -> tuple[str, ...]:
        """Listed effects whose parameters are taken as listed, by name."""
        fitted = [*self._rubbing, *(o for o in self.active if _is_bias(o))]
        fitted += [o for o in self.active if _in_chambers(o) and not _bends_edges(o)]
        names = [o.effect.name for o in self.active if o not in fitted or not _fits(o)]
        return tuple(n for n in dict.fromkeys(names) if n not in self.ignored)

    @property
    def ignored(self) -> tuple[str, ...]:
        """Listed effects that neither fit nor balances know of, by name."""
        return tuple(dict.fromkeys(one.effect.name for one in self.active if _bends_edges(one)))

    def _with(self, stage: Stage) -> list[ActiveEffect]:
        return [o for o in self.active if any(t.stage is stage for t in o.terms)]

    def _cylinder_name(self, one: ActiveEffect) -> str:
        return self.robot.cylinders[one.cylinder or 0].name


def _with_edges(valve: Valve, fit: CylinderFit) -> Valve:
    c_pa, c_at, c_pb, c_bt = (
        fit.value(edge)[0] if edge in fit.names else float(getattr(valve, edge))
        for edge in ("c_pa", "c_at", "c_pb", "c_bt")
    )
    return replace(valve, c_pa=c_pa, c_at=c_at, c_pb=c_pb, c_bt=c_bt)


def _dead_volumes(one: ActiveEffect, fit: CylinderFit) -> FloatArray:
    """Dead volumes as fitted; those that were not, as they were."""
    inverse, result = fit.value(INVERSE_BULK)[0], one.parameters.copy()
    for i, name in enumerate(_linear_names(one)):
        if inverse > 0.0 and f"{name}{OVER_BULK}" in fit.names:
            result[i] = fit.value(f"{name}{OVER_BULK}")[0] / inverse
    return result


def _is_dead(one: ActiveEffect) -> bool:
    return any(term.stage in _VOLUME.values() for term in one.effect.terms)


def _is_bias(one: ActiveEffect) -> bool:
    return one.effect.name == NULL_BIAS.split(".", 1)[0]


def _in_chambers(one: ActiveEffect) -> bool:
    stages = {*_FLOW.values(), *_VOLUME.values(), *_COMPLIANCE.values()}
    return bool(stages.intersection(one.effect.stages))


def _bends_edges(one: ActiveEffect) -> bool:
    """A law whose size counts in the edges' own flow, or which acts on one chamber alone."""
    return _in_chambers(one) and (one.effect.needs_valve or bool(one.side))


def _fits(one: ActiveEffect) -> bool:
    return bool(_linear_names(one)) or _is_bias(one)


def _linear_names(one: ActiveEffect) -> list[str]:
    return [f"{one.effect.name}.{p.name}" for p in one.effect.parameters if p.linear]


def _acting(one: ActiveEffect, stage: Stage) -> NDArray[np.bool_]:
    """Which linear parameters a stage's law depends on, seen at a probe of distinct signals."""
    rising = 1.0e5 * np.arange(1.0, SIGNAL_COUNT + 1.0)
    # What has internal states is at rest in the first row and moves when the signals turn.
    probe = np.array([rising, -rising, rising])
    return np.asarray((one.effect.columns(probe, one.parameters, stage, 1e-3) != 0.0).any(axis=0))


def _middle(values: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (values[1:] + values[:-1]))
