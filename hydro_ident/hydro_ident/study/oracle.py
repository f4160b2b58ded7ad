"""What could be said of a case by someone who was told what is hidden in it.

Runs where the truth is known, once the diagnosis has answered. The catalogue's laws of the true
names are fitted, with the base, to the training recording at the true places: what they leave on
the check recording is what no diagnosis can be asked to beat. And every other law of the
catalogue is fitted in the true one's place, by the diagnosis' own rule of evidence: the set that
remains is one that the recording cannot split.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hydro_ident.identify.survey import survey_source
from hydro_ident.mismatch.fitting.fitted import Fitted, fitted
from hydro_ident.mismatch.fitting.fitting import ONE_STEP, fit, fit_term
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.fitting.whitening import Noise
from hydro_ident.mismatch.naming.contest import CONTENDER_SHARE, CONTENDERS
from hydro_ident.mismatch.naming.instants import at_own_instants
from hydro_ident.mismatch.naming.name import Searcher
from hydro_ident.mismatch.settings import DiagnosisSettings
from hydro_ident.mismatch.split.residuals import Residuals, residuals
from hydro_ident.mismatch.trials.candidates import Trial, trials
from hydro_ident.mismatch.trials.chance import overdispersion
from hydro_ident.mismatch.trials.scoring import Score, bank_of, score
from hydro_ident.recordings.sources import bag_source
from hydro_ident.study.summary import STRONG
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

#: Shapes of a true law from which its fit starts; the best end wins.
_STARTS = 3
_ROUGH, _PASSES, _LAST = 6, 4, 2


def oracle_case(folder: Path, truth: Mapping[str, Any]) -> dict[str, Any] | None:
    """The oracle's answer to one case.

    Parameters
    ----------
    folder : Path
        Of the case's recordings and robot file.
    truth : mapping
        As `generate.truth_record`.

    Returns
    -------
    dict or None
        `rmse` (held-out error of the true structure, by channel), `set` (names that the recording
        cannot split from the true one, it first; of strong single effects in work cycles, else
        None) and `cpu_seconds`. None of clean cases, of effects outside the catalogue, and where a
        refit of the base swallows a true law.
    """
    effects = list(truth["effects"])
    if not effects or not all(effect["known"] for effect in effects):
        return None
    start = time.process_time()
    work = residuals_of(folder)
    whole = None if work is None else true_fit(work.training, work.base, effects)
    if work is None or whole is None:
        return None
    alone = truth["kind"] == "single" and truth["motion"] == "work"
    names = None
    if alone and effects[0]["ratio"] >= STRONG:
        names = unsplit(work.training, work.base, whole)
    return {
        "rmse": held_out(work, whole),
        "set": names,
        "cpu_seconds": time.process_time() - start,
    }


def residuals_of(folder: Path) -> Residuals | None:
    """A case's rows and refitted base, as the diagnosis lays them out."""
    (file,) = folder.glob("*.hydraulics.yaml")
    robot = load_robot(file)
    sources, others = (
        [bag_source(bag, robot) for bag in sorted((folder / part).iterdir())]
        for part in ("train", "check")
    )
    surveys = [survey_source(source, robot) for source in (*sources, *others)]
    return residuals(robot, sources, others, surveys, DiagnosisSettings())


def held_out(work: Residuals, whole: Fitted) -> dict[str, float]:
    """Error of a model on the check recording, by channel.

    `whole` is the fitted model.
    """
    there, _ = at_own_instants(work.training, work.check, whole.model)
    left, channels = work.check.residual(there), work.training.predictor.material.channels
    rows = {name: work.check.rows(k, name) for k, name in enumerate(channels)}
    return {n: float(np.sqrt(np.mean(left[r] ** 2))) for n, r in rows.items() if r.any()}


