"""Columns of the effects that a robot file lists, from the one catalogue of hydro_model.

`identify` fits the linear parameters of listed effects and the null bias of valves, and never
adds an effect. Other laws on the valve signal are applied as listed and not fitted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hydro_ident.estimate.chambers import Chamber
from hydro_ident.estimate.hydraulics import CylinderFit, HydraulicFit
from hydro_ident.estimate.inertial import Motion
from hydro_ident.estimate.traces import Trace
from hydro_model.cylinder import chamber_volumes, lever, piston_force
from hydro_model.effects.catalogue import ActiveEffect, resolve, target_name
from hydro_model.effects.effect import Stage
from hydro_model.robot import FloatArray, Robot, Valve
from hydro_model.signals import (
    ATMOSPHERIC_PRESSURE,
    JOINT_POSITION,
    JOINT_VELOCITY,
    LEVER,
    PISTON_ACCELERATION,
    PISTON_FORCE,
    PISTON_POSITION,
    PISTON_VELOCITY,
    PRESSURE_A,
    PRESSURE_B,
    SIGNAL_COUNT,
    SUPPLY_PRESSURE,
    TANK_PRESSURE,
    TIME,
    VALVE_SIGNAL,
)
from hydro_model.valve import edge_flows

#: The one law on the valve signal that is fitted, by Gauss-Newton steps.
NULL_BIAS = "valve_null_bias.bias"
#: A dead volume enters the balance as V0 / beta: fitted under this suffix, then divided.
OVER_BULK = "/bulk_modulus"
#: Parts of a sampling interval over which a law with internal states is averaged.
_SUBSTEPS = 8
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
            for one in self._with(Stage.FRICTION)
            for name in _linear_names(one)
        )

    def force_columns(self, trace: Trace, moved: Motion) -> FloatArray:
        """Piston forces (joint forces without cylinder) of unit parameters, (N, n, e)."""
        columns = []
        for one in self._with(Stage.FRICTION):
            if one.joint is not None:
                at, signals = one.joint, _dry_signals(trace, one.joint, moved)
            else:
                index = one.cylinder or 0
                at = self.robot.joint_index(self.robot.cylinders[index].joint)
                signals = self._signals(trace, index, moved)
            unit = one.effect.columns(signals, one.parameters, Stage.FRICTION)
            block = np.zeros((unit.shape[0], self.robot.dof, unit.shape[1]))
            block[:, at] = unit
            columns.append(block)
        if not columns:
            return np.zeros((trace.samples, self.robot.dof, 0))
        return np.concatenate(columns, axis=2)

    def chamber_columns(
        self, chamber: Chamber, trace: Trace
    ) -> tuple[tuple[str, ...], FloatArray]:
        """Names and interval integrals (N - 1, e) of a chamber's linear effect parameters."""
        signals = self._signals(trace, chamber.index)
        pressure = signals[:, PRESSURE_A if chamber.side == "a" else PRESSURE_B]
        side = 0 if chamber.side == "a" else 1
        volume = chamber_volumes(chamber.cylinder, trace.stroke[:, chamber.index])[side]
        rise = -np.diff(pressure)[:, None]
        names: list[str] = []
        columns = [np.zeros((trace.samples - 1, 0))]
        for one in self.active:
            if one.cylinder != chamber.index:
                continue
            if _is_bias(one):
                names.append(NULL_BIAS)
                columns.append(self._bias_slope(chamber, trace)[:, None] * trace.step_s)
            for stages, suffix in ((_FLOW, ""), (_VOLUME, OVER_BULK), (_COMPLIANCE, "")):
                stage = stages[chamber.side]
                if not any(term.stage is stage for term in one.effect.terms):
                    continue
                unit = one.effect.columns(signals, one.parameters, stage)
                weight = volume[:, None] if stages is _COMPLIANCE else 1.0
                factor = trace.step_s if stages is _FLOW else rise
                integral = _middle(unit * weight) * factor
                acting = _acting(one, stage)
                pairs = zip(_linear_names(one), acting, strict=True)
                names += [f"{name}{suffix}" for name, on in pairs if on]
                columns.append(integral[:, acting])
        return tuple(names), np.concatenate(columns, axis=1)

    @property
    def biases(self) -> dict[str, float]:
        """Null bias by `<cylinder>.valve_null_bias.bias` where it is listed."""
        return {
            f"{self._cylinder_name(one)}.{NULL_BIAS}": float(one.parameters[0])
            for one in self.active
            if _is_bias(one)
        }

    def refined(self, fit: HydraulicFit) -> tuple[ListedEffects, float]:
        """One Gauss-Newton step of the listed null biases, and its largest size.

        Parameters
        ----------
        fit : HydraulicFit
            Of traces with these laws; its `NULL_BIAS` is the step.

        Returns
        -------
        effects : ListedEffects
            With the biases moved, and the fitted edges for the next slope.
        largest : float
        """
        found = {c.cylinder: c for c in fit.cylinders if NULL_BIAS in c.names}
        active, valves, largest = [], list(self.robot.valves), 0.0
        for one in self.active:
            name = self._cylinder_name(one)
            if _is_bias(one) and name in found:
                step = found[name].value(NULL_BIAS)[0]
                largest = max(largest, abs(step))
                bounds = one.effect.parameters[0]
                moved = np.clip(one.parameters + step, bounds.lower, bounds.upper)
                active.append(replace(one, parameters=moved))
                at = self.robot.valve_names.index(self.robot.valve_of(name).name)
                valves[at] = _with_edges(valves[at], found[name])
            else:
                active.append(one)
        return ListedEffects(replace(self.robot, valves=tuple(valves)), tuple(active)), largest

    def with_signal_laws(self, trace: Trace) -> Trace:
        """The trace with its valve signals passed through the listed laws, as listed."""
        chosen = [one for one in self._with(Stage.SIGNAL) if one.cylinder is not None]
        if not chosen:
            return trace
        result = trace.valve_signal.copy()
        for one in chosen:
            index = one.cylinder or 0
            signals = self._signals(trace, index)
            known = np.isfinite(result[:, index])
            signals[:, VALVE_SIGNAL] = np.where(known, result[:, index], 0.0)
            law = _mean_signal(one, signals, trace.step_s)
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
        rest = [o for o in self.active if not _linear_names(o) and not _is_bias(o)]
        return tuple(dict.fromkeys(one.effect.name for one in rest))

    def _with(self, stage: Stage) -> list[ActiveEffect]:
        return [o for o in self.active if any(t.stage is stage for t in o.effect.terms)]

    def _cylinder_name(self, one: ActiveEffect) -> str:
        return self.robot.cylinders[one.cylinder or 0].name

    def _signals(self, trace: Trace, index: int, moved: Motion | None = None) -> FloatArray:
        """Signals of one cylinder over a trace; velocities only where the motion is known."""
        cylinder = self.robot.cylinders[index]
        joint = self.robot.joint_index(cylinder.joint)
        signals = np.full((trace.samples, SIGNAL_COUNT), np.nan)
        signals[:, TIME] = trace.time_s
        signals[:, PISTON_POSITION] = trace.stroke[:, index]
        signals[:, PRESSURE_A] = trace.p_a[:, index]
        signals[:, PRESSURE_B] = trace.p_b[:, index]
        signals[:, SUPPLY_PRESSURE] = trace.supply
        signals[:, TANK_PRESSURE] = trace.tank
        signals[:, VALVE_SIGNAL] = trace.valve_signal[:, index]
        signals[:, PISTON_FORCE] = piston_force(cylinder, trace.p_a[:, index], trace.p_b[:, index])
        signals[:, JOINT_POSITION] = trace.q[:, joint]
        signals[:, LEVER] = lever(cylinder, trace.q[:, joint])
        signals[:, ATMOSPHERIC_PRESSURE] = self.robot.atmospheric_pressure_pa
        if moved is not None:
            arm = lever(cylinder, moved.q[:, joint])
            signals[:, JOINT_VELOCITY] = moved.qd[:, joint]
            signals[:, PISTON_VELOCITY] = arm * moved.qd[:, joint]
            signals[:, PISTON_ACCELERATION] = np.gradient(
                signals[:, PISTON_VELOCITY], trace.step_s
            )
        return signals


