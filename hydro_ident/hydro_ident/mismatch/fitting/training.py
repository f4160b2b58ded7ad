"""Training rows: which rows are fitted, and how they are weighed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.prior import Prior
from hydro_ident.mismatch.fitting.whitening import LEAST_NOISE, Layout, Noise, noise_of
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_ident.mismatch.rows.state_space import smooth_basis
from hydro_ident.mismatch.settings import BLOCK_S, LEAST_BLOCKS, SHORTEST_BLOCK_S
from hydro_model.arrays import BoolArray
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray, Robot


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
        Sampling interval.
    block_s : float
        Length of the blocks whose signs are flipped.
    smooth : tuple of (n_k, m_k) array
        Orthonormal smooth functions of each channel's state on its rows in the mask.
    latest_s : mapping of int to float
        Longest command delay of the base of the cylinders whose valves have one of their own.
    as_listed : frozenset of (str, str, str)
        Shapes of effects, by name, target and parameter, that stay as the robot file lists them.
    """

    predictor: Predictor
    mask: BoolArray
    layout: Layout
    floor: FloatArray
    prior: Prior | None
    cycle_s: float
    block_s: float
    smooth: tuple[FloatArray, ...] = ()
    latest_s: Mapping[int, float] = field(default_factory=dict)
    as_listed: frozenset[tuple[str, str, str]] = frozenset()

    @staticmethod
    def of(
        predictor: Predictor,
        mask: BoolArray,
        prior: Prior | None = None,
        as_listed: frozenset[tuple[str, str, str]] = frozenset(),
    ) -> Training:
        """Training on some rows of the predictor's material.

        Parameters
        ----------
        predictor : Predictor
        mask : (N,) bool array
        prior : Prior, optional
        as_listed : frozenset of (str, str, str)
        """
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
        block_s = block_of(layout.length_s)
        return Training(
            predictor, mask, layout, floor, prior, cycle_s, block_s, smooth, as_listed=as_listed
        )

    @property
    def own_delay_s(self) -> float:
        """The command delay that is the base's: a cycle, or what the robot file states beyond.

        What is known of it beforehand it is held to, and no cycle is granted.
        """
        stated_s = self.predictor.material.robot.command_delay_s
        columns = list(self.predictor.delay_columns.values())
        known = self.prior is not None and bool(self.prior.root[:, columns].any())
        return stated_s if known else max(self.cycle_s, stated_s)

    def own_delay_of(self, cylinder: int | None) -> float:
        """As `own_delay_s`, of one cylinder's valve; of all for None."""
        return (
            self.own_delay_s if cylinder is None else self.latest_s.get(cylinder, self.own_delay_s)
        )

    def stays(self, term: ActiveEffect, index: int) -> bool:
        """Whether a parameter of an effect stays as the robot file lists it."""
        name = term.effect.parameters[index].name
        return (term.effect.name, term.target, name) in self.as_listed

    def keeps(self, term: ActiveEffect) -> bool:
        """Whether any parameter of an effect stays as the robot file lists it."""
        return any(self.stays(term, i) for i in range(len(term.effect.parameters)))

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

    def known(self, predictor: Predictor) -> Prior | None:
        """What is known of the base beforehand, by the parameters of other rows.

        Parameters
        ----------
        predictor : Predictor
            Of the other rows: they may lack channels.
        """
        if self.prior is None:
            return None
        return self.prior.taken(self.predictor.names, predictor.names)

    def offset(self, model: Model) -> FloatArray:
        """How far a model's base is from what was known of it, in deviations."""
        if self.prior is None:
            return np.zeros(0)
        now = self.predictor.parameters(model)
        # Their columns are slopes, and what a step of them starts from is no number of the base.
        for index, at in self.predictor.delay_columns.items():
            now[at] = model.delays_s[index]
        return np.asarray(self.prior.root @ (self.prior.values - now))

    def off(self, model: Model) -> FloatArray:
        """How far a kept base is from the file's, (k,) in deviations; empty of another one."""
        return self.offset(model)[: 0 if self.prior is None else self.prior.kept]

    def squares(self, noise: Noise, residual: FloatArray, offset: FloatArray) -> float:
        """Sum of squares of a residual on the whitened training rows, as its bench's `squares`.

        Parameters
        ----------
        noise : Noise
        residual : (N,) array
        offset : (m,) array
            As `offset`.
        """
        white = noise.whitened(self.layout, residual[self.mask])[noise.settled(self.layout)]
        values = np.concatenate([white, offset])
        return float(values @ values)

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
            root = self.prior.rows(columns.shape[1])
            prior = root, np.zeros(root.shape[0]) if offset is None else offset
        return Bench(self.layout, noise, residual, columns, self.block_s, prior, self.mask)


def block_of(total_s: float) -> float:
    """Length of blocks in s: of a short time (`total_s`) as many as a small chance takes."""
    return float(np.clip(total_s / LEAST_BLOCKS, SHORTEST_BLOCK_S, BLOCK_S))


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
