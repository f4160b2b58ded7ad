"""Laws of the listed effects, stage by stage, evaluated for one cylinder and one sample.

The catalogue's own laws as plain Python, for reading: the controller calls the same compiled
(`hydro_control.compensation.listed_kernels`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from hydro_model.effects import ActiveEffect, Law, Stage
from hydro_model.effects.signals import STATE_0

#: The parameter that rounds the sign of a velocity, and the typical lever arm that takes its
#: smallest value to one of a joint's velocity.
_SCALE = "velocity_scale"
_LEVER_M = 0.4
#: Step of the difference that linearises an internal state's rate, as a share of its scale.
NUDGE = 1e-6

Signals = list[float]


class ListedLaws:
    """The laws of one cylinder that add something: friction, flows, volumes, compliances.

    Internal states, such as a bristle's deflection, follow the signals by the linearly implicit
    Euler method, ``z += h r / (1 - h dr/dz)``: right at rest and stable however stiff.

    Parameters
    ----------
    effects : sequence of ActiveEffect
        Of one cylinder. Laws on the valve signal are passed over.
    smallest_scale_m_s : float
        Rounding of the sign of a velocity, where a law has less.
    """

    def __init__(self, effects: Sequence[ActiveEffect], smallest_scale_m_s: float = 0.0) -> None:
        own = adding(effects)
        self._parameters = [rounded(one, smallest_scale_m_s) for one in own]
        self._effects = [one.effect for one in own]
        self._terms: dict[Stage, list[tuple[int, Law]]] = {
            stage: [
                (index, term.law)
                for index, one in enumerate(own)
                for term in one.terms
                if term.stage is stage
            ]
            for stage in Stage
            if stage is not Stage.SIGNAL
        }
        self._dynamic = [index for index, one in enumerate(own) if one.effect.states]
        self.reset()

    def reset(self) -> None:
        """Internal states start from rest at the next sample."""
        self._states: list[list[float]] = [[] for _ in self._effects]

    def advance(self, s: Signals, dt_s: float) -> None:
        """Let the internal states follow one sample's signals.

        `s` has a row of signals per cylinder.
        """
        for index in self._dynamic:
            states, p = self._effects[index].states, self._parameters[index]
            z = self._states[index]
            if not z:
                self._states[index] = [state.initial(s, p) for state in states]
                continue
            s[STATE_0 : STATE_0 + len(z)] = z
            for k, state in enumerate(states):
                rate = state.rate(s, p)
                nudge = NUDGE * state.scale
                s[STATE_0 + k] = z[k] + nudge
                slope = (state.rate(s, p) - rate) / nudge
                s[STATE_0 + k] = z[k]
                z[k] += dt_s * rate / (1.0 - dt_s * min(slope, 0.0))

    def total(self, stage: Stage, s: Signals) -> float:
        """Sum of the laws of a stage at one sample's signals.

        `s` has a row of signals per cylinder.
        """
        out = 0.0
        for index, law in self._terms[stage]:
            z = self._states[index]
            if z:
                s[STATE_0 : STATE_0 + len(z)] = z
            out += law(s, self._parameters[index])
        return out


def adding(effects: Iterable[ActiveEffect]) -> list[ActiveEffect]:
    """Those that add something, in any stage; laws on the valve signal map it instead."""
    return [a for a in effects if any(t.stage is not Stage.SIGNAL for t in a.terms)]


def rounded(one: ActiveEffect, smallest_scale_m_s: float) -> list[float]:
    """Parameters of an effect, the sign of its velocity rounded as much as it has to be.

    Parameters
    ----------
    one : ActiveEffect
    smallest_scale_m_s : float

    Returns
    -------
    list of float
    """
    out = []
    for spec, value in zip(one.effect.parameters, one.parameters.tolist(), strict=True):
        smallest = smallest_scale_m_s / (_LEVER_M if spec.unit == "rad/s" else 1.0)
        out.append(max(value, smallest) if spec.name == _SCALE else value)
    return out
