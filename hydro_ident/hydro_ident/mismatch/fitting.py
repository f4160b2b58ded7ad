"""Joint refits: base and chosen effects together, by Gauss and Newton on the whitened rows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.chambers import INVERSE_BULK
from hydro_ident.estimate.rows import BoolArray
from hydro_ident.mismatch.bench import Bench
from hydro_ident.mismatch.prediction import DELAY, Model, Predictor, shapes
from hydro_ident.mismatch.settings import BLOCK_S
from hydro_ident.mismatch.state_space import smooth_basis
from hydro_ident.mismatch.whitening import LEAST_NOISE, Layout, Noise, noise_of
from hydro_model.closed_chain import with_parameters
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray, Robot, Valve

#: Step of a derivative as a share of a parameter's size.
_STEP = 1.0e-3
#: A shape parameter moves by no more than this factor per pass.
_FACTOR = 2.0
#: One that has either sign may always move by this share of its bound.
_SIGNED_SHARE = 0.1
#: Parameters that only round a law's corners: fitted, they would turn it into another one.
ROUNDING = {("valve_rate_limit", "time_constant"), ("valve_hysteresis", "time_constant")}
#: Halvings of a step that makes things worse, and the share of improvement below which a fit has
#: settled.
_HALVINGS, _SETTLED = 4, 1.0e-7
#: Cycles of command delay that are the base's own: one, and what fits err by; exactly one where
#: the effect of the same name is in the model.
_CYCLES = 1.1
#: Steps of the delay below this change nothing that could be measured.
_LEAST_DELAY_S = 1.0e-7
_BULK_BOUNDS = (1.0e-10, 1.0e-7)


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known of the base before: values and an inverse square root of the covariance.

    Attributes
    ----------
    root : (m, p) array
        ``root (theta - values)`` has unit variance.
    values : (p,) array
    """

    root: FloatArray
    values: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A model fitted to the training rows.

    Attributes
    ----------
    model : Model
    residual : (N,) array
        Measured less predicted on all rows of the material.
    columns : (N, p) array
        Base columns, then the slopes of every effect's parameters.
    names : tuple of str
    bench : Bench
        Of the residual on the training rows: behind it nothing is left in these columns.
    offset : (m,) array
        How far the base is from what was known of it, in deviations.
    """

    model: Model
    residual: FloatArray
    columns: FloatArray
    names: tuple[str, ...]
    bench: Bench
    offset: FloatArray

    @property
    def start_squares(self) -> float:
        """Sum of squares of the whitened residual before any further linear step."""
        return self.bench.squares

    @property
    def squares(self) -> float:
        """Sum of squares of the whitened residual."""
        return float(self.bench.residual @ self.bench.residual)


@dataclass(frozen=True, slots=True)
class Training:
    """Which rows are fitted, and how they are weighed.

    Attributes
    ----------
    predictor : Predictor
    mask : (N,) bool array
    layout : Layout
        Of the rows in the mask.
    floor : (k,) array
        Least noise of every channel.
    prior : Prior or None
    cycle_s : float
        Sampling interval: the longest command delay that is the base's.
    smooth : tuple of (n_k, m_k) array
        Orthonormal smooth functions of each channel's state on its rows in the mask.
    """

    predictor: Predictor
    mask: BoolArray
    layout: Layout
    floor: FloatArray
    prior: Prior | None
    cycle_s: float
    smooth: tuple[FloatArray, ...] = ()

    @staticmethod
    def of(predictor: Predictor, mask: BoolArray, prior: Prior | None = None) -> Training:
        """Training on some rows of the predictor's material."""
        material = predictor.material
        layout = layout_of(predictor).take(mask)
        floor = np.ones(len(material.channels))
        start = start_model(material.robot, predictor)
        y, _ = predictor.base(start)
        for k in range(floor.size):
            own = y[(material.channel == k) & mask]
            floor[k] = LEAST_NOISE * float(np.std(own)) if own.size else 1.0
        floor[floor <= 0.0] = 1e-300
        steps = [s.trace.step_s for s in material.stretches]
        smooth = tuple(
            smooth_basis(predictor, start, k, (material.channel == k) & mask)
            for k in range(floor.size)
        )
        cycle_s = max(steps, default=0.002)
        return Training(predictor, mask, layout, floor, prior, cycle_s, smooth)

    def noise(self, residual: FloatArray) -> Noise:
        """Noise of a residual on the training rows: what no smooth function of the state tells.

        Physics that the model still lacks is no noise; taken for it, it would be whitened away.
        """
        left = residual[self.mask].copy()
        for k, basis in enumerate(self.smooth):
            own = self.layout.channel == k
            if basis.size:
                rest = left[own] - basis @ (basis.T @ left[own])
                left[own] = rest * np.sqrt(basis.shape[0] / (basis.shape[0] - basis.shape[1]))
        return noise_of(self.layout, left, self.floor)

    def offset(self, model: Model) -> FloatArray:
        """How far a model's base is from what was known of it, in deviations."""
        if self.prior is None:
            return np.zeros(0)
        now = self.predictor.parameters(model)
        return np.asarray(self.prior.root @ (self.prior.values - now))

    def bench(
        self,
        noise: Noise,
        residual: FloatArray,
        columns: FloatArray,
        offset: FloatArray | None = None,
    ) -> Bench:
        """Whitened training rows of a residual."""
        prior = None
        if self.prior is not None:
            extra = columns.shape[1] - self.prior.values.size
            root = np.pad(self.prior.root, ((0, 0), (0, extra)))
            prior = root, np.zeros(root.shape[0]) if offset is None else offset
        return Bench(self.layout, noise, residual[self.mask], columns[self.mask], BLOCK_S, prior)


