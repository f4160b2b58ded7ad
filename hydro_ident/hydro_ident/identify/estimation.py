"""From gathered recordings to parameters: which estimator, and the passes that it takes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.estimate.effects.listed_steps import stepped
from hydro_ident.estimate.flows.delay import Solve, fit_delay
from hydro_ident.estimate.flows.flow_moments import FlowGatherer
from hydro_ident.estimate.flows.hydraulics import HydraulicFit, Regather, hydraulic_fit
from hydro_ident.estimate.forces.inertial import InertialFit, inertial_fit
from hydro_ident.estimate.forces.late_forces import early_forces, held_at_zero
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.estimate.statistics.blocks import blocks_of
from hydro_ident.estimate.statistics.histogram import Histogram
from hydro_ident.estimate.statistics.least_squares import (
    ROBUST_PASSES,
    robust_settled,
    weights_of,
)
from hydro_ident.estimate.statistics.moments import Moments
from hydro_ident.estimate.statistics.regression import Solution, solve_iv, solve_ols, solve_wls
from hydro_ident.estimate.statistics.robust import EXCESS, Weights
from hydro_ident.identify.estimator_choice import (
    REFERENCED_SHARE,
    Choice,
    Chosen,
    compared,
    first_choice,
    referenced_share,
)
from hydro_ident.identify.gathering import (
    Gathered,
    GatherPlan,
    gather_late,
    gather_source,
    unfitted_notes,
)
from hydro_ident.identify.survey import Survey
from hydro_ident.recordings.cleaning import Cleaner
from hydro_ident.recordings.sources import Source
from hydro_ident.recordings.workers import Workers

#: Passes of listed null biases and dead volumes (m^3), and the step at which they end.
_PASSES, _LEAST_STEP = 12, 1.0e-7


@dataclass(frozen=True, slots=True)
class Estimates:
    """Outcome of all passes.

    Attributes
    ----------
    inertial : InertialFit or None
    hydraulic : HydraulicFit or None
    effects : ListedEffects
        As fitted.
    chosen : Chosen
    notes : tuple of str
        What the estimator left out.
    cleaner : Cleaner or None
        What took outliers out of the recordings.
    """

    inertial: InertialFit | None
    hydraulic: HydraulicFit | None
    effects: ListedEffects
    chosen: Chosen
    notes: tuple[str, ...] = ()
    cleaner: Cleaner | None = None


@dataclass(slots=True)
class Estimation:
    """The passes of one identification.

    Attributes
    ----------
    sources : sequence of Source
    plan : GatherPlan
    still : tuple of int
        Joints that did not move.
    workers : Workers
    notes : list of str
    """

    sources: Sequence[Source]
    plan: GatherPlan
    still: tuple[int, ...]
    workers: Workers
    notes: list[str] = field(default_factory=list)
    _gathered_late: list[Moments] | None = None

    def run(self, choice: Choice, surveys: Sequence[Survey], signals: SignalSurvey) -> Estimates:
        """Gather and fit.

        Raises
        ------
        IdentError
            Instruments were asked for, and the joint references were not recorded.
        """
        first = first_choice(choice, self.plan.robot, surveys, signals)
        instruments = first.name == "iv" or (choice == "auto" and first.name == "wls")
        instruments &= referenced_share(surveys) >= REFERENCED_SHARE
        # Of the others what is gross alone is taken out, as of the plan.
        cleaner = self.plan.cleaner
        if first.name == "robust":
            cleaner = Cleaner.of(self.plan.robot, signals)
        self.plan = replace(self.plan, instruments=instruments, cleaner=cleaner)
        gathered = self._gather(self.plan)
        self.notes += [] if cleaner is None else cleaner.notes
        self.notes += cleaned_notes({g.name: g.cleaned for g in gathered})
        self.notes += [
            f"{g.name}: {g.stopped_s:.1f} s left out of the forces, in which a joint rests at an"
            " end of its travel (with the filters' reach): they know nothing of what a stop bears"
            for g in gathered
            if g.stopped_s > 0.0
        ]
        self.notes += unfitted_notes(self.plan, gathered, surveys)
        plain = solve_ols if first.name == "ols" else solve_wls
        hydraulic, gathered = self._flows(gathered, solve_ols if plain is solve_ols else solve_iv)
        if first.name == "robust":
            inertial, hydraulic = self._robust(gathered)
            return self._estimates(inertial, hydraulic, first)
        inertial = self._forces(gathered, solve_iv if first.name == "iv" else plain)
        if choice == "auto" and instruments and inertial is not None:
            other = self._forces(gathered, solve_iv)
            first = compared(inertial, other)
            inertial = other if first.name == "iv" else inertial
        return self._estimates(inertial, hydraulic, first)

    def _estimates(
        self, inertial: InertialFit | None, hydraulic: HydraulicFit | None, chosen: Chosen
    ) -> Estimates:
        notes, cleaner = tuple(self.notes), self.plan.cleaner
        return Estimates(inertial, hydraulic, self.plan.effects, chosen, notes, cleaner)

    def _gather(self, plan: GatherPlan) -> list[Gathered]:
        return self.workers.map(partial(gather_source, plan=plan), self.sources)

    def _forces(self, gathered: Sequence[Gathered], solve: Solve) -> InertialFit | None:
        moments = [g.forces for g in gathered if g.forces is not None]
        if not moments:
            return None
        fitted = partial(
            inertial_fit, self.plan.model, moments, self.still, self.plan.filters, solve
        )
        fit = fitted()
        if fit is None or not fit.rejected:
            return fit
        early = early_forces(fit, self._late())
        again = fitted(held_at_zero(fit, early)) if early else None
        return fit if again is None or again.rejected else replace(again, early=early)

    def _late(self) -> list[Moments]:
        """Rows with columns for late forces, gathered where a friction cannot be."""
        if self._gathered_late is None:
            found = self.workers.map(partial(gather_late, plan=self.plan), self.sources)
            self._gathered_late = [one for one in found if one is not None]
        return self._gathered_late

    def _hydraulics(
        self, gathered: Sequence[Gathered], solve: Solve, regather: Regather | None = None
    ) -> HydraulicFit | None:
        flows = [g.flows for g in gathered]
        return hydraulic_fit(self.plan.robot, flows, self.plan.windows, solve, regather)

    def _flows_at(
        self, weights: Mapping[str, Mapping[str, Weights]], rails_off_pa: Mapping[str, float]
    ) -> list[FlowGatherer]:
        """The flows alone, with rails that nobody read off by so much."""
        plan = replace(self.plan, forces=False, flow_weights=weights, rails_off_pa=rails_off_pa)
        return [g.flows for g in self._gather(plan)]

    def _flows(
        self, gathered: list[Gathered], solve: Solve
    ) -> tuple[HydraulicFit | None, list[Gathered]]:
        """Fit the chambers; where columns depend on what is fitted, again until that stays."""
        fit = self._hydraulics(gathered, solve)
        for _ in range(_PASSES):
            if fit is None or not self.plan.effects.iterated:
                break
            moved, step = stepped(self.plan.effects, fit)
            if step < _LEAST_STEP:
                break
            self.plan = replace(self.plan, effects=moved)
            fresh = self._gather(replace(self.plan, forces=False))
            gathered = [replace(g, flows=f.flows) for g, f in zip(gathered, fresh, strict=True)]
            fit = self._hydraulics(gathered, solve)
        if fit is not None and any(rail.large for rail in fit.rails):
            fit = self._hydraulics(gathered, solve, partial(self._flows_at, {}))
        return fit, gathered

    def _robust(
        self, gathered: Sequence[Gathered]
    ) -> tuple[InertialFit | None, HydraulicFit | None]:
        """Reweighted passes until no force parameter moves."""
        solution: Solution | None = None
        force_weights: Weights | None = None
        flow_weights: dict[str, Weights] = {}
        gathered_weights: dict[str, dict[str, Weights]] = {}
        for number in range(ROBUST_PASSES):
            before = solution
            solution, force_weights = self._force_weights(gathered, force_weights, number)
            flows = [g.flows for g in gathered]
            found = fit_delay(self.plan.robot, flows, _robust_solve(number, solve_iv))
            for name, one in (found.chambers if found is not None else {}).items():
                old = _residuals(flow_weights.get(name), [f.weights for f in flows], name)
                weights = weights_of(one.solution, one.blocks, old, number)
                for recording, combine in one.combines.items():
                    own = gathered_weights.setdefault(recording, {})
                    own[name] = weights.of_gathered(combine)
                flow_weights[name] = weights
            if before and solution and robust_settled(before, solution, number):
                break
            gathered = self._gather(
                replace(self.plan, force_weights=force_weights, flow_weights=gathered_weights)
            )
        again = partial(self._flows_at, gathered_weights)
        hydraulic = self._hydraulics(gathered, _robust_solve(number, solve_iv), again)
        return self._forces(gathered, _robust_solve(number)), hydraulic

    def _force_weights(
        self, gathered: Sequence[Gathered], before: Weights | None, number: int
    ) -> tuple[Solution | None, Weights | None]:
        moments = [g.forces for g in gathered if g.forces is not None]
        solve = _robust_solve(number)
        fit = self._forces(gathered, solve)
        if fit is None:
            return None, None
        blocks = blocks_of(moments)
        solution = replace(solve(blocks), theta=fit.fit.theta, covariance=fit.fit.covariance)
        met = [{"": g.force_weights} for g in gathered if g.force_weights is not None]
        return solution, weights_of(solution, blocks, _residuals(before, met, ""), number)


def _residuals(
    before: Weights | None, met: Sequence[dict[str, Weights]], name: str
) -> Weights | None:
    """The last pass's weights with the residuals that it met in every recording."""
    if before is None:
        return None
    merged: dict[tuple[int, str], Histogram] = {}
    for weights in met:
        if name in weights:
            merged |= weights[name].residuals
    return replace(before, residuals=merged)


def _robust_solve(number: int, solve: Callable[..., Solution] = solve_wls) -> Solve:
    """The solver of a robust pass: the first has no weights by residuals yet."""
    return partial(solve, excess=EXCESS if number else 0.0)


def cleaned_notes(cleaned: Mapping[str, Mapping[str, int]]) -> list[str]:
    """What was taken for outliers; `cleaned`: counts by recording and sensor."""
    return [
        f"{name}: {count} samples of {sensor} taken for outliers and left out"
        for name, counts in cleaned.items()
        for sensor, count in counts.items()
    ]
