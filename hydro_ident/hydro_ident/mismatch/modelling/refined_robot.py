"""The unknowns of a refinement as a robot: parameters of effects, and a base that they share."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.flows.chambers import INVERSE_BULK
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.stepping import is_free, moved, with_values
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.modelling.model import spec_of
from hydro_ident.mismatch.modelling.shooting import Unknowns
from hydro_ident.mismatch.modelling.shots import Shots
from hydro_ident.mismatch.rows.base_columns import DELAY
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_model.effects.targets import ActiveEffect
from hydro_model.multibody.closed_chain import with_parameters
from hydro_model.robot import FloatArray, Robot

#: Step of a derivative as a share of a parameter's size; of the base, in its deviations.
_STEP, _BASE_STEP = 0.01, 1.0
#: Directions of the base that are known this well beside the best known are left as they are.
_LEAST = 1.0e-6


@dataclass(frozen=True, slots=True, eq=False)
class Refinable:
    """A fit with its unknowns: the effects' free parameters, then directions of the base.

    Attributes
    ----------
    predictor : Predictor
    fit : Fitted
    given : Robot
        What the fit describes.
    labels : tuple of (str, str)
        Name and unit of the effects' free parameters.
    directions : (b, k) array
        Steps of the base by `Predictor.names`, each a deviation of what the fit knows.
    unknowns : Unknowns
    """

    predictor: Predictor
    fit: Fitted
    given: Robot
    labels: tuple[tuple[str, str], ...]
    directions: FloatArray
    unknowns: Unknowns

    @staticmethod
    def of(predictor: Predictor, fit: Fitted, given: Robot, fixed_base: bool) -> Refinable:
        """The unknowns of a fit; with a fixed base the effects' alone."""
        labels, rows = list[tuple[str, str]](), list[tuple[float, float, float, float]]()
        for term in fit.model.terms:
            for i, spec in enumerate(term.effect.parameters):
                if is_free(term, i):
                    value = float(term.parameters[i])
                    step = _STEP * (abs(value) or abs(spec.typical) or 1.0)
                    labels.append((f"{term.target}.{term.effect.name}.{spec.name}", term.units[i]))
                    rows.append((value, spec.lower, spec.upper, step))
        directions = np.zeros((len(predictor.names), 0))
        if not fixed_base:
            directions = _directions(predictor, fit, given)
        count = directions.shape[1]
        rows += [(0.0, -np.inf, np.inf, _BASE_STEP)] * count
        start, lower, upper, step_ = np.array(rows).T
        once = np.arange(start.size) >= len(labels)
        information = _information(fit, [name for name, _ in labels], directions)
        unknowns = Unknowns(start, lower, upper, step_, once, information)
        return Refinable(predictor, fit, given, tuple(labels), directions, unknowns)

    @property
    def start(self) -> FloatArray:
        """The fit's own numbers."""
        return self.unknowns.start

    @property
    def free(self) -> int:
        """Parameters of effects."""
        return len(self.labels)

    def seen_by(self, there: Model) -> Refinable:
        """The same unknowns, of effects that come and go as in other recordings.

        Parameters
        ----------
        there : Model
            The fit's, as `at_own_instants`.
        """
        return replace(self, fit=replace(self.fit, model=there))

    def terms(self, x: FloatArray) -> tuple[ActiveEffect, ...]:
        """The effects at a point."""
        values, result = iter(x[: self.free].tolist()), []
        for term in self.fit.model.terms:
            own = term.parameters.copy()
            for i in range(own.size):
                if is_free(term, i):
                    own[i] = next(values)
            result.append(replace(term, parameters=own))
        return tuple(result)

    def robot(self, x: FloatArray) -> Robot:
        """The robot at a point."""
        robot = replace(self.given, effects=tuple(spec_of(term) for term in self.terms(x)))
        step = self._base_step(x)
        return robot if not step.any() else _stepped(self.predictor, robot, step)

    def model(self, training: Training, x: FloatArray) -> Model:
        """The fit's model at a point."""
        step = np.concatenate([self._base_step(x), np.zeros(self.free)])
        return replace(moved(training, self.fit.model, step), terms=self.terms(x))

    def errors(self, shots: Shots, x: FloatArray) -> list[FloatArray | None]:
        """Errors of roll-outs at a point, by window."""
        return shots.errors(self.robot(x), self.terms(x))

    def covariance(self, whole: Fitted, own: FloatArray) -> FloatArray:
        """Covariance by `Fitted.names` of a refinement whose unknowns have the covariance `own`.

        What was not refined keeps the fit's.
        """
        rows, at = len(self.predictor.names), [whole.names.index(name) for name, _ in self.labels]
        into = np.zeros((len(whole.names), own.shape[0]))
        into[at, range(self.free)] = 1.0
        into[:rows, self.free :] = self.directions
        fresh, result = into @ own @ into.T, whole.bench.covariance.copy()
        refined = np.flatnonzero(np.diag(fresh) > 0.0)
        result[refined, :] = result[:, refined] = 0.0
        result[np.ix_(refined, refined)] = fresh[np.ix_(refined, refined)]
        return result

    def with_deviations(self, robot: Robot, covariance: FloatArray) -> Robot:
        """The robot with the deviations of a covariance by `Fitted.names`."""
        sizes = np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
        fresh = dict(robot.standard_deviations)
        modulus = {f"{c.name}.{INVERSE_BULK}": c.bulk_modulus_pa for c in robot.cylinders}
        for name, size in zip(self.fit.names, sizes, strict=True):
            plain = name.replace(INVERSE_BULK, "bulk_modulus")
            if plain in fresh and np.isfinite(size) and size > 0.0:
                fresh[plain] = size * modulus[name] ** 2 if name in modulus else size
        delays = [sizes[k] for k, n in enumerate(self.predictor.names) if n.endswith(DELAY)]
        if DELAY in fresh and max(delays, default=0.0) > 0.0:
            fresh[DELAY] = max(delays)
        known, inertial = robot.base_covariance, len(self.predictor.material.forces.base.names)
        if known is not None and len(known) == inertial and self.directions.size:
            mask = np.diag(known) > 0.0
            known = np.where(np.outer(mask, mask), covariance[:inertial, :inertial], 0.0)
        return replace(robot, standard_deviations=fresh, base_covariance=known)

    def _base_step(self, x: FloatArray) -> FloatArray:
        return np.asarray(self.directions @ x[self.free :])


