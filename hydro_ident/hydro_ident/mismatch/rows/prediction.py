"""The model on the rows: what is measured, and the base columns that a refit moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from hydro_ident.estimate.flows.chambers import INVERSE_BULK
from hydro_ident.estimate.signals.derivatives import low_pass, smooth_rates
from hydro_ident.mismatch.rows.balance_steps import Balance, balance_steps
from hydro_ident.mismatch.rows.base_columns import BaseColumns, delay_name
from hydro_ident.mismatch.rows.contributions import (
    changed,
    contribution,
    own_share,
    said_twice,
)
from hydro_ident.mismatch.rows.force_rows import measured, skewed
from hydro_ident.mismatch.rows.material import Material, Stretch, pressure_of
from hydro_ident.mismatch.rows.modelled import Model, reading_key, same, same_base, shapes
from hydro_ident.mismatch.rows.ripple import ripple_force
from hydro_ident.mismatch.rows.shaping import Signals
from hydro_ident.mismatch.rows.skew import TORQUES, skew_name
from hydro_ident.mismatch.rows.under_way import under_way
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray, Robot

__all__ = ["Model", "Predictor", "shapes"]

#: Measured forces (T, n) of a stretch, filtered regressor (T, n, p), skews' columns (T, 2 c + n).
ForceRows = tuple[FloatArray, FloatArray, FloatArray]
#: Flow rows kept per stretch: some models' worth of chambers.
_KEPT_FLOWS = 64
#: Force rows kept per stretch: one per reading of the sensors.
_KEPT_FORCES = 4


@dataclass(slots=True)
class Predictor:
    """Evaluates models on the rows of some material.

    Attributes
    ----------
    material : Material
    signals : Signals
    names : tuple of str
        The base parameters: forces, by cylinder bulk and edges, valves' delays, ripples, skews.
    delay_columns, ripple_columns : dict of int to int
        Where among `names` the delay of each cylinder's valve is, and the ripple of its pressures.
    skew_columns : dict of int to int
        Where the skew of each chamber's pressure is, chambers a and b of each cylinder in turn,
        and that of all measured torques, `TORQUES`.
    torque_joints : tuple of int
        Joints with rows of a torque that is measured.
    """

    material: Material
    signals: Signals = field(init=False)
    names: tuple[str, ...] = field(init=False)
    delay_columns: dict[int, int] = field(init=False)
    ripple_columns: dict[int, int] = field(init=False)
    skew_columns: dict[int, int] = field(init=False)
    torque_joints: tuple[int, ...] = field(init=False)
    _forces: dict[tuple[object, ...], tuple[FloatArray, FloatArray, FloatArray]] = field(
        default_factory=dict
    )
    _flows: dict[tuple[object, ...], FloatArray] = field(default_factory=dict)
    _rates: dict[tuple[object, ...], FloatArray] = field(default_factory=dict)
    _ripples: tuple[object, dict[tuple[int, int], FloatArray]] | None = None
    _left: tuple[Model, FloatArray] | None = None

    def __post_init__(self) -> None:
        self.signals = Signals(self.material)
        own = BaseColumns.of(self.material)
        self.names, self.torque_joints = own.names, own.torque_joints
        self.delay_columns, self.ripple_columns = own.delays, own.ripples
        self.skew_columns = own.skews

    def base(self, model: Model) -> tuple[FloatArray, FloatArray]:
        """Measured values (N,) and base columns (N, p) at a model's signals and delay."""
        material, names = self.material, self.names
        y, x = np.zeros(material.size), np.zeros((material.size, len(names)))
        count = len(material.forces.names)
        forced = self._force_base(model)
        for place in material.places:
            if not material.is_flow(place.channel):
                joint = material.joint_of(place.channel)
                measured, columns, skew = forced[place.stretch]
                y[place.rows] = measured[:, joint]
                x[place.rows, :count] = columns[:, joint]
                for one, at in self.skew_columns.items():
                    if one == TORQUES and joint in self.torque_joints:
                        x[place.rows, at] = skew[:, 2 * len(material.robot.cylinders) + joint]
                    elif one != TORQUES and self._joint_of(one // 2) == joint:
                        x[place.rows, at] = skew[:, one]
        stretches = self.signals.readings.stretches(model)
        self._ripple_base(model, stretches, x)
        for place in material.places:
            if material.is_flow(place.channel):
                self._flow_base(model, stretches[place.stretch], place.channel, place.rows, (y, x))
        return y, x

    def residual(self, model: Model) -> FloatArray:
        """Measured less predicted values, (N,)."""
        return self._less(model, self.share)

    def contribution(
        self, model: Model, one: ActiveEffect, parameters: FloatArray | None = None
    ) -> FloatArray:
        """What the prediction gains by an effect on top of a model's other effects, (N,).

        Parameters
        ----------
        model : Model
            With or without the effect.
        one : ActiveEffect
        parameters : array, optional
            Instead of the effect's own.
        """
        if parameters is not None:
            one = replace(one, parameters=parameters)
        result = contribution(self.signals, model, one)
        if one.effect.known_torques is None:
            return result
        without = replace(model, terms=tuple(t for t in model.terms if not same(t, one)))
        swung = under_way(self.signals, without, one, self._beside(without), result)
        return np.asarray(result + swung)

    def share(self, model: Model, one: ActiveEffect) -> FloatArray:
        """What an effect of a model adds to its prediction itself, (N,).

        Shares of all effects that are not in its signals are, with the base, the prediction;
        contributions of laws in series hold what each leaves the others to restrict as well.

        Parameters
        ----------
        model : Model
            With the effect.
        one : ActiveEffect
        """
        if one.effect.known_torques is not None:
            return self.contribution(model, one)
        return own_share(self.signals, model, one)

    def _beside(self, model: Model) -> FloatArray:
        """Residual of a model whose modes all begin at rest, (N,), kept for the last one."""
        if self._left is None or not same_base(self._left[0], model):
            self._left = model, self._less(model, partial(own_share, self.signals))
        return self._left[1]

    def _less(
        self, model: Model, share: Callable[[Model, ActiveEffect], FloatArray]
    ) -> FloatArray:
        """What is measured less the base and a share of each effect, (N,)."""
        y, x = self.base(model)
        values = y - x @ self.parameters(model)
        for term in model.terms:
            if term.effect.reading is None and not shapes(term):
                values -= share(model, term)
        return np.asarray(values + said_twice(self.signals, model))

    def change(self, model: Model, one: ActiveEffect, parameters: FloatArray) -> FloatArray:
        """What the prediction gains where an effect of a model has other parameters, (N,).

        Parameters
        ----------
        model : Model
            With the effect.
        one : ActiveEffect
            A reading, or what acts through the edges.
        parameters : array
            Instead of the effect's own.
        """
        return changed(self.signals, model, one, replace(one, parameters=parameters))

    def parameters(self, model: Model) -> FloatArray:
        """A model's numbers in the order of `names`; the delay's column is a slope: 0."""
        values = dict(zip(self.material.forces.names, model.theta, strict=True))
        for cylinder in model.robot.cylinders:
            values[f"{cylinder.name}.{INVERSE_BULK}"] = 1.0 / cylinder.bulk_modulus_pa
        for valve in model.robot.valves:
            for edge in ("c_pa", "c_at", "c_pb", "c_bt"):
                values[f"{valve.name}.{edge}"] = float(getattr(valve, edge))
        for columns, own in (
            (self.ripple_columns, model.ripples),
            (self.skew_columns, model.skews_s),
        ):
            # By cylinder and chamber: other recordings may lack some of those that were fitted.
            values |= {self.names[at]: own[i] for i, at in columns.items() if own}
        return np.array([values.get(name, 0.0) for name in self.names])

    def _joint_of(self, cylinder: int) -> int:
        robot = self.material.robot
        return robot.joint_index(robot.cylinders[cylinder].joint)

    def _ripple_base(self, model: Model, stretches: tuple[Stretch, ...], into: FloatArray) -> None:
        material, key = self.material, (reading_key(model), _edges_of(model.robot))
        columns = self.ripple_columns
        by_joint = {self._joint_of(i): i for i in columns}
        if self._ripples is None or self._ripples[0] != key:
            self._ripples = key, {}
        kept = self._ripples[1]
        for place in material.places:
            if material.is_flow(place.channel):
                continue
            index = by_joint.get(material.joint_of(place.channel))
            if index is None:
                continue
            at = place.stretch, index
            if at not in kept:
                kept[at] = self._ripple_rows(model.robot, index, stretches[place.stretch])
            into[place.rows, columns[index]] = kept[at]

    def _ripple_rows(self, robot: Robot, index: int, stretch: Stretch) -> FloatArray:
        settings, trace = self.material.filters, stretch.trace
        force = ripple_force(robot, index, trace)
        smooth = low_pass(force, trace.step_s, settings.differentiation_hz, settings.order)
        return self.material.filtered(stretch, smooth)

    def _force_base(self, model: Model) -> list[ForceRows]:
        """Measured forces, filtered regressor and what skews add, of every stretch."""
        key = reading_key(model)
        stretches = self.signals.readings.stretches(model)
        result = []
        for s, stretch in enumerate(stretches):
            if len(self._forces) >= _KEPT_FORCES * max(len(stretches), 1):
                self._forces.clear()
            if (*key, s) not in self._forces:
                self._forces[(*key, s)] = self._force_rows(stretch)
            result.append(self._forces[(*key, s)])
        return result

    def _force_rows(self, stretch: Stretch) -> ForceRows:
        forces, n = self.material.forces, self.material.robot.dof
        if stretch.moved is None or not stretch.kept.size:
            count = 2 * len(self.material.robot.cylinders) + n
            return np.zeros((0, n)), np.zeros((0, n, len(forces.names))), np.zeros((0, count))
        material, columns = self.material, self.signals.regressor(stretch, stretch.moved)
        return measured(material, stretch), columns, skewed(material, stretch)

    def _flow_base(
        self,
        model: Model,
        stretch: Stretch,
        channel: int,
        rows: slice,
        into: tuple[FloatArray, FloatArray],
    ) -> None:
        material, names = self.material, self.names
        chamber = material.chambers[material.chamber_index(channel)]
        rows_of = Balance.of(self._flow_rows(model, stretch, channel))
        valve = model.robot.valve_of(chamber.cylinder.name)
        edges = np.array([float(getattr(valve, edge)) for edge in chamber.edges])
        inverse = 1.0 / model.robot.cylinders[chamber.index].bulk_modulus_pa
        own = {f"{chamber.cylinder.name}.{INVERSE_BULK}": rows_of.compression}
        for k, edge in enumerate(chamber.edges):
            own[f"{chamber.valve.name}.{edge}"] = rows_of.edges[:, k]
        if chamber.index in self.delay_columns:
            own[delay_name(chamber)] = rows_of.late @ edges
        skew = rows_of.skewed @ edges + inverse * rows_of.skewed_compression
        own[skew_name(chamber.cylinder.name, chamber.side)] = skew
        into[0][rows] = rows_of.swept
        for name, values in own.items():
            into[1][rows, names.index(name)] = values

    def _flow_rows(self, model: Model, stretch: Stretch, channel: int) -> FloatArray:
        """Rows of a balance, (W, 9) as `balance_steps`.

        At unit coefficients: they change with delay and shaping alone, and are kept for those.
        """
        material = self.material
        index = material.chamber_index(channel)
        chamber = material.chambers[index]
        delay_s = model.delays_s[chamber.index]
        key = (delay_s, model.shape, channel, stretch.number)
        if key in self._flows:
            return self._flows[key]
        steps = balance_steps(
            chamber, self.signals.shaped(model, stretch), delay_s,
            self._rate(model, stretch, channel),
        )  # fmt: skip
        if len(self._flows) >= _KEPT_FLOWS * max(len(material.stretches), 1):
            self._flows.clear()
        self._flows[key] = material.windowed(stretch, index, steps)
        return self._flows[key]

    def _rate(self, model: Model, stretch: Stretch, channel: int) -> FloatArray:
        """Rate of a chamber's pressure, kept per reading of the sensors."""
        material, key = self.material, (reading_key(model), channel, stretch.number)
        if key not in self._rates:
            if len(self._rates) >= _KEPT_FORCES * len(material.places):
                self._rates.clear()
            chamber = material.chambers[material.chamber_index(channel)]
            trace = stretch.trace
            pressure = pressure_of(chamber, trace)
            self._rates[key] = smooth_rates(pressure, trace.step_s, material.filters)
        return self._rates[key]


def _edges_of(robot: Robot) -> tuple[float, ...]:
    return tuple(
        float(getattr(v, e)) for v in robot.valves for e in ("c_pa", "c_at", "c_pb", "c_bt")
    )
