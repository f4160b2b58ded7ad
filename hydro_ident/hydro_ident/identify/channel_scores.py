"""Scores of the force and flow channels: the given robot against the identified one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.estimate.effects.listed_laws import NULL_BIAS
from hydro_ident.estimate.flows.chambers import (
    INVERSE_BULK,
    OVER_BULK,
    Chamber,
    chamber_rows,
    chambers_of,
    column_names,
)
from hydro_ident.estimate.flows.cylinder_fit import CylinderFit
from hydro_ident.estimate.flows.hydraulics import HydraulicFit
from hydro_ident.estimate.forces.between_samples import curved_rows
from hydro_ident.estimate.forces.inertial import ForceModel, InertialFit, force_rows
from hydro_ident.estimate.forces.late_forces import late_rows
from hydro_ident.estimate.forces.standstill import Rest
from hydro_ident.estimate.forces.zeros import constant_rows
from hydro_ident.estimate.scoring.noise import flow_noise, force_noise
from hydro_ident.estimate.scoring.scores import ChannelScore, HoldOut, Tally
from hydro_ident.estimate.signals.derivatives import FilterSettings, secant_slope
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.estimate.statistics.moments import Moments
from hydro_ident.estimate.statistics.rows import Rows
from hydro_ident.identify.identified_robot import with_fitted_base
from hydro_ident.parameters.parameters import listed_value
from hydro_ident.recordings.cleaning import Cleaner
from hydro_model.robot import FloatArray, Robot

#: A residual so many times the sensors' noise is physics that the model leaves out.
LEFT_OUT = 5.0


@dataclass(frozen=True, slots=True)
class ScorePlan:
    """What predicts, and on which rows.

    Attributes
    ----------
    robot : Robot
        The given robot, for the predictions before.
    inertial : InertialFit or None
    hydraulic : HydraulicFit or None
    effects : tuple of ListedEffects
        As given, and as fitted.
    split : HoldOut
    filters : FilterSettings
        Of the quickest recording that is fitted; slower ones have theirs.
    overlap_s : float
        Overlap of pieces over which the filters settle.
    still : mapping of str to mapping of int to Rest
        By recording, how the joints stand that are still.
    every, every_fitted : int
        Rows kept for the plots, one in so many: of those scored, of those fitted.
    cleaner : Cleaner or None
        What takes outliers out first: a law cannot predict them.
    """

    robot: Robot
    inertial: InertialFit | None
    hydraulic: HydraulicFit | None
    effects: tuple[ListedEffects, ListedEffects]
    split: HoldOut
    filters: FilterSettings
    overlap_s: float
    still: Mapping[str, Mapping[int, Rest]]
    every: int = 1
    every_fitted: int = 1
    cleaner: Cleaner | None = None

    @property
    def bulk_pa(self) -> dict[str, float]:
        """Bulk moduli by cylinder: as fitted, the given ones where those cannot be used."""
        found = {c.name: c.bulk_modulus_pa for c in self.robot.cylinders}
        for one in self.hydraulic.cylinders if self.hydraulic is not None else ():
            if not one.rejected:
                found[one.cylinder] = one.bulk_modulus()[0]
        return found


@dataclass(slots=True)
class ScoreKeeper:
    """Scores one recording, trace by trace in order.

    Attributes
    ----------
    plan : ScorePlan
    scored, trained : bool
        Which rows are wanted: those that took no part in the fit, those that did.
    tallies, fitted : dict of str to Tally
        The former and the latter, by channel.
    late : Moments or None
        Of the rows that took part, with columns for forces that are read late, for what they do
        between samples and for constant ones.
    """

    plan: ScorePlan
    scored: bool = True
    trained: bool = False
    tallies: dict[str, Tally] = field(default_factory=dict)
    fitted: dict[str, Tally] = field(default_factory=dict)
    late: Moments | None = None

    def add(self, trace: Trace) -> None:
        """Take in the next trace, as recorded, without signal laws."""
        if self.plan.inertial is not None:
            self._add_forces(trace, self.plan.inertial)
        if self.plan.hydraulic is not None:
            found = {c.cylinder: c for c in self.plan.hydraulic.cylinders}
            for chamber in chambers_of(self.plan.robot):
                result = found.get(chamber.cylinder.name)
                if result and chamber.side in [c.chamber.side for c in result.chambers]:
                    self._add_flow(trace, chamber, self.plan.hydraulic, result)

    def _add_forces(self, trace: Trace, fit: InertialFit) -> None:
        plan, model = self.plan, fit.model
        still = plan.still.get(trace.recording, {})
        rows = force_rows(model, trace, plan.filters, still)
        if rows is None:
            return
        if self.trained:
            late = late_rows(model, trace, rows, plan.filters)
            late = curved_rows(model, trace, late, plan.filters, plan.bulk_pa, still)
            late = plan.split.training(constant_rows(model, late))
            if self.late is None:
                self.late = Moments.like(late, trace.recording, sample_s=trace.step_s)
            self.late.add(late)
        speed = secant_slope(trace.time_s, trace.q)
        for side in self._sides():
            own = side.choose(rows)
            before = own.x @ _given_theta(model, plan.robot)
            after = own.x @ fit.fit.theta
            for column, name in enumerate(model.channels):
                side.tally(name).add(
                    own.time_s,
                    own.y[:, column],
                    before[:, column],
                    after[:, column],
                    np.interp(own.time_s, trace.time_s, speed[:, column]),
                )

    def _add_flow(
        self, trace: Trace, chamber: Chamber, fit: HydraulicFit, result: CylinderFit
    ) -> None:
        plan, rows, names = self.plan, [], column_names(chamber)
        delays = (plan.robot.command_delay_s, fit.delay_of(chamber.valve.name))
        # The same windows at either delay: what a hole spoils at one is left out at both.
        windows = fit.windows.reaching(max(delays), trace.step_s)
        for laws, delay in zip(plan.effects, delays, strict=True):
            shaped = laws.with_signal_laws(trace)
            listed, extra = laws.chamber_columns(chamber, shaped)
            names = column_names(chamber, listed)
            rows.append(chamber_rows(chamber, shaped, delay, windows, extra))
        theta = np.array([result.value(name)[0] for name in names])
        joint = plan.robot.joint_index(chamber.cylinder.joint)
        speed = secant_slope(trace.time_s, trace.q[:, joint])
        for side in self._sides():
            given, fitted = (side.choose(one) for one in rows)
            before = given.x @ _given_chamber(plan.robot, chamber, names)
            after = fitted.x @ theta
            there = np.interp(fitted.time_s, trace.time_s, speed)
            side.tally(chamber.channel).add(
                fitted.time_s, fitted.y[:, 0], before[:, 0], after[:, 0], there
            )

    def _sides(self) -> list[_Side]:
        split, plan = self.plan.split, self.plan
        sides = [_Side(split.held_out, self.tallies, plan.every)] if self.scored else []
        if self.trained:
            sides.append(_Side(split.training, self.fitted, plan.every_fitted))
        return sides


@dataclass(frozen=True, slots=True)
class _Side:
    """Rows of one kind, and where they are tallied."""

    choose: Callable[[Rows], Rows]
    tallies: dict[str, Tally]
    every: int

    def tally(self, name: str) -> Tally:
        return self.tallies.setdefault(name, Tally(self.every))


def channel_scores(
    plan: ScorePlan, recordings: Sequence[tuple[str, dict[str, Tally]]], signals: SignalSurvey
) -> list[ChannelScore]:
    """Scores over all recordings.

    Parameters
    ----------
    plan : ScorePlan
    recordings : sequence of (str, dict of str to Tally)
        Names and what `ScoreKeeper` found in them: on rows that were scored, or fitted.
    signals : SignalSurvey
        Of these recordings, for the noise floors.

    Returns
    -------
    list of ChannelScore
        Channels that were measured: forces, then flows.
    """
    units: dict[str, str] = {}
    floors: dict[str, float] = {}
    used = {name for _, tallies in recordings for name, tally in tallies.items() if tally.count}
    if plan.inertial is not None and used & set(plan.inertial.model.channels):
        model = plan.inertial.model
        # Positions' noise weighs as the inertia that is multiplied with it: what was fitted.
        fitted = with_fitted_base(plan.robot, plan.inertial)
        noise = force_noise(model, signals, plan.filters, fitted)
        units |= dict(zip(model.channels, model.units, strict=True))
        floors |= dict(zip(model.channels, noise.tolist(), strict=True))
    if plan.hydraulic is not None:
        found = {c.cylinder: c for c in plan.hydraulic.cylinders}
        for chamber in chambers_of(plan.robot):
            if chamber.channel in used:
                inverse = found[chamber.cylinder.name].value(INVERSE_BULK)[0]
                windows = plan.hydraulic.windows
                floors[chamber.channel] = flow_noise(
                    plan.robot, chamber, signals, windows, inverse
                )
                units[chamber.channel] = "m^3/s"
    scores = []
    for name, unit in units.items():
        total, where = Tally(plan.every), []
        for label, tallies in recordings:
            if name in tallies and tallies[name].count:
                total.merge(tallies[name])
                where.append(label)
        if total.count:
            scores.append(total.score(name, unit, floors[name], tuple(where)))
    return scores


def _given_theta(model: ForceModel, robot: Robot) -> FloatArray:
    base = model.base.combination @ robot.parameter_vector
    friction = [cylinder.viscous_friction for cylinder in robot.cylinders]
    friction += [robot.joints[j].viscous_friction for j in robot.dry_joints]
    listed = [listed_value(robot, name) for name in model.effect_names]
    return np.array([*base, *friction, *listed])


def _given_chamber(robot: Robot, chamber: Chamber, names: Sequence[str]) -> FloatArray:
    inverse = 1.0 / chamber.cylinder.bulk_modulus_pa
    values = []
    for name in names:
        if name == INVERSE_BULK:
            values.append(inverse)
        elif name in chamber.edges:
            values.append(float(getattr(chamber.valve, name)))
        elif name == NULL_BIAS:
            values.append(0.0)  # The signal law of the trace holds it already.
        else:
            plain = name.removesuffix(OVER_BULK)
            value = listed_value(robot, f"{chamber.cylinder.name}.{plain}")
            values.append(value * inverse if name != plain else value)
    return np.array(values)
