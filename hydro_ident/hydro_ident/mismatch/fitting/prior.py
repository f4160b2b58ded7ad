"""What is known of the base before any fit: a base that is kept, or bodies of cylinders.

The moments of a barrel or rod are small beside a link's, and a fit that is free to choose them
takes whatever the robot file lacks for them: a barrel of 10 kg m came out as 1200 where a spring
in a counterbalance valve was left out. The file, or steel of the cylinder's size, says about how
large they can be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.estimate.flows.chambers import INVERSE_BULK
from hydro_ident.estimate.forces.closed_chain import expected_sizes
from hydro_ident.mismatch.rows.base_columns import DELAY
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_ident.mismatch.rows.ripple import in_step, known_ripple
from hydro_ident.mismatch.rows.skew import usual_skew
from hydro_model.multibody.base_parameters import BaseMap
from hydro_model.robot import STANDARD_PARAMETERS, FloatArray, Robot

#: What is held without a known deviation is held to this share of its size.
_HELD = 1.0e-6
#: What a kept base may leave open, in words, and how its names end.
_OPEN = (
    ("base parameters that its covariance has nothing of", STANDARD_PARAMETERS),
    ("viscous friction", ("viscous_friction",)),
    ("bulk moduli", (INVERSE_BULK,)),
    ("valve edges", ("c_pa", "c_at", "c_pb", "c_bt")),
    ("command delays", (DELAY,)),
)
#: Deviation of a barrel's or rod's parameter as a share of what the file or its steel says.
_PARTS = 1.0


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known of the base before: values and an inverse square root of the covariance.

    Attributes
    ----------
    root : (m, p) array
        ``root (theta - values)`` has unit variance.
    values : (p,) array
        Of delays what they come to, not their step, s.
    kept : int
        How many of the first rows are of a base that is kept as given.
    """

    root: FloatArray
    values: FloatArray
    kept: int = 0

    def moved(self, step: FloatArray) -> float:
        """How far a step (p,) would move a base that is kept, in deviations; 0 of another one."""
        return float(np.abs(self.root[: self.kept] @ step).max(initial=0.0))

    def deviations(self) -> FloatArray:
        """What a kept base's numbers are known to, (p,); infinite of those that it leaves open."""
        result, root = np.full(self.values.size, np.inf), self.root[: self.kept]
        held = np.flatnonzero(root.any(axis=0))
        inverse = np.linalg.pinv(root[:, held])
        result[held] = np.sqrt(np.sum(inverse**2, axis=1))
        return result

    def rows(self, columns: int) -> FloatArray:
        """The root for a fit of so many columns, those of the base first, (m, columns)."""
        return np.pad(self.root, ((0, 0), (0, columns - self.values.size)))

    def taken(self, names: Sequence[str], own: Sequence[str]) -> Prior:
        """What of it is of some parameters, in their order; nothing of those it lacks.

        Parameters
        ----------
        names : sequence of str
            Of its own parameters.
        own : sequence of str
        """
        root, values = np.zeros((self.root.shape[0], len(own))), np.zeros(len(own))
        for k, name in enumerate(own):
            if name in names:
                at = list(names).index(name)
                root[:, k], values[k] = self.root[:, at], self.values[at]
        known = np.asarray(root.any(axis=1))
        return Prior(root[known], values, int(np.count_nonzero(known[: self.kept])))


def left_open(predictor: Predictor, given: Robot) -> list[str]:
    """What a base that is kept leaves to a fit, by `Predictor.names`.

    Of edges, moduli, friction and delays those whose deviation the file does not state: nobody
    has identified them, and how far they are from a datasheet is no finding. Of the links' base
    parameters, where the file has a covariance, those without a variance in it: they were not
    determined, and their values are the datasheet's. And ripples and skews, which are of the
    readings, not of the machine.

    Parameters
    ----------
    predictor : Predictor
    given : Robot
    """
    base = predictor.material.forces.base
    inertial = base.names if _has_forces(predictor) else ()
    known = _base_covariance(given, base)
    links = zip(inertial[: base.link_count], np.diag(known), strict=False)
    open_links = {name for name, own in links if given.base_covariance is not None and own <= 0.0}
    return [
        name
        for name in predictor.names
        if name in open_links
        or (name not in inertial and _stated(given, name) not in given.standard_deviations)
    ]


def movable(predictor: Predictor, given: Robot) -> list[str]:
    """What a kept base may move, by `Predictor.names`: what it leaves open or states to within.

    What its file states no deviation of, and is held all the same, stays as it is there.

    Parameters
    ----------
    predictor : Predictor
    given : Robot
    """
    inertial = predictor.material.forces.base.names if _has_forces(predictor) else ()
    known = inertial if given.base_covariance is not None else ()
    kept_open = left_open(predictor, given)
    return [
        name
        for name in predictor.names
        if name in kept_open
        or name in known
        or float(given.standard_deviations.get(_stated(given, name), 0.0)) > 0.0
    ]


def open_notes(predictor: Predictor, given: Robot) -> tuple[str, ...]:
    """What of the machine a base that is kept leaves open, as a note; none where it is nothing.

    Parameters
    ----------
    predictor : Predictor
    given : Robot
    """
    ends = tuple(name.rpartition(".")[2] for name in left_open(predictor, given))
    kinds = [words for words, own in _OPEN if any(end in own for end in ends)]
    if not kinds:
        return ()
    return (
        "the base is kept but for what the robot file states no deviation of, which is fitted:"
        f" {', '.join(kinds)}",
    )


