"""From recordings to training rows, rows to check on, and the base model refitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.errors import NotEnoughDataError
from hydro_ident.estimate.flows.chambers import chambers_of
from hydro_ident.estimate.forces.force_rows import ForceModel, force_model
from hydro_ident.estimate.forces.standstill import Rest, still_joints
from hydro_ident.estimate.scoring.noise import flow_noise, force_noise
from hydro_ident.estimate.scoring.scores import HoldOut
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.identify.command_updates import update_notes, with_updates
from hydro_ident.identify.survey import (
    Survey,
    by_torques,
    merged_signals,
    recorded_notes,
    still_positions,
)
from hydro_ident.mismatch.fitting.as_listed import with_listed
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.fitting.prior import (
    fixed_prior,
    open_notes,
    parts_prior,
    with_ripples,
    with_skews,
)
from hydro_ident.mismatch.fitting.slowness import settled
from hydro_ident.mismatch.fitting.training import Training, start_model
from hydro_ident.mismatch.rows.choices import Choices, choices_of
from hydro_ident.mismatch.rows.laying import material_of
from hydro_ident.mismatch.rows.material import Material
from hydro_ident.mismatch.rows.off_centre import OffCentre, read_rightly, without_errors
from hydro_ident.mismatch.rows.prediction import Predictor
from hydro_ident.mismatch.rows.telling import telling
from hydro_ident.mismatch.rows.whole import read_whole
from hydro_ident.mismatch.settings import LONGEST_SCAN_S, DiagnosisSettings
from hydro_ident.mismatch.split.check import Check, elsewhere, held_back
from hydro_ident.mismatch.split.listed_friction import bristled
from hydro_ident.mismatch.split.one_pressure import half_read, none_left
from hydro_ident.mismatch.split.parts import (
    hardly_held,
    length_s,
    partly,
    split_of,
    spread_parts,
    thinly,
)
from hydro_ident.mismatch.trials.scoring import Bank
from hydro_ident.recordings.cleaning import GROSS, Cleaner
from hydro_ident.recordings.sources import Source
from hydro_model.arrays import BoolArray
from hydro_model.effects.catalogue import resolve
from hydro_model.multibody.rigid_body import mass_matrix
from hydro_model.robot import FloatArray, Robot


@dataclass(frozen=True, slots=True)
class Residuals:
    """Everything that the steps after this one look at.

    Attributes
    ----------
    robot : Robot
        As given.
    training : Training
    base : Fitted
        The robot's own structure, refitted (or as given, with a fixed base).
    scan : Training
        What effects are searched on: the training rows, of long recordings evenly spread parts.
    check : Check
    check_traces : tuple of Trace
        For roll-outs.
    split : HoldOut
        Which blocks of them took no part.
    signals : SignalSurvey
    notes : tuple of str
        What was found about the recordings on the way.
    bank : Bank
        What effects would look like in the rows of `scan`.
    processes : int
        How many fits may go on side by side.
    off : tuple of OffCentre
        Errors of position sensors that were taken out of all recordings.
    """

    robot: Robot
    training: Training
    base: Fitted
    scan: Training
    check: Check
    check_traces: tuple[Trace, ...]
    split: HoldOut
    signals: SignalSurvey
    notes: tuple[str, ...]
    bank: Bank
    processes: int = 1
    off: tuple[OffCentre, ...] = ()

    def noise_floors(self, traces: Sequence[Trace] | None = None) -> dict[str, float]:
        """What the sensors' noise alone leaves, by channel.

        Parameters
        ----------
        traces : sequence of Trace, optional
            Whose sensors; by default those of what is fitted.
        """
        signals = self.signals if traces is None else SignalSurvey.of(self.robot, traces)
        material = self.training.predictor.material
        floors = dict(
            zip(
                material.forces.channels,
                force_noise(
                    material.forces, signals, material.filters, self._robot_that_moves(signals)
                ).tolist(),
                strict=True,
            )
        )
        for chamber in chambers_of(self.robot):
            cylinder = self.base.model.robot.cylinders[chamber.index]
            floors[chamber.channel] = flow_noise(
                self.robot, chamber, signals, material.windows,
                1.0 / cylinder.bulk_modulus_pa,
            )  # fmt: skip
        return {name: float(floors[name]) for name in material.channels}

    def _robot_that_moves(self, signals: SignalSurvey) -> Robot:
        """With inertia as fitted, or as given where what the base lacks has taken that below 0.

        What such a base makes of the encoders' noise says nothing of the machine's.
        """
        found = self.base.model.robot
        able = (r for r in (found, self.robot) if _can_move(r, signals.pose))
        return next(able, found)


def _can_move(robot: Robot, pose: FloatArray) -> bool:
    """Whether a robot's inertia resists every motion."""
    return bool(np.linalg.eigvalsh(np.asarray(mass_matrix(robot, pose)))[0] > 0.0)