def layout_of(predictor: Predictor) -> Layout:
    """Layout of all rows of a predictor's material."""
    m = predictor.material
    return Layout(m.channel, m.recording, m.time_s, m.linked)


def start_model(robot: Robot, predictor: Predictor, terms: Sequence[ActiveEffect] = ()) -> Model:
    """The robot's own numbers, without effects but those given."""
    forces = predictor.material.forces
    base = forces.base.combination @ robot.parameter_vector
    friction = [c.viscous_friction for c in robot.cylinders]
    friction += [robot.joints[j].viscous_friction for j in robot.dry_joints]
    theta = np.array([*base, *friction])
    delays = (robot.command_delay_s,) * len(robot.cylinders)
    return Model(replace(robot, effects=()), theta, delays, tuple(terms))


def fit(training: Training, model: Model, noise: Noise | None = None, passes: int = 3) -> Fitted:
    """Refit the base and every effect of a model together.

    Parameters
    ----------
    training : Training
    model : Model
        Start.
    noise : Noise, optional
        How rows are weighed; by default that of the residual, pass by pass.
    passes : int

    Returns
    -------
    Fitted
    """
    current = _at(training, model, noise)
    for _ in range(passes):
        step, factor = current.bench.solve(), 1.0
        for _ in range(_HALVINGS):
            fresh = _at(training, _moved(training, current.model, factor * step), noise)
            better = noise is None or fresh.start_squares <= current.start_squares
            if better:
                break
            factor *= 0.5
        if not better:
            break
        gained = current.start_squares - fresh.start_squares
        current = fresh
        if noise is not None and gained < _SETTLED * max(fresh.start_squares, 1.0):
            break
    return current


def fitted(training: Training, model: Model, noise: Noise | None) -> Fitted:
    """A model as it is, with what a last linear step would still change taken out."""
    return _at(training, model, noise)


def fit_term(
    training: Training, without: Fitted, term: ActiveEffect, noise: Noise, passes: int
) -> Fitted:
    """Fit one more effect, everything else following to first order: quick, for a comparison.

    Parameters
    ----------
    training : Training
    without : Fitted
    term : ActiveEffect
        Start.
    noise : Noise
    passes : int

    Returns
    -------
    Fitted
        Of the model without the effect, with the effect last.
    """
    current = _with_term(training, without, term, noise)
    for _ in range(passes):
        step, factor, better = current.bench.solve()[without.columns.shape[1] :], 1.0, False
        for _ in range(_HALVINGS):
            moved = _stepped(current.model.terms[-1], factor * step)
            fresh = _with_term(training, without, moved, noise)
            better = fresh.squares <= current.squares
            if better:
                break
            factor *= 0.5
        if not better:
            break
        gained, current = current.squares - fresh.squares, fresh
        if gained < _SETTLED * max(current.squares, 1.0):
            break
    return current


