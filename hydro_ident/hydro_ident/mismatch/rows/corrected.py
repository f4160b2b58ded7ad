"""Recordings with the errors of their sensors taken off as a model's effects say them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hydro_ident.estimate.forces.force_rows import Motion
from hydro_ident.estimate.signals.derivatives import motion
from hydro_ident.estimate.signals.traces import Trace, strokes
from hydro_ident.mismatch.rows.material import Material, Stretch
from hydro_ident.mismatch.rows.modelled import Model, reading_key
from hydro_model.effects.readings import Readings
from hydro_model.effects.targets import ActiveEffect

#: Corrected recordings that are kept at a time.
_KEPT_STRETCHES = 6


@dataclass(slots=True)
class CorrectedReadings:
    """Stretches as corrected sensors would have read them, the last ones kept.

    Attributes
    ----------
    material : Material
        As recorded.
    """

    material: Material
    _stretches: dict[tuple[object, ...], tuple[Stretch, ...]] = field(default_factory=dict)
    _motions: dict[int, tuple[Trace, Motion]] = field(default_factory=dict)

    def stretches(self, model: Model) -> tuple[Stretch, ...]:
        """The stretches with their sensors' signals corrected by the model's readings."""
        key = reading_key(model)
        if not key:
            return self.material.stretches
        if key not in self._stretches:
            if len(self._stretches) >= _KEPT_STRETCHES:
                self._stretches.pop(next(iter(self._stretches)))
            terms = [term for term in model.terms if term.effect.reading is not None]
            self._stretches[key] = self.corrected(terms)
        return self._stretches[key]

    def corrected(self, terms: Sequence[ActiveEffect]) -> tuple[Stretch, ...]:
        """The stretches with readings undone; not kept."""
        if not terms:
            return self.material.stretches
        return tuple(self._corrected(stretch, terms) for stretch in self.material.stretches)

    def _corrected(self, stretch: Stretch, terms: Sequence[ActiveEffect]) -> Stretch:
        trace = stretch.trace
        seen = _undone(trace, terms)
        fixed = replace(
            trace, q=seen.q, p_a=seen.p_a, p_b=seen.p_b, supply=seen.supply, tank=seen.tank,
            valve_signal=seen.valve_signal,
        )  # fmt: skip
        if np.array_equal(fixed.q, trace.q):
            return replace(stretch, trace=fixed)
        if stretch.moved is None:
            # Without all joints there is no force, but the flows of those that were read.
            own = strokes(self.material.robot, fixed.q, fixed.stroke.copy())
            return replace(stretch, trace=replace(fixed, stroke=own))
        fixed, moved = self._moved(stretch, stretch.moved, fixed, terms)
        return replace(stretch, trace=fixed, moved=moved)

    def _moved(
        self, stretch: Stretch, recorded: Motion, fixed: Trace, terms: Sequence[ActiveEffect]
    ) -> tuple[Trace, Motion]:
        """A trace whose positions were corrected, with strokes, and its motion.

        The last one's are kept: fits move what other sensors read beside the same positions.
        """
        kept = self._motions.get(stretch.number)
        if kept is None or not np.array_equal(kept[0].q, fixed.q):
            own = replace(fixed, stroke=strokes(self.material.robot, fixed.q, fixed.stroke.copy()))
            q, still = own.q, np.ptp(recorded.q, axis=0) == 0.0
            if still.any():
                # What dithers about a rest is corrected at that: held there, it is no motion.
                held = replace(stretch.trace, q=np.where(still, recorded.q, stretch.trace.q))
                q = np.where(still, _undone(held, terms).q, q)
            moved = Motion(*motion(q, own.step_s, self.material.filters))
            kept = self._motions[stretch.number] = own, moved
        # The very same positions tell what follows from geometry that it may stay.
        return replace(fixed, q=kept[0].q, stroke=kept[0].stroke), kept[1]


def _undone(trace: Trace, terms: Sequence[ActiveEffect]) -> Readings:
    """What a trace's sensors would have read without the errors that some effects say."""
    seen = Readings(
        trace.step_s, trace.q, trace.p_a, trace.p_b, trace.supply, trace.tank,
        trace.valve_signal, trace.joint_torque,
    )  # fmt: skip
    for term in terms:
        seen = term.effect.undone(seen, term.index, term.parameters)
    return seen