def own_forces(robot: Robot, torque: bool) -> ForceModel:
    """The robot's force model: with bodies of cylinders only where its file has them.

    An identified robot's file has them where its base parameters name one; what it was read to
    has an array for them in any case.

    `torque` is as for `force_model`.
    """
    has = any(c.barrel is not None or c.rod is not None for c in robot.cylinders)
    named = {own.name for own in robot.base_parameters} & set(robot.part_names)
    given = not robot.base_parameters and robot.part_inertia is not None
    return force_model(robot, torque, parts=has or bool(named) or given)


def residuals(
    robot: Robot,
    sources: Sequence[Source],
    others: Sequence[Source],
    surveys: Sequence[Survey],
    settings: DiagnosisSettings,
    off: Sequence[OffCentre] = (),
) -> Residuals | None:
    """Lay out rows and refit the base.

    Parameters
    ----------
    robot : Robot
    sources, others : sequence of Source
        To fit and select on; to verify on.
    surveys : sequence of Survey
        Of the sources, then of the others.
    settings : DiagnosisSettings
    off : sequence of OffCentre
        Errors of position sensors, which are taken out of all recordings.

    Returns
    -------
    Residuals or None
        None where no channel has enough rows.

    Raises
    ------
    NotEnoughDataError
        There are recordings to verify on, and none has a row.
    """
    signals = merged_signals(robot, surveys[: len(sources)])
    torque = by_torques(surveys[: len(sources)])
    forces = own_forces(robot, torque)
    locked = still_joints(robot, signals)
    still = read_rightly(still_positions(surveys, locked), off)
    sources, others = with_updates(robot, sources, others, surveys)
    cleaner = Cleaner.of(robot, signals, GROSS)
    whole, recorded, cleaned = read_whole(sources, others, cleaner)
    if not whole:
        return None
    whole, recorded = (without_errors(robot, one, off) for one in (whole, recorded))
    traces, looked_at = (spread_parts(whole, s) for s in (settings.longest_s, LONGEST_SCAN_S))
    choices = choices_of(forces, signals, whole, recorded)
    every = 0 if others else settings.hold_out_every
    split = split_of(surveys[: len(sources)], every, choices, whole, traces)
    if not torque:
        choices = settled(robot, forces, looked_at, choices, still, signals, split)
    laid = _Laid(robot, forces, choices, still, whole)
    material = laid.material(traces)
    fit_rows, check_rows = material.masks(split)
    moving = telling(material, signals)
    predictor = Predictor(material)
    if not _enough(material, fit_rows & moving, len(predictor.names)):
        return None
    training, base = _refitted(robot, predictor, fit_rows & moving, settings)
    notes = (*cleaner.notes, *_notes(surveys, choices, cleaned))
    notes += partly("fitted", whole, traces) + tuple(update_notes((*sources, *others)))
    notes += open_notes(predictor, robot) if settings.fixed_base else ()
    scan = training
    if looked_at is not whole:
        scan = _searched(laid, looked_at, split, signals, training)
        notes += thinly(training, scan, length_s(looked_at) / length_s(traces))
    if others:
        traces = spread_parts(recorded, settings.longest_s)
        unlocked = {s.name: [j for j in locked if j not in still[s.name]] for s in surveys}
        lost = none_left(half_read(robot, surveys[: len(sources)], surveys[len(sources) :]))
        there = _material_there(laid, traces, others, lost)
        check, said = elsewhere(there, training, signals, unlocked, still)
        notes += partly("verified on", recorded, traces) + said
    else:
        notes += hardly_held(material, fit_rows, check_rows) if every else ()
        check = held_back(training, check_rows, moving)
    found = robot, training, base, scan, check, traces, split, signals, notes
    return Residuals(*found, Bank(scan.predictor), settings.processes, tuple(off))


