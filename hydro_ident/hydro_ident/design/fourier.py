"""Optimised Fourier motion: blocks at poses of their own, sized for the smallest errors.

Each block is a finite Fourier series per joint about a centre, under a window that starts and
ends at rest (`hydro_model.motion.paths_segments.Fourier`). Centres and coefficients of all blocks
are found together by L-BFGS-B. The criterion is the mean logarithm of the predicted standard
errors, given what the rest of the run already tells, plus a penalty on what exceeds a limit; units
of parameters drop out of it. Information adds over blocks, so a derivative by differences costs
the rows of one block only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.design.information import ForceInformation, moments, sandwich
from hydro_ident.design.limits import Limits, half_range, limit_ratios, room
from hydro_model.motion.paths_segments import Fourier
from hydro_model.multibody.joint_ranges import middle
from hydro_model.robot import FloatArray, Robot

#: Spacing of the rows that are judged: nine per period of the fastest harmonic.
_ROWS_PER_PERIOD = 9
_DIFFERENCE = 1.0e-4
#: Piston speed stands for the valve's four edges too, whose rows are speeds over openings.
_FRICTION_WEIGHT = 3.0
#: Of the mean squared excess over `_NEAR`, beside the mean logarithm of standard errors: a motion
#: that is at a limit all along pays as for standard errors 3.5 times as large (a logarithm of
#: 1.25), one that touches it in every hundredth row as for 1.3 % more.
_PENALTY = 500.0
#: Ratios count as exceeded from here, so that rounding and finer sampling stay inside.
_NEAR = 0.95
#: Iterations from every start, and from the best of them on.
_FIRST_ITERATIONS, _ITERATIONS = 20, 90


@dataclass(frozen=True, slots=True)
class Blocks:
    """Fourier blocks of equal length.

    Attributes
    ----------
    centre : (B, n) array
    sine, cosine : (B, n, H) array
    fundamental_hz, duration_s, ramp_s : float
    """

    centre: FloatArray
    sine: FloatArray
    cosine: FloatArray
    fundamental_hz: float
    duration_s: float
    ramp_s: float


@dataclass(frozen=True, slots=True)
class Spectrum:
    """What the optimiser may use.

    Attributes
    ----------
    blocks, harmonics : int
    fundamental_hz, duration_s, ramp_s : float
        Of each block.
    """

    blocks: int
    harmonics: int
    fundamental_hz: float
    duration_s: float
    ramp_s: float


class FourierDesign:
    """The optimisation problem.

    Parameters
    ----------
    information : ForceInformation
    limits : Limits
    spectrum : Spectrum
    prior : tuple of (p, p) arrays
        H and M of the rest of the run.
    """

    def __init__(
        self,
        information: ForceInformation,
        limits: Limits,
        spectrum: Spectrum,
        prior: tuple[FloatArray, FloatArray],
    ) -> None:
        self.information = information
        self.limits = limits
        self.spectrum = spectrum
        self.prior = prior
        self.robot: Robot = information.robot
        self._basis = _basis(spectrum)
        base = len(information.model.base.names)
        weights = np.ones(len(information.model.names))
        weights[base:] = _FRICTION_WEIGHT
        self._weights = weights / weights.sum()
        top = spectrum.harmonics * spectrum.fundamental_hz
        self._step_s = 1.0 / (_ROWS_PER_PERIOD * top)
        rate = np.arange(1, spectrum.harmonics + 1)
        half = half_range(self.robot)
        # A unit of a variable: the half range for centres, less for the higher harmonics.
        waves = half[:, None] / np.concatenate([rate, rate]) ** 1.5
        self._unit = np.column_stack([half, waves])

    def best_of(self, starts: Sequence[Blocks]) -> Blocks:
        """The most promising of several starts, a little improved."""
        return min((self.improved(s, _FIRST_ITERATIONS) for s in starts), key=self.value)

    def improved(self, start: Blocks, iterations: int = _ITERATIONS) -> Blocks:
        """A local optimum near a start; deterministic.

        Parameters
        ----------
        start : Blocks
            Its coefficients are taken over where the blocks' length differs from the problem's.
        iterations : int

        Returns
        -------
        Blocks
        """
        from scipy.optimize import Bounds, minimize

        variables = self._variables(start)
        low, high = -np.ones(variables.shape), np.ones(variables.shape)
        reach = room(self.robot, self.limits)
        low[:, :, 0] = (middle(self.robot) - reach) / self._unit[:, 0]
        high[:, :, 0] = (middle(self.robot) + reach) / self._unit[:, 0]

        def objective(flat: FloatArray) -> tuple[float, FloatArray]:
            value, slope = self._value_and_slope(flat.reshape(variables.shape))
            return value, slope.ravel()

        found = minimize(
            objective,
            variables.ravel(),
            jac=True,
            method="L-BFGS-B",
            bounds=Bounds(low.ravel(), high.ravel()),
            options={"maxiter": iterations, "maxcor": 20},
        )
        return self._blocks(found.x.reshape(variables.shape))

    def value(self, blocks: Blocks) -> float:
        """The criterion, penalty included."""
        return self._value_and_slope(self._variables(blocks), slope=False)[0]

    def _variables(self, blocks: Blocks) -> FloatArray:
        parts = [blocks.centre[..., None], blocks.sine, blocks.cosine]
        return np.concatenate(parts, axis=2) / self._unit

    def _blocks(self, variables: FloatArray) -> Blocks:
        values = variables * self._unit
        spectrum = self.spectrum
        return Blocks(
            values[:, :, 0],
            values[:, :, 1 : spectrum.harmonics + 1],
            values[:, :, spectrum.harmonics + 1 :],
            spectrum.fundamental_hz,
            spectrum.duration_s,
            spectrum.ramp_s,
        )

    def _value_and_slope(
        self, variables: FloatArray, slope: bool = True
    ) -> tuple[float, FloatArray]:
        parts = [self._part(block[None]) for block in variables]
        bread = self.prior[0] + sum(part[0][0] for part in parts)
        meat = self.prior[1] + sum(part[1][0] for part in parts)
        penalty = float(sum(part[2][0] for part in parts))
        value = float(self._criterion(bread, meat)) + penalty
        gradient = np.zeros_like(variables)
        for index, part in enumerate(parts if slope else ()):
            block = variables[index]
            moved = block + _DIFFERENCE * np.eye(block.size).reshape(block.size, *block.shape)
            rows = self._part(moved)
            near = self._criterion(bread - part[0] + rows[0], meat - part[1] + rows[1])
            change = near + penalty - part[2] + rows[2] - value
            gradient[index] = (change / _DIFFERENCE).reshape(block.shape)
        return value, gradient

    def _criterion(self, bread: FloatArray, meat: FloatArray) -> FloatArray:
        """Weighted mean logarithm of the standard errors."""
        variance = np.einsum("...ii->...i", sandwich(bread, meat))
        return np.asarray(0.5 * np.log(np.maximum(variance, 1e-300)) @ self._weights)

    def _part(self, blocks: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """H, M and penalty of V versions of one block, shape (V, n, 1 + 2 H)."""
        values = blocks * self._unit
        waves = values[:, :, 1:]
        q, qd, qdd = (np.einsum("tw,vjw->vtj", basis, waves) for basis in self._basis)
        q = q + values[:, None, :, 0]
        count, rows, n = q.shape
        flat = tuple(a.reshape(-1, n) for a in (q, qd, qdd))
        x = self.information.columns(*flat).reshape(count, rows, n, -1)
        bread, meat = moments(x, self._step_s, self.information.residual.correlation_s)
        # As many rows as a second of recording gives would only scale both alike.
        density = self._step_s
        ratios = limit_ratios(self.robot, self.limits, *flat).reshape(count, rows, -1)
        over = np.maximum(ratios - _NEAR, 0.0)
        penalty = _PENALTY * (over**2).sum(axis=2).mean(axis=1)
        return bread * density, meat * density**2, penalty


def _basis(spectrum: Spectrum) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position, velocity and acceleration per unit coefficient, (T, 2 H) each."""
    harmonics = spectrum.harmonics
    unit = Fourier(
        np.zeros(2 * harmonics),
        np.eye(2 * harmonics, harmonics),
        np.eye(2 * harmonics, harmonics, -harmonics),
        spectrum.fundamental_hz,
        spectrum.ramp_s,
        spectrum.duration_s,
    )
    step = 1.0 / (_ROWS_PER_PERIOD * harmonics * spectrum.fundamental_hz)
    return unit.sample_many(np.arange(0.0, spectrum.duration_s, step))


def start_blocks(robot: Robot, spectrum: Spectrum, centres: FloatArray, seed: int) -> Blocks:
    """A first guess: small random coefficients, falling with the harmonic, about given centres.

    Parameters
    ----------
    robot : Robot
    spectrum : Spectrum
    centres : (B, n) array
    seed : int

    Returns
    -------
    Blocks
    """
    rng = np.random.default_rng(seed)
    falling = 1.0 / np.arange(1, spectrum.harmonics + 1) ** 1.5
    shape = (spectrum.blocks, robot.dof, spectrum.harmonics)
    waves = [
        0.1 * half_range(robot)[:, None] * falling * rng.standard_normal(shape) for _ in range(2)
    ]
    return Blocks(
        centres,
        waves[0],
        waves[1],
        spectrum.fundamental_hz,
        spectrum.duration_s,
        spectrum.ramp_s,
    )