def _directions(predictor: Predictor, fit: Fitted, given: Robot) -> FloatArray:
    """Principal directions of what the fit leaves open of the base, as deviations, (b, k)."""
    count = len(predictor.names)
    covariance = fit.covariance[:count, :count]
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = np.isfinite(size) & (size > 0.0)
    inertial = len(predictor.material.forces.base.names)
    if predictor.names[0] in predictor.material.forces.names:
        determined = np.zeros(inertial, dtype=bool)
        if given.base_covariance is not None and len(given.base_covariance) == inertial:
            determined = np.diag(given.base_covariance) > 0.0
        known[:inertial] &= determined
    size = np.where(known, size, 0.0)
    at = np.flatnonzero(known)
    values, vectors = np.linalg.eigh(covariance[np.ix_(at, at)] / np.outer(size[at], size[at]))
    open_ = values > _LEAST * max(values.max(initial=0.0), 1e-300)
    result = np.zeros((count, int(open_.sum())))
    result[at] = size[at, None] * vectors[:, open_] * np.sqrt(values[open_])
    return result


def _information(fit: Fitted, names: list[str], directions: FloatArray) -> FloatArray:
    """What the fit knows of effects and base together: an inverse covariance.

    Nothing of a parameter that it has no deviation of.
    """
    rows, count = directions.shape
    whole, at = fit.covariance, [fit.names.index(name) for name in names]
    # Least-squares inverse of the directions: coordinates of a step of the base.
    into = np.linalg.pinv(directions)
    size = len(at) + count
    covariance = np.eye(size)
    covariance[: len(at), : len(at)] = whole[np.ix_(at, at)]
    cross = whole[np.ix_(at, range(rows))] @ into.T
    covariance[: len(at), len(at) :], covariance[len(at) :, : len(at)] = cross, cross.T
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = np.isfinite(deviation) & (deviation > 0.0)
    own = deviation[known]
    scaled = covariance[np.ix_(known, known)] / np.outer(own, own)
    values, vectors = np.linalg.eigh(scaled)
    inverse = (vectors / np.maximum(values, _LEAST * values.max(initial=1.0))) @ vectors.T
    result = np.zeros((size, size))
    result[np.ix_(known, known)] = inverse / np.outer(own, own)
    return result


def _stepped(predictor: Predictor, robot: Robot, step: FloatArray) -> Robot:
    """The robot after a step of its base."""
    change = dict(zip(predictor.names, step.tolist(), strict=True))
    values = {}
    for cylinder in robot.cylinders:
        name = f"{cylinder.name}.{INVERSE_BULK}"
        if name in change:
            values[name] = 1.0 / cylinder.bulk_modulus_pa + change[name]
    for valve in robot.valves:
        for edge in ("c_pa", "c_at", "c_pb", "c_bt"):
            name = f"{valve.name}.{edge}"
            if name in change:
                values[name] = float(getattr(valve, edge)) + change[name]
    robot = with_values(robot, values)
    cylinders = []
    for cylinder in robot.cylinders:
        viscous = change.get(f"{cylinder.name}.viscous_friction", 0.0)
        fresh = max(cylinder.viscous_friction + viscous, 0.0)
        cylinders.append(replace(cylinder, viscous_friction=fresh))
    delays = [change[name] for name in predictor.names if name.endswith(DELAY)]
    delay_s = robot.command_delay_s + (float(np.mean(delays)) if delays else 0.0)
    robot = replace(robot, cylinders=tuple(cylinders), command_delay_s=max(delay_s, 0.0))
    return _with_inertia(predictor, robot, change)


def _with_inertia(predictor: Predictor, robot: Robot, change: dict[str, float]) -> Robot:
    """The robot after a step of its base inertial parameters."""
    base = predictor.material.forces.base
    own = np.array([change.get(name, 0.0) for name in base.names])
    if not own.any():
        return robot
    vector = np.array(robot.parameter_vector, dtype=float)
    vector[list(base.leading)] += own
    listed = tuple(
        replace(one, value=one.value + float(change.get(one.name, 0.0)))
        for one in robot.base_parameters
    )
    return replace(with_parameters(robot, vector), base_parameters=listed)