def _with_term(training: Training, without: Fitted, term: ActiveEffect, noise: Noise) -> Fitted:
    predictor, model = training.predictor, without.model
    own = predictor.contribution(model, term)
    slopes, names = _slopes(predictor, model, term, own)
    columns = np.concatenate([without.columns, *slopes], axis=1)
    residual = without.residual - own
    bench = training.bench(noise, residual, columns, without.offset)
    whole = (*without.names, *names)
    return Fitted(model.with_term(term), residual, columns, whole, bench, without.offset)


def _at(training: Training, model: Model, noise: Noise | None) -> Fitted:
    residual, columns, names = linearised(training.predictor, model)
    offset = training.offset(model)
    noise = noise or training.noise(_refitted(training, None, residual, columns, offset))
    bench = training.bench(noise, residual, columns, offset)
    if held := _held_delays(training, model, bench.solve()):
        # A bound that holds leaves nothing to fit: what goes beyond it is a finding's.
        columns[:, held] = 0.0
        bench = training.bench(noise, residual, columns, offset)
    return Fitted(model, residual, columns, names, bench, offset)


def _held_delays(training: Training, model: Model, step: FloatArray) -> list[int]:
    """Columns of delays that can take no step: at their bound, or beside one that is listed."""
    longest = _CYCLES * training.cycle_s - _LEAST_DELAY_S
    return [
        at
        for index, at in training.predictor.delay_columns.items()
        if _listed_delay(model) or (step[at] > 0.0 and model.delays_s[index] >= longest)
    ]


def _listed_delay(model: Model) -> bool:
    return any(t.effect.name == DELAY for t in model.terms)


def _refitted(
    training: Training,
    noise: Noise | None,
    residual: FloatArray,
    columns: FloatArray,
    offset: FloatArray,
) -> FloatArray:
    """The residual after a linear refit, for estimating its noise."""
    if noise is None:
        spread = [float(np.std(residual[training.mask & m])) for m in _by_channel(training)]
        white = tuple(np.zeros(0) for _ in spread)
        noise = Noise(white, np.maximum(np.array(spread), training.floor))
    bench = training.bench(noise, residual, columns, offset)
    return np.asarray(residual - columns @ bench.solve())


def _by_channel(training: Training) -> list[BoolArray]:
    material = training.predictor.material
    return [material.channel == k for k in range(len(material.channels))]