def _searched(
    laid: _Laid,
    traces: Sequence[Trace],
    split: HoldOut,
    signals: SignalSurvey,
    training: Training,
) -> Training:
    """Rows of parts of what is fitted, which may lack channels that all of it has."""
    material = laid.material(traces)
    rows = material.masks(split)[0] & telling(material, signals)
    predictor = Predictor(material)
    return Training.of(predictor, rows, training.known(predictor), training.as_listed)


def _material_there(
    laid: _Laid, traces: Sequence[Trace], others: Sequence[Source], lost: str
) -> Material:
    """Rows to verify on; where there are none, not the fitted recordings are to blame.

    `lost` says what pressures they lack that the fitted ones have.
    """
    there = laid.material(traces)
    if there.size:
        return there
    raise NotEnoughDataError(
        lost
        or f"{', '.join(s.name for s in others)}: expected rows to verify on, found none: take a"
        " longer recording, of every joint in motion, or none, and every fifth block of the others"
        " is kept for it"
    )


def _refitted(
    robot: Robot, predictor: Predictor, rows: BoolArray, settings: DiagnosisSettings
) -> tuple[Training, Fitted]:
    """The training rows with what is known before, and the base refitted to them.

    The readings' ripple is known only once a first fit has told stiffness and delay.
    """
    start = start_model(robot, predictor, resolve(robot))
    before = fixed_prior if settings.fixed_base else parts_prior
    prior = with_skews(before(predictor, robot, predictor.parameters(start)), predictor)
    training, base = with_listed(Training.of(predictor, rows, prior), start)
    base = bristled(training, base)
    std = np.sqrt(np.maximum(np.diag(base.covariance), 0.0))
    prior = with_ripples(prior, predictor, base.model, std, training.cycle_s)
    training = replace(training, prior=prior)
    return training, fit(training, base.model)


@dataclass(frozen=True, slots=True)
class _Laid:
    """How every recording is laid out as rows, to fit, to search and to verify on."""

    robot: Robot
    forces: ForceModel
    choices: Choices
    still: Mapping[str, Mapping[int, Rest]]
    whole: tuple[Trace, ...] = ()

    def material(self, traces: Sequence[Trace]) -> Material:
        step_s = min((t.step_s for t in traces), default=0.002)
        choices = self.choices
        return material_of(
            self.robot, self.forces, traces, choices.filters, choices.windows(step_s),
            self.still, choices.rest_speed, self.whole,
        )  # fmt: skip


def _notes(
    surveys: Sequence[Survey], choices: Choices, cleaned: Mapping[str, int]
) -> tuple[str, ...]:
    """What was found about the recordings on the way, each once."""
    outliers = [f"{count} readings of {name} are outliers: left out" for name, count in
                cleaned.items()]  # fmt: skip
    return tuple(dict.fromkeys((*recorded_notes(surveys), *choices.notes, *outliers)))


def _enough(material: Material, rows: BoolArray, parameters: int) -> bool:
    counts = np.bincount(material.channel[rows], minlength=len(material.channels))
    return bool(counts.size and counts.max(initial=0) > max(10 * parameters, 100))