def _stated(given: Robot, name: str) -> str:
    """Under what name a file states how well it knows a number."""
    if name in {f"{valve.name}.{DELAY}" for valve in given.valves}:
        return DELAY
    return name.replace(INVERSE_BULK, "bulk_modulus")


def _base_covariance(given: Robot, base: BaseMap) -> FloatArray:
    """Covariance that a file states of base parameters, by name; zero of those it lacks.

    A file of another cylinder model has other base parameters than the base of a fit.
    """
    result = np.zeros((len(base.names), len(base.names)))
    stated = {own.name: i for i, own in enumerate(given.base_parameters)}
    if given.base_covariance is not None:
        into = [k for k, name in enumerate(base.names) if name in stated]
        at = [stated[base.names[k]] for k in into]
        result[np.ix_(into, into)] = given.base_covariance[np.ix_(at, at)]
    return result


def fixed_prior(predictor: Predictor, given: Robot, values: FloatArray) -> Prior:
    """What a base that is kept as given is known to: its covariance where its file has one.

    Nothing is said of what it leaves open (`left_open`). What a covariance has nothing of barrels
    and rods leaves them at about their size, as `parts_prior`.

    Parameters
    ----------
    predictor : Predictor
    given : Robot
    values : (p,) array
        Its numbers by `Predictor.names`.
    """
    forces, names, values = predictor.material.forces, predictor.names, values.copy()
    values[list(predictor.delay_columns.values())] = given.command_delay_s
    variance = np.diag((_HELD * np.maximum(np.abs(values), 1e-12)) ** 2)
    count = len(forces.base.names)
    if _has_forces(predictor) and given.base_covariance is not None:
        known = _base_covariance(given, forces.base)
        # Those of the links are left open.
        sizes = np.nan_to_num(expected_sizes(given, forces.base), posinf=0.0)
        unknown = np.diag(known) <= 0.0
        variance[:count, :count] += known + np.diag(np.where(unknown, _PARTS * sizes, 0.0) ** 2)
    for i, name in enumerate(names):
        std = float(given.standard_deviations.get(_stated(given, name), 0.0))
        variance[i, i] += (std * values[i] ** 2 if name.endswith(INVERSE_BULK) else std) ** 2
    open_names = set(left_open(predictor, given))
    held = [i for i, name in enumerate(names) if name not in open_names]
    variance = variance[np.ix_(held, held)]
    scale = np.sqrt(np.diag(variance))
    scaled, vectors = np.linalg.eigh(variance / np.outer(scale, scale))
    root = np.zeros((len(held), len(names)))
    root[:, held] = (vectors / np.sqrt(np.maximum(scaled, 1e-12))).T / scale
    return Prior(root, values, len(held))


def parts_prior(predictor: Predictor, given: Robot, values: FloatArray) -> Prior | None:
    """What bodies of cylinders are known to: about the size of what the file or their steel says.

    Parameters
    ----------
    predictor : Predictor
    given : Robot
    values : (p,) array
        Its numbers by `Predictor.names`.

    Returns
    -------
    Prior or None
        None where the base has no parameter of such a body alone.
    """
    base = predictor.material.forces.base
    if not _has_forces(predictor) or base.link_count == len(base.names):
        return None
    sizes = expected_sizes(given, base)
    known = np.flatnonzero(np.isfinite(sizes) & (sizes > 0.0))
    root = np.zeros((known.size, values.size))
    root[np.arange(known.size), known] = 1.0 / (_PARTS * sizes[known])
    return Prior(root, values) if known.size else None


def with_ripples(
    prior: Prior | None, predictor: Predictor, model: Model, std: FloatArray, cycle_s: float
) -> Prior | None:
    """What is known before, with the readings' ripples where a first fit tells what they are.

    Parameters
    ----------
    prior : Prior or None
    predictor : Predictor
    model : Model
        Of the first fit.
    std : (p,) array
        Its numbers' deviations by `Predictor.names`.
    cycle_s : float
        Interval of commands and readings.
    """
    count, now = len(predictor.names), predictor.parameters(model)
    rows, values = [], np.zeros(count) if prior is None else prior.values.copy()
    for index, at in predictor.ripple_columns.items():
        if not in_step([s.trace.valve_signal[:, index] for s in predictor.material.stretches]):
            continue
        modulus, delay_s = model.robot.cylinders[index].bulk_modulus_pa, model.delays_s[index]
        known = known_ripple(float(now[at]), float(std[at]), modulus, delay_s, cycle_s)
        if known is not None:
            values[at] = known[0]
            rows.append(np.eye(count)[at] / known[1])
    return _with_rows(prior, rows, values)


def with_skews(prior: Prior | None, predictor: Predictor) -> Prior | None:
    """What is known before, with how late readings usually are: not at all, or a little.

    Parameters
    ----------
    prior : Prior or None
    predictor : Predictor
    """
    count, columns = len(predictor.names), predictor.skew_columns
    cycle_s = max((s.trace.step_s for s in predictor.material.stretches), default=0.0)
    values = np.zeros(count) if prior is None else prior.values.copy()
    values[list(columns.values())] = 0.0
    rows = [np.eye(count)[at] / usual_skew(one, cycle_s) for one, at in columns.items()]
    return _with_rows(prior, rows, values)


def _with_rows(
    prior: Prior | None, rows: Sequence[FloatArray], values: FloatArray
) -> Prior | None:
    if not rows:
        return prior
    roots, kept = ([], 0) if prior is None else ([prior.root], prior.kept)
    return Prior(np.concatenate([*roots, np.array(rows)]), values, kept)


def _has_forces(predictor: Predictor) -> bool:
    return bool(predictor.names) and predictor.names[0] in predictor.material.forces.names