def true_fit(
    training: Training, base: Fitted, effects: Sequence[Mapping[str, Any]]
) -> Fitted | None:
    """Base and the true effects' laws at their true places, fitted together.

    Parameters
    ----------
    training : Training
    base : Fitted
        Without any of them.
    effects : sequence of mapping
        `name`, `target` (a joint, or the robot) and `ratio` of each.

    Returns
    -------
    Fitted or None
        None where nothing is left of a law beyond what a refit takes up.
    """
    current = base
    for effect in sorted(effects, key=lambda e: -float(e["ratio"])):
        predictor = training.predictor
        own = [
            trial
            for trial in trials(predictor, current.model, [effect["name"]])
            if _acts_at(predictor.material.robot, trial, effect["target"])
        ]
        scores = _scores(training, current, own)
        if not scores:
            return None
        current = _added(training, current, scores[:_STARTS])
    return fit(training, current.model, passes=_LAST)


def _acts_at(robot: Robot, trial: Trial, target: str) -> bool:
    """Whether a trial acts on the joint, or the cylinder of the joint, that a truth names."""
    one = trial.active
    if target not in robot.joint_names or (one.cylinder is None and one.joint is None):
        return True
    joint = robot.cylinders[one.cylinder].joint if one.cylinder is not None else None
    return joint == target or (one.joint is not None and robot.joint_names[one.joint] == target)


def _joint_of(training: Training, term: ActiveEffect) -> str:
    """The joint that an effect acts on, or the robot."""
    robot = training.predictor.material.robot
    if term.cylinder is not None:
        return robot.cylinders[term.cylinder].joint
    return robot.name if term.joint is None else robot.joint_names[term.joint]


def _scores(training: Training, current: Fitted, own: Sequence[Trial]) -> list[Score]:
    entries = bank_of(training.predictor, current.model, own)
    found = [s for e in entries if (s := score(current.bench, e, training.mask)) is not None]
    return sorted(found, key=lambda s: -s.value)


def _added(training: Training, current: Fitted, starts: Sequence[Score]) -> Fitted:
    """The model with one more effect, from the start that ends best."""
    noise = _noise_without(training, current, starts[0])
    without = fitted(training, current.model, noise)
    terms = [s.entry.trial.at(s.coefficients) for s in starts]
    rough = [fit_term(training, without, term, noise, _ROUGH) for term in terms]
    best = min(rough, key=lambda one: one.squares)
    return fit(training, fit(training, best.model, noise, _PASSES).model, passes=ONE_STEP)


def _noise_without(training: Training, current: Fitted, best: Score) -> Noise:
    """Noise of what is left once the best shape of a law is taken out."""
    used = best.coefficients != 0.0
    columns = best.entry.columns(current.residual.size)[:, used]
    joined = np.concatenate([current.columns, columns], axis=1)
    bench = training.bench(current.bench.noise, current.residual, joined, current.offset)
    return training.noise(current.residual - joined @ bench.solve())


def unsplit(training: Training, base: Fitted, whole: Fitted) -> list[str]:
    """Names of the catalogue that fit in the true one's place as well as evidence can tell.

    Parameters
    ----------
    training : Training
    base : Fitted
        Without the true effect.
    whole : Fitted
        With it, and nothing else.

    Returns
    -------
    list of str
        The true name first. Laws of other joints than the true one's are not tried.
    """
    (term,), noise = whole.model.terms, whole.bench.noise
    model = replace(base.model, terms=())
    without = fitted(training, model, noise)
    left = fitted(training, whole.model, noise).bench.residual
    bench = training.bench(noise, without.residual, without.columns, without.offset)
    robot, joint = training.predictor.material.robot, _joint_of(training, term)
    chosen = [t for t in trials(training.predictor, model) if _acts_at(robot, t, joint)]
    entries = bank_of(training.predictor, model, chosen)
    chance = bench.witness(left)
    scores = [s for e in entries if (s := score(bench, e, training.mask, chance)) is not None]
    rivals = dict[tuple[str, str], Score]()
    for one in sorted(scores, key=lambda s: -s.value):
        rivals.setdefault((one.entry.trial.name, one.entry.trial.target), one)
    gain = without.squares - float(left @ left)
    rivals.pop((term.effect.name, term.target), None)
    close = [s for s in rivals.values() if s.value >= CONTENDER_SHARE * gain][:CONTENDERS]
    terms = [term, *(s.entry.trial.at(s.coefficients) for s in close)]
    spread = overdispersion(max(scores, key=lambda s: s.value))
    named = Searcher(training, base).contest.weighed(without, terms, noise, spread)
    return list(dict.fromkeys([term.effect.name, *named.names]))