def linearised(
    predictor: Predictor, model: Model
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Residual of a model and the slopes of everything in it.

    Returns
    -------
    residual : (N,) array
    columns : (N, p) array
        Slopes of the prediction: base parameters, then every effect's.
    names : tuple of str
    """
    y, x = predictor.base(model)
    residual = y - x @ predictor.parameters(model)
    columns, names = [x], list(predictor.names)
    for term in model.terms:
        own = predictor.contribution(model, term)
        if term.effect.reading is None and not shapes(term):
            residual = residual - own
        slopes, own_names = _slopes(predictor, model, term, own)
        columns += slopes
        names += own_names
    return residual, np.concatenate(columns, axis=1), tuple(names)


def _slopes(
    predictor: Predictor, model: Model, term: ActiveEffect, own: FloatArray
) -> tuple[list[FloatArray], list[str]]:
    """Slopes (N, 1) of a term's contribution in its free parameters, and their names."""
    slopes, names = [], []
    for i, spec in enumerate(term.effect.parameters):
        if _free(term, i):
            step, moved = _step(term, i), term.parameters.copy()
            moved[i] += step
            change = predictor.contribution(model, term, moved) - own
            slopes.append((change / step)[:, None])
            names.append(f"{term.target}.{term.effect.name}.{spec.name}")
    return slopes, names


def _free(term: ActiveEffect, index: int) -> bool:
    """Whether a parameter is fitted; instants are scanned, corners stay as they are."""
    name = term.effect.parameters[index].name
    return name != term.effect.start and (term.effect.name, name) not in ROUNDING


def _step(term: ActiveEffect, index: int) -> float:
    """Step of a derivative, inwards from a bound."""
    spec = term.effect.parameters[index]
    size = abs(term.parameters[index]) or abs(spec.typical) or 1.0
    step = size * (1.0 if spec.linear else _STEP)
    if term.parameters[index] + step > spec.upper:
        return -step
    return step


def _moved(training: Training, model: Model, step: FloatArray) -> Model:
    """The model after a Gauss-Newton step, within physical bounds."""
    predictor = training.predictor
    values = dict(zip(predictor.names, predictor.parameters(model), strict=True))
    count = len(values)
    for name, change in zip(predictor.names, step[:count], strict=True):
        values[name] += float(change)
    robot = with_values(model.robot, values)
    forces = predictor.material.forces.names
    theta = np.array([values.get(n, t) for n, t in zip(forces, model.theta, strict=True)])
    robot = _with_inertia(predictor, robot, theta)
    delays = _delays(training, model, step)
    terms, at = [], count
    for term in model.terms:
        width = sum(_free(term, i) for i in range(len(term.effect.parameters)))
        terms.append(_stepped(term, step[at : at + width]))
        at += width
    return Model(robot, theta, delays, tuple(terms))


def _delays(training: Training, model: Model, step: FloatArray) -> tuple[float, ...]:
    """Delays of the valves after a step, of up to a cycle and what fits err by."""
    result = list(model.delays_s)
    for index, at in training.predictor.delay_columns.items():
        moved = min(max(result[index] + float(step[at]), 0.0), _CYCLES * training.cycle_s)
        if _listed_delay(model):
            moved = training.cycle_s  # The effect is what goes beyond one cycle.
        if abs(moved - result[index]) >= _LEAST_DELAY_S:
            result[index] = moved
    return tuple(result)


def _stepped(term: ActiveEffect, step: FloatArray) -> ActiveEffect:
    """A term after a step of its free parameters, within bounds; shapes move by factors.

    What can be 0, such as a null bias, has either sign: factors would hold it to its first one.
    """
    parameters, changes = term.parameters.copy(), iter(step)
    for i, spec in enumerate(term.effect.parameters):
        if not _free(term, i):
            continue
        change = float(next(changes))
        signed = spec.lower < 0.0 < spec.upper
        if not spec.linear and not signed and parameters[i] != 0.0:
            limit = abs(parameters[i]) * (_FACTOR - 1.0) / _FACTOR
            change = math.copysign(min(abs(change), limit), change)
        parameters[i] = min(max(parameters[i] + change, spec.lower), spec.upper)
    return replace(term, parameters=parameters)


def _with_inertia(predictor: Predictor, robot: Robot, theta: FloatArray) -> Robot:
    """A robot whose links carry the base parameters: changes of it start from there."""
    base = predictor.material.forces.base
    vector = np.zeros(len(robot.parameter_names))
    vector[base.leading] = theta[: len(base.names)]
    return with_parameters(robot, vector)


def with_values(robot: Robot, values: Mapping[str, float]) -> Robot:
    """A robot with fitted bulk moduli and edges; impossible ones stay as they were."""
    cylinders = []
    for cylinder in robot.cylinders:
        inverse = values.get(f"{cylinder.name}.{INVERSE_BULK}", 0.0)
        if _BULK_BOUNDS[0] < inverse < _BULK_BOUNDS[1]:
            cylinder = replace(cylinder, bulk_modulus_pa=1.0 / inverse)
        cylinders.append(cylinder)
    valves = []
    for valve in robot.valves:
        valves.append(with_edges(valve, values))
    return replace(robot, cylinders=tuple(cylinders), valves=tuple(valves))


def with_edges(valve: Valve, values: Mapping[str, float]) -> Valve:
    """A valve with fitted edges; impossible ones stay as they were."""
    c_pa, c_at, c_pb, c_bt = (
        value if (value := values.get(f"{valve.name}.{edge}", 0.0)) > 0.0 else own
        for edge, own in (
            ("c_pa", valve.c_pa),
            ("c_at", valve.c_at),
            ("c_pb", valve.c_pb),
            ("c_bt", valve.c_bt),
        )
    )
    return replace(valve, c_pa=c_pa, c_at=c_at, c_pb=c_pb, c_bt=c_bt)