def _dry_signals(trace: Trace, joint: int, moved: Motion) -> FloatArray:
    """Signals of a joint without cylinder: its piston is the joint itself."""
    signals = np.full((trace.samples, SIGNAL_COUNT), np.nan)
    signals[:, TIME] = trace.time_s
    signals[:, PISTON_POSITION] = signals[:, JOINT_POSITION] = moved.q[:, joint]
    signals[:, PISTON_VELOCITY] = signals[:, JOINT_VELOCITY] = moved.qd[:, joint]
    signals[:, PISTON_ACCELERATION] = moved.qdd[:, joint]
    signals[:, PISTON_FORCE] = trace.joint_torque[:, joint]
    signals[:, LEVER] = 1.0
    return signals


def _with_edges(valve: Valve, fit: CylinderFit) -> Valve:
    c_pa, c_at, c_pb, c_bt = (
        fit.value(edge)[0] if edge in fit.names else float(getattr(valve, edge))
        for edge in ("c_pa", "c_at", "c_pb", "c_bt")
    )
    return replace(valve, c_pa=c_pa, c_at=c_at, c_pb=c_pb, c_bt=c_bt)


def _mean_signal(one: ActiveEffect, signals: FloatArray, step_s: float) -> FloatArray:
    """A law on the valve signal, averaged over each sampling interval.

    The balance holds the signal over an interval. A law with internal states moves within it: its
    value at the interval's start would be half a cycle late, which the fit would take for delay.
    """
    if not one.effect.states:
        return one.effect.evaluate(signals, one.parameters, Stage.SIGNAL, step_s)
    fine = np.repeat(signals, _SUBSTEPS, axis=0)
    law = one.effect.evaluate(fine, one.parameters, Stage.SIGNAL, step_s / _SUBSTEPS)
    middle = _middle(np.append(law, law[-1]))
    return np.asarray(middle.reshape(-1, _SUBSTEPS).mean(axis=1))


def _is_bias(one: ActiveEffect) -> bool:
    return one.effect.name == NULL_BIAS.split(".", 1)[0]


def _linear_names(one: ActiveEffect) -> list[str]:
    return [f"{one.effect.name}.{p.name}" for p in one.effect.parameters if p.linear]


def _acting(one: ActiveEffect, stage: Stage) -> NDArray[np.bool_]:
    """Which linear parameters a stage's law depends on, seen at a probe of distinct signals."""
    probe = 1.0e5 * np.arange(1.0, SIGNAL_COUNT + 1.0)[None, :]
    return np.asarray(one.effect.columns(probe, one.parameters, stage)[0] != 0.0)


def _middle(values: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (values[1:] + values[:-1]))
