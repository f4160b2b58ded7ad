"""Models as a fit moves them, and what tells two of them apart."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from hydro_model.effects.effect import Stage
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray, Robot

#: Stages of laws that act through the edges.
_EDGES = (Stage.SIGNAL, Stage.SUPPLY, Stage.TANK)


@dataclass(frozen=True, slots=True)
class Model:
    """A robot with its numbers as they are at present in the fit.

    Attributes
    ----------
    robot : Robot
        Edges and bulk moduli are current; its own list of effects is not looked at.
    theta : (p,) array
        Force parameters by `ForceModel.names`.
    delays_s : tuple of float
        Command delay of each cylinder's valve.
    terms : tuple of ActiveEffect
        Effects at work, at their current parameters.
    ripples : tuple of float
        Of each cylinder's pressures, as `ripple`; Pa s. 0 where none is fitted; empty: none.
    skews_s : tuple of float
        How late each chamber's pressure is read, as `skew`: chambers a and b of each cylinder in
        turn, then all torques. 0 where that is not fitted; empty: not at all.
    shaping : bool
        Whether an effect enters through the edges.
    shape : tuple
        What the rows of a balance depend on beside the delay of its own valve.
    """

    robot: Robot
    theta: FloatArray
    delays_s: tuple[float, ...]
    terms: tuple[ActiveEffect, ...] = ()
    ripples: tuple[float, ...] = ()
    skews_s: tuple[float, ...] = ()
    shaping: bool = field(init=False)
    shape: tuple[object, ...] = field(init=False)

    def __post_init__(self) -> None:
        # Asked for at every place of every contribution.
        object.__setattr__(self, "shaping", any(shapes(term) for term in self.terms))
        object.__setattr__(self, "shape", _shape_of(self))

    def with_term(self, term: ActiveEffect) -> Model:
        """The model with one more effect."""
        return replace(self, terms=(*self.terms, term))


def same(one: ActiveEffect, other: ActiveEffect) -> bool:
    """Whether two effects are the same name on the same target."""
    return one.effect.name == other.effect.name and one.target == other.target


def shapes(one: ActiveEffect) -> bool:
    """Whether an effect enters through the edges."""
    return any(stage in _EDGES for stage in one.effect.stages)


def gives_way(one: ActiveEffect) -> bool:
    """Whether an effect is a rail that gives way."""
    # Not by a set: of each of so many models every effect is asked, and enums take long to hash.
    return Stage.SUPPLY in one.effect.stages or Stage.TANK in one.effect.stages


def _let_pass(one: ActiveEffect) -> bool:
    """Whether rails give way by what an effect lets pass: all but hoses, as `railed`."""
    return one.effect.needs_valve and not one.effect.states


def on_signals(one: ActiveEffect) -> bool:
    """Whether an effect acts by what the model's signals are, and in no other way."""
    effect = one.effect
    if effect.reading is not None:
        return True
    # A change of the robot has no terms at all.
    return shapes(one) and effect.change is None and all(t.stage in _EDGES for t in effect.terms)


def reading_key(model: Model) -> tuple[object, ...]:
    """What tells models apart whose sensors err differently."""
    return tuple(
        (t.effect.name, t.target, tuple(t.parameters.tolist()))
        for t in model.terms
        if t.effect.reading is not None
    )


def same_base(one: Model, other: Model) -> bool:
    """Whether two models share robot, force parameters, delays and effects, objects and all."""
    if one.robot is not other.robot or one.theta is not other.theta:
        return False
    return one.delays_s == other.delays_s and identical(one, other)


def identical(one: Model, other: Model) -> bool:
    """Whether two models have the very same effects, in order."""
    if len(one.terms) != len(other.terms):
        return False
    return all(a is b for a, b in zip(one.terms, other.terms, strict=True))


def _shape_of(model: Model) -> tuple[object, ...]:
    rails = any(gives_way(t) for t in model.terms)
    terms = [
        (t.effect.name, t.target, tuple(t.parameters.tolist()))
        for t in model.terms
        if shapes(t) or t.effect.reading is not None or (rails and _let_pass(t))
    ]
    if not rails:
        return (tuple(terms), ())
    edges = [
        float(getattr(v, e)) for v in model.robot.valves for e in ("c_pa", "c_at", "c_pb", "c_bt")
    ]
    return (tuple(terms), (*edges, *model.delays_s))
