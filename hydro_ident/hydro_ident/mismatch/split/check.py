"""Rows that took no part: what findings are verified on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.forces.standstill import Rest
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.identify.survey import parked_elsewhere
from hydro_ident.mismatch.fitting.prior import Prior
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.fitting.whitening import Noise
from hydro_ident.mismatch.rows.material import Material
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_ident.mismatch.rows.telling import telling, unfitted, within
from hydro_ident.mismatch.trials.where import VARIABLES
from hydro_model.arrays import BoolArray
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray, Robot

#: Variables of laws that are extrapolated where a joint was never fitted.
_OF_POSITION = frozenset({"joint_angle", "piston_position"})
#: Share of a balance's rows within the fitted positions below which those beyond are told as well.
_FEW_WITHIN = 0.1


def noise_there(noise: Noise, names: Sequence[str], there: Sequence[str]) -> Noise:
    """Noise of some channels for rows of others, by name; rows of further channels count nothing.

    Parameters
    ----------
    noise : Noise
        Of the channels `names`.
    names, there : sequence of str
    """
    at = [names.index(name) if name in names else -1 for name in there]
    phi = tuple(noise.phi[k] if k >= 0 else np.zeros(0) for k in at)
    return Noise(phi, np.array([float(noise.std[k]) if k >= 0 else np.inf for k in at]))


@dataclass(frozen=True, slots=True)
class Check:
    """Rows that took no part in fitting or selecting.

    Attributes
    ----------
    predictor : Predictor
        Of the training material, or of other recordings.
    mask : (N,) bool array
    moving : (N,) bool array
        Rows on which friction laws can be judged.
    beyond : (N,) bool array, optional
        Rows that took no part, either, but lie where their joint was never fitted.
    """

    predictor: Predictor
    mask: BoolArray
    moving: BoolArray
    beyond: BoolArray | None = None

    def reaching(self, term: ActiveEffect, acting: Sequence[str]) -> Check:
        """The rows that can be asked about an effect.

        Beyond the positions that were fitted gravity and laws of the position are extrapolated. In
        a mass balance the position is but the volume, which is known: what leaks, lags or opens is
        the same there, and a second work cycle may have nine tenths of its rows there.

        Parameters
        ----------
        term : ActiveEffect
        acting : sequence of str
            Channels that it acts on. Where forces are among them, balances beyond would only add
            to what the model is off by.
        """
        material = self.predictor.material
        flows = [k for k in range(len(material.channels)) if material.is_flow(k)]
        of_flow = {material.channels[k] for k in flows}.issuperset(acting)
        of_position = VARIABLES.get(term.effect.name, "") in _OF_POSITION
        if self.beyond is None or of_position or not of_flow:
            return self
        further = self.beyond & np.isin(material.channel, flows)
        return replace(self, mask=self.mask | further)

    def told(self, terms: Sequence[ActiveEffect]) -> Check:
        """The rows that a model's numbers are told of: findings are verified on no others.

        Balances beyond the positions that were fitted are the same there (`reaching`), and hardly
        any row may lie within: a recording of other poses would have no numbers at all.

        Parameters
        ----------
        terms : sequence of ActiveEffect
            The model's. A flow's law of the position is extrapolated beyond.
        """
        beyond, material = self.beyond, self.predictor.material
        of_position = any(
            VARIABLES.get(t.effect.name, "") in _OF_POSITION and t.effect.channel == "flow"
            for t in terms
        )
        if beyond is None or of_position:
            return self
        further = np.zeros(material.size, dtype=np.bool_)
        for k in (k for k in range(len(material.channels)) if material.is_flow(k)):
            own = material.channel == k
            within, outside = np.count_nonzero(self.mask & own), np.count_nonzero(beyond & own)
            if within < _FEW_WITHIN * (within + outside):
                further |= beyond & own
        return replace(self, mask=self.mask | further) if further.any() else self

    @property
    def rows_in_motion(self) -> BoolArray:
        """Those of the rows whose joint moves, (N,)."""
        return np.asarray(self.mask & self.moving)

    def known(self, training: Training) -> Prior | None:
        """What the training's fits know of the base beforehand, by these rows' parameters."""
        return training.known(self.predictor)

    def training(self, training: Training) -> Training:
        """The rows as if they were to be fitted, with what the base is held to as there."""
        known, listed = self.known(training), training.as_listed
        there = Training.of(self.predictor, self.rows_in_motion, known, listed)
        # Delays are shared out between base and effect by the cycle that they were fitted with.
        return replace(there, latest_s=training.latest_s, cycle_s=training.cycle_s)

    def residual(self, model: Model) -> FloatArray:
        """Residual of a model on all rows of the material."""
        return self.predictor.residual(model)

    def rows(self, channel: int, name: str) -> BoolArray:
        """The check's rows of a channel, by its name."""
        material = self.predictor.material
        at = material.channels.index(name) if name in material.channels else -1
        return np.asarray(self.mask & (material.channel == at))


def held_back(training: Training, rows: BoolArray, moving: BoolArray) -> Check:
    """What is verified on of the fitted recordings themselves.

    Parameters
    ----------
    training : Training
    rows, moving : (N,) bool array
        Those of its material that were kept back, and on which friction laws can be judged.
    """
    predictor = training.predictor
    known = within(predictor.material, training.mask, predictor.material)
    return Check(predictor, rows & known, moving, rows & ~known)


def elsewhere(
    there: Material,
    training: Training,
    signals: SignalSurvey,
    unlocked: Mapping[str, Sequence[int]],
    still: Mapping[str, Mapping[int, Rest]],
) -> tuple[Check, tuple[str, ...]]:
    """Rows of other recordings: verified on are fitted channels, where their joints have been.

    And what is to be said of joints that have not been there.

    Parameters
    ----------
    there : Material
        Of the other recordings.
    training : Training
    signals : SignalSurvey
        Of the fitted recordings.
    unlocked : mapping of str to sequence of int
        By recording, the joints that move there and nowhere in what was fitted.
    still : mapping of str to mapping of int to Rest
        By recording, how the joints stand that are still.
    """
    material, parked = training.predictor.material, parked_elsewhere(signals, still)
    foreign = unfitted(there, unlocked, parked) | there.stopped
    known = within(material, training.mask, there) & ~foreign
    own = np.isin(np.array(there.channels)[there.channel], material.channels)
    check = Check(Predictor(there), known, telling(there, signals), own & ~known & ~foreign)
    return check, _unlocked(there.robot, unlocked) + _parked(there.robot, parked)


def _unlocked(robot: Robot, unlocked: Mapping[str, Sequence[int]]) -> tuple[str, ...]:
    """Which recordings move joints that nothing fitted has moved."""
    return tuple(
        f"{name}: {', '.join(robot.joint_names[j] for j in joints)} moves, which stood still in"
        " all that was fitted: forces there, and flows of its own, are not verified on"
        for name, joints in unlocked.items()
        if joints
    )


def _parked(robot: Robot, parked: Mapping[str, Mapping[int, float]]) -> tuple[str, ...]:
    """Which recordings have joints stand still where nothing fitted has had them."""
    return tuple(
        f"{name}: {robot.joint_names[j]} stands still {off:.2g}"
        f" {'m' if robot.joints[j].prismatic else 'rad'} from where it stood in all that was"
        " fitted: forces there are not verified on, as gravity may be another"
        for name, joints in parked.items()
        for j, off in joints.items()
    )
