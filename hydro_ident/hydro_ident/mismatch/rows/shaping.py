"""Signals as a model has them: valve signals and rails shaped by its laws, rows of each part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from hydro_ident.estimate.flows.chambers import Chamber
from hydro_ident.estimate.flows.rails import railed
from hydro_ident.estimate.forces.force_rows import Motion, force_columns
from hydro_ident.estimate.signals.traces import Trace, last_known
from hydro_ident.mismatch.rows.changed_torques import ChangedTorques
from hydro_ident.mismatch.rows.corrected import CorrectedReadings
from hydro_ident.mismatch.rows.flow_laws import HeldRows
from hydro_ident.mismatch.rows.kept_rows import KeptRows
from hydro_ident.mismatch.rows.law_signals import (
    dry_rows,
    reshape,
    wet_rows,
    with_edges,
    with_pressures,
)
from hydro_ident.mismatch.rows.material import Material, Stretch
from hydro_ident.mismatch.rows.modelled import Model, gives_way, identical, same_base
from hydro_model.effects.catalogue import CATALOGUE
from hydro_model.effects.effect import Stage
from hydro_model.effects.signals import VALVE_SIGNAL
from hydro_model.effects.targets import ActiveEffect, parts
from hydro_model.robot import FloatArray, Robot

#: Sets of laws on the valve signal whose outcome is kept at a time.
_KEPT_SHAPES = 6
#: Valve signals behind laws that are kept at a time, per stretch.
_KEPT_SPOOLS = 16
#: Bytes of signals between samples that are kept at a time.
_KEPT_BYTES = 64 << 20
#: What those are of: signals at the samples, the edges, the recording and the delay.
_HeldOf = tuple[FloatArray, Robot, Trace, float]
#: Motions of a stretch whose filtered regressor is kept at a time.
_KEPT_MOTIONS = 3


@dataclass(slots=True)
class Signals:
    """Signals of the models that are asked about, kept as long as the same one is.

    Attributes
    ----------
    material : Material
    readings : CorrectedReadings
    changes : ChangedTorques
    frictions : KeptRows
        Of laws of friction, on all rows.
    spans : dict
        What `under_way` keeps, by stretch and joint.
    """

    material: Material
    readings: CorrectedReadings = field(init=False)
    _kept: Model | None = None
    _plain_rows: dict[tuple[int, int], tuple[Trace, Robot, FloatArray]] = field(
        default_factory=dict
    )
    _shaped: dict[tuple[object, ...], tuple[Trace, Trace]] = field(default_factory=dict)
    _spools: dict[tuple[object, ...], tuple[Trace, FloatArray]] = field(default_factory=dict)
    _scratch: dict[tuple[int, int], tuple[Trace, FloatArray]] = field(default_factory=dict)
    _dry: dict[tuple[int, int], tuple[tuple[object, ...], FloatArray]] = field(
        default_factory=dict
    )
    _rows: dict[tuple[int, int, bool], FloatArray] = field(default_factory=dict)
    _passed: dict[tuple[int, int, str], tuple[Model, Trace, FloatArray]] = field(
        default_factory=dict
    )
    _held: dict[tuple[int, int], tuple[_HeldOf, HeldRows]] = field(default_factory=dict)
    _last_plain: tuple[Model, FloatArray] | None = None
    _regressors: dict[int, list[tuple[Motion, FloatArray]]] = field(default_factory=dict)
    frictions: KeptRows = field(default_factory=KeptRows)
    changes: ChangedTorques = field(default_factory=ChangedTorques)
    spans: dict[tuple[int, int], tuple[Motion, FloatArray]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.readings = CorrectedReadings(self.material)

    def regressor(self, stretch: Stretch, moved: Motion) -> FloatArray:
        """Filtered force regressor of a stretch, (T, n, p); not to be changed.

        It changes with the positions alone: sensors of pressure leave it as it is.
        """
        kept = self._regressors.setdefault(stretch.number, [])
        for known, columns in kept:
            if known is moved:
                return columns
        columns = force_columns(self.material.forces, stretch.trace, moved)
        columns = self.material.filtered(stretch, columns)
        if len(kept) >= _KEPT_MOTIONS:
            # The recorded motion came first and is asked for again and again.
            kept.pop(1)
        kept.append((moved, columns))
        return columns

    def kept_plain(
        self, model: Model, residual: Callable[[Signals, Model], FloatArray]
    ) -> FloatArray:
        """The base's residual of a model with readings alone, kept for the last one asked for."""
        kept = self._last_plain
        if kept is None or not same_base(kept[0], model):
            kept = self._last_plain = model, residual(self, model)
        return kept[1]

    def kept_passing(
        self,
        model: Model,
        stretch: Stretch,
        chamber: Chamber,
        passing: Callable[[Signals, Model, Stretch, Chamber], FloatArray],
    ) -> FloatArray:
        """What passes a chamber's valve in a model, kept for the last one asked for.

        Effects are tried in many sizes beside the same others.

        Parameters
        ----------
        model : Model
        stretch : Stretch
        chamber : Chamber
        passing : callable
            What works it out, m^3 per sampling interval, (N - 1,).
        """
        key = stretch.number, chamber.index, chamber.side
        kept = self._passed.get(key)
        if (
            kept is None
            or kept[0].robot is not model.robot
            or kept[0].delays_s != model.delays_s
            or not identical(kept[0], model)
            or kept[1] is not stretch.trace
        ):
            volume = passing(self, model, stretch, chamber)
            kept = self._passed[key] = model, stretch.trace, volume
        return kept[2]

    def of(self, model: Model, stretch: Stretch, one: ActiveEffect) -> FloatArray:
        """What a law may look at over a stretch, (N, SIGNAL_COUNT).

        Of the whole robot: what is the same at all its targets, as the first of them has it.
        """
        first = parts(self.material.robot, one)[0]
        if first.joint is not None and first.cylinder is None:
            return self.dry(stretch, first.joint)
        return self.wet(model, stretch, first.cylinder or 0)

    def dry(self, stretch: Stretch, joint: int) -> FloatArray:
        """Signals of a joint whose torque is measured; its piston is the joint itself.

        Not to be changed: they are kept as long as what they are made of is the same.
        """
        key, trace = (stretch.number, joint), stretch.trace
        own = trace.q, trace.joint_torque, trace.oil_c, stretch.moved
        kept = self._dry.get(key)
        if kept is None or not all(a is b for a, b in zip(kept[0], own, strict=True)):
            kept = self._dry[key] = own, dry_rows(self.material.robot, stretch, joint)
        return kept[1]

    def wet(
        self, model: Model, stretch: Stretch, cylinder: int, shaped: bool = False
    ) -> FloatArray:
        """Signals of a cylinder as recorded or as the model's laws shape them; not to be changed.

        They are kept as long as the same model is asked for: candidates share them.

        `shaped` asks for the latter.
        """
        self._keep(model)
        key = stretch.number, cylinder, shaped
        if key not in self._rows:
            rows = self._plain(model.robot, stretch, cylinder)
            if shaped and model.shaping:
                rows = rows.copy()
                reshape(rows, model.robot, cylinder, self.shaped(model, stretch))
            self._rows[key] = rows
        return self._rows[key]

    def held(self, model: Model, stretch: Stretch, cylinder: int) -> HeldRows:
        """Signals of a cylinder as its valve is held by late commands.

        The last ones are kept, a few megabytes of them: trials and slopes share them.
        """
        rows = self.wet(model, stretch, cylinder, shaped=True)
        key = stretch.number, cylinder
        own = (rows, model.robot, stretch.trace, model.delays_s[cylinder])
        kept = self._held.pop(key, None)
        same_rows = kept is not None and all(
            a is b for a, b in zip(kept[0][:3], own[:3], strict=True)
        )
        if kept is None or not same_rows or kept[0][3] != own[3]:
            step_s = stretch.trace.step_s
            kept = own, HeldRows.of(model.robot, cylinder, rows, own[3], step_s)
        most = _KEPT_BYTES // max(2 * rows.nbytes, 1)
        while self._held and len(self._held) >= most:
            self._held.pop(next(iter(self._held)))
        self._held[key] = kept
        return kept[1]

    def _plain(self, robot: Robot, stretch: Stretch, cylinder: int) -> FloatArray:
        """Signals as recorded; not to be changed.

        What follows from geometry is kept as long as the sensors' signals stay, what follows from
        the edges is written anew for another robot.
        """
        key = stretch.number, cylinder
        kept = self._plain_rows.get(key)
        if kept is None or kept[0].q is not stretch.trace.q:
            rows = wet_rows(robot, stretch, cylinder)
        elif kept[0] is not stretch.trace:
            # Readings of pressures leave the motion as it is.
            rows = self._to_write(kept[2])
            with_pressures(rows, robot, cylinder, stretch.trace)
        elif kept[1] is not robot:
            rows = self._to_write(kept[2])
            with_edges(rows, robot, cylinder, stretch.trace)
        else:
            return kept[2]
        self._plain_rows[key] = stretch.trace, robot, rows
        return rows

    def _to_write(self, rows: FloatArray) -> FloatArray:
        """Rows to write another model's numbers into: a copy while they are the kept model's."""
        return rows.copy() if any(kept is rows for kept in self._rows.values()) else rows

    def _keep(self, model: Model) -> None:
        """Forget what was kept for a model whose signals are others.

        Laws that only add to a balance leave them as they are.
        """
        kept = self._kept
        if kept is None or kept.robot is not model.robot or kept.shape != model.shape:
            self._kept = model
            self._rows.clear()

    def shaped(self, model: Model, stretch: Stretch) -> Trace:
        """The trace with valve signals and rails as the model's laws shape them."""
        if not model.shaping:
            return stretch.trace
        key = (*model.shape, stretch.number)
        kept = self._shaped.get(key)
        if kept is None or kept[0] is not stretch.trace:
            if len(self._shaped) >= _KEPT_SHAPES * len(self.material.stretches):
                self._shaped.pop(next(iter(self._shaped)))
            kept = self._shaped[key] = stretch.trace, self._shape(model, stretch)
        return kept[1]

    def _shape(self, model: Model, stretch: Stretch) -> Trace:
        trace = stretch.trace
        laws = [t for t in model.terms if Stage.SIGNAL in t.effect.stages]
        # They act one after the other in the catalogue's order, as in a roll-out.
        laws.sort(key=lambda t: list(CATALOGUE).index(t.effect.name))
        if laws:
            result = trace.valve_signal.copy()
            for i in {t.cylinder or 0 for t in laws}:
                own = tuple(t for t in laws if (t.cylinder or 0) == i)
                result[:, i] = self._spool(model, stretch, i, own)
            trace = replace(trace, valve_signal=result)
        rails = [t for t in model.terms if gives_way(t)]
        if rails:
            trace = railed(model.robot, trace, rails, model.delays_s, model.terms)
        return trace

    def _spool(
        self, model: Model, stretch: Stretch, cylinder: int, laws: tuple[ActiveEffect, ...]
    ) -> FloatArray:
        """A valve's signal behind some laws, (N,); kept law by law: most fits move the last."""
        trace = stretch.trace
        if not laws:
            return np.asarray(trace.valve_signal[:, cylinder])
        names = tuple((t.effect.name, tuple(t.parameters.tolist())) for t in laws)
        key = stretch.number, cylinder, names
        kept = self._spools.pop(key, None)
        if kept is None or kept[0] is not trace:
            before = self._spool(model, stretch, cylinder, laws[:-1])
            signals, known = self._own_rows(model, stretch, cylinder), np.isfinite(before)
            signals[:, VALVE_SIGNAL] = last_known(before)
            # The balance holds the signal over an interval, within which a spool still moves: its
            # value at the interval's start would be half a cycle late, which fits take for delay.
            last = laws[-1]
            law = last.effect.held_mean(signals, last.parameters, Stage.SIGNAL, trace.step_s)
            kept = trace, np.where(known, law, np.nan)
        if len(self._spools) >= _KEPT_SPOOLS * max(len(self.material.stretches), 1):
            self._spools.pop(next(iter(self._spools)))
        self._spools[key] = kept
        return kept[1]

    def _own_rows(self, model: Model, stretch: Stretch, cylinder: int) -> FloatArray:
        """A copy of a cylinder's signals to write valve signals into; their laws see no edge."""
        key = stretch.number, cylinder
        kept = self._scratch.get(key)
        if kept is None or kept[0] is not stretch.trace:
            rows = self._plain(model.robot, stretch, cylinder).copy()
            kept = self._scratch[key] = stretch.trace, rows
        return kept[1]
