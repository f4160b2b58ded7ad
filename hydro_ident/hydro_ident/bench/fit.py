"""The fit of base parameters and friction by torques, as we do it and as figaroh's pipeline does.

Both get positions, speeds, accelerations and torques of a chain with six joints, and give base
parameters, viscous and Coulomb friction of every joint by ordinary least squares, with standard
deviations. figaroh takes the noise for white. So does ours with a noise model of order 0, the
same work; of the product's order it lets the noise be autocorrelated, which is more.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from hydro_ident.bench.chains import PINOCCHIO_ORDER, chain, pinocchio_model
from hydro_ident.bench.job import agree
from hydro_ident.estimate.statistics.blocks import blocks_of
from hydro_ident.estimate.statistics.least_squares import Fit, fit_of_solution
from hydro_ident.estimate.statistics.moments import LAGS, Moments
from hydro_ident.estimate.statistics.regression import solve_ols
from hydro_ident.estimate.statistics.rows import Rows
from hydro_model.multibody.base_parameters import base_map
from hydro_model.multibody.rigid_body import inverse_dynamics, regressor
from hydro_model.robot import FloatArray, Robot

DOF, STEP_S, NOISE_N_M = 6, 0.002, 5.0
#: Rows at once, and figaroh's own thresholds for columns of zeros and for the rank.
_BLOCK, _ZERO, _RANK = 2048, 0.001, 1e-6


@dataclass(frozen=True, slots=True)
class Task:
    """What is fitted; N samples of n joints each.

    Attributes
    ----------
    q, qd, qdd, torque : (N, n) array
    """

    q: FloatArray
    qd: FloatArray
    qdd: FloatArray
    torque: FloatArray


@dataclass(frozen=True, slots=True)
class PeerFit:
    """Outcome of figaroh's pipeline.

    Attributes
    ----------
    values, std : (p,) array
    mapping : (p, r) array
        Its base parameters as combinations of the remaining standard ones and friction.
    columns : (r,) int array
        Where those are among the 10 n + 2 n columns of our `full_columns`.
    """

    values: FloatArray
    std: FloatArray
    mapping: FloatArray
    columns: FloatArray


def make_task(samples: int, seed: int = 0) -> Task:
    """Motion of sums of sines, torques of the chain with friction and white noise.

    `samples` are their number, `seed` is that of motion and noise.
    """
    rng, robot = np.random.default_rng(seed), chain(DOF)
    time = np.arange(samples)[:, None] * STEP_S
    q, qd, qdd = (np.zeros((samples, DOF)) for _ in range(3))
    for _ in range(5):
        size, rate = rng.uniform(0.1, 0.5, DOF), rng.uniform(0.5, 8.0, DOF)
        phase = rng.uniform(0.0, 6.0, DOF)
        q += size * np.sin(rate * time + phase)
        qd += size * rate * np.cos(rate * time + phase)
        qdd -= size * rate**2 * np.sin(rate * time + phase)
    viscous, dry = rng.uniform(5.0, 50.0, (2, DOF))
    torque = inverse_dynamics(robot, q, qd, qdd) + viscous * qd + dry * np.sign(qd)
    return Task(q, qd, qdd, torque + NOISE_N_M * rng.normal(size=q.shape))


def save_task(path: Path, task: Task) -> None:
    """Write it for a process of its own."""
    np.savez(path, q=task.q, qd=task.qd, qdd=task.qdd, torque=task.torque)


def load_task(path: Path) -> Task:
    """Read what `save_task` wrote."""
    with np.load(path) as found:
        return Task(found["q"], found["qd"], found["qdd"], found["torque"])


def fit_ours(task: Task, lags: int = LAGS) -> Fit:
    """The product's way: blocks of rows into flat memory, then the fit.

    Parameters
    ----------
    task : Task
    lags : int
        Order of the noise model; 0 takes the noise for white.

    Returns
    -------
    Fit
    """
    robot, moments = chain(DOF), None
    leading = base_map(robot).leading
    for begin in range(0, len(task.q), _BLOCK):
        part = slice(begin, begin + _BLOCK)
        x = _columns(robot, task, part, leading)
        times = np.asarray(np.arange(begin, begin + len(x)) * STEP_S, dtype=np.float64)
        rows = Rows(task.torque[part], x, times, "run", step_s=STEP_S)
        moments = moments or Moments.like(rows, "run", lags)
        moments.add(rows)
    if moments is None:
        raise ValueError("expected samples, found none")
    blocks = blocks_of([moments])
    return fit_of_solution(solve_ols(blocks), blocks, int(moments.rows.sum()))


def _columns(robot: Robot, task: Task, part: slice, leading: Any) -> FloatArray:
    q, qd, qdd = task.q[part], task.qd[part], task.qdd[part]
    inertial = len(leading)
    columns = np.zeros((*q.shape, inertial + 2 * DOF))
    columns[..., :inertial] = regressor(robot, q, qd, qdd)[..., leading]
    for j in range(DOF):
        columns[:, j, inertial + j] = qd[:, j]
        columns[:, j, inertial + DOF + j] = np.sign(qd[:, j])
    return columns


def fit_theirs(task: Task) -> PeerFit:
    """figaroh's functions in the order in which its identification class calls them.

    Parameters
    ----------
    task : Task

    Returns
    -------
    PeerFit
    """
    regressors = importlib.import_module("figaroh.tools.regressor")
    tools = importlib.import_module("figaroh.identification.identification_tools")
    decomposition = importlib.import_module("figaroh.tools.qrdecomposition")
    model = pinocchio_model(importlib.import_module("pinocchio"), chain(DOF))
    robot = SimpleNamespace(model=model, data=model.createData())
    config = {"has_friction": True, "is_joint_torques": True, "act_idxv": list(range(DOF))}
    config |= {"fv": [0.0] * DOF, "fs": [0.0] * DOF}
    standard = tools.get_standard_parameters(model, config)
    standard |= tools.add_standard_additional_parameters(model, config)
    whole = regressors.build_regressor_basic(robot, task.q, task.qd, task.qdd, config)
    zero, names = regressors.get_index_eliminate(whole, standard, tol_e=_ZERO)
    reduced = regressors.build_regressor_reduced(whole, zero)
    torque = task.torque.T.flatten()
    decomposer = decomposition.QRDecomposer(tolerance=_RANK)
    base, _, _, values, _ = decomposer.double_decomposition(torque, reduced, names, standard)
    std = tools.relative_stdev(base, values, torque) / 100.0 * np.abs(values)
    order = [10 * link + p for link in range(DOF) for p in PINOCCHIO_ORDER]
    order += range(10 * DOF, 12 * DOF)
    kept = np.delete(np.array(order), zero)
    return PeerFit(values, std, decomposer.get_M(), kept)


def compare(ours: Fit, theirs: PeerFit, lags: int = LAGS) -> None:
    """Both the same parameters, in their choice of base parameters, and deviations alike.

    Under a noise model ours leave out the first rows, which have no predecessors to tell noise
    by. Theirs state relative deviations in steps of 0.01 %.

    Parameters
    ----------
    ours : Fit
    theirs : PeerFit
    lags : int
        Order of our noise model.

    Raises
    ------
    AssertionError
        They differ by more than the missing rows explain, or the deviations by more than the
        noise model's own scatter; at 1e5 samples by 3 % of a deviation, and by an eighth. For
        white noise by a thousandth of a deviation, or the deviations by the scatter of every
        joint's own residual, theirs being one of all: 0.6 % at 1e5 samples.
    """
    leading = base_map(chain(DOF)).leading
    where = np.concatenate([leading, np.arange(10 * DOF, 12 * DOF)])
    selected = (theirs.columns[:, None] == where[None, :]).astype(float)
    count = theirs.mapping.shape[0]
    agree(count == where.size, f"expected {where.size} base parameters, found {count}")
    turned = theirs.mapping @ selected
    std = np.sqrt(np.diag(turned @ ours.covariance @ turned.T))
    off = np.abs(turned @ ours.theta - theirs.values) / std
    samples = ours.rows / DOF
    near = 5.0 * np.sqrt(lags / samples) if lags else 1e-3
    agree(off.max() < near, f"parameters differ by {off.max():.3g} standard deviations")
    scatter = 0.1 + 10.0 / np.sqrt(samples) if lags else 2.0 / np.sqrt(samples)
    apart = np.abs(std - theirs.std) - 1e-4 * np.abs(theirs.values)
    agree(np.all(apart < scatter * std), f"deviations differ by {np.max(apart / std):.3g}")
