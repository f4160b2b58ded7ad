"""What comes or goes at an instant does so at another one in other recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hydro_ident.mismatch.check import Check
from hydro_ident.mismatch.modelled import Model, same
from hydro_ident.mismatch.onset import Sight, ends
from hydro_ident.mismatch.places import ends_of, instant_spacing, instants_of
from hydro_ident.mismatch.training import Training
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray, Robot


def at_own_instants(training: Training, check: Check, model: Model) -> tuple[Model, int]:
    """A model as other recordings have it: what comes and goes does when it predicts them best.

    Parameters
    ----------
    training : Training
    check : Check
    model : Model
        As fitted to the training rows.

    Returns
    -------
    model : Model
        The same where the check is of the recordings that were fitted, or nothing begins.
    tried : int
        Instants that were looked at for each effect that begins: p-values pay for them.
    """
    tried = 1
    if check.predictor is training.predictor:
        return model, tried
    for term in (t for t in model.terms if t.effect.start):
        model, tried = _placed(check, model, term)
    return model, tried


def _placed(check: Check, model: Model, mine: ActiveEffect) -> tuple[Model, int]:
    """The model with one effect's instants that predict the check best, of how many."""
    used, material = check.mask & check.moving, check.predictor.material

    beside = replace(model, terms=tuple(t for t in model.terms if not same(t, mine)))

    def column(one: ActiveEffect) -> FloatArray:
        return check.predictor.contribution(beside, one)[used]

    sight = Sight(column, check.residual(beside)[used], sized=True)
    instants_s, ends_s = instants_of(material), ends_of(material)
    single = sight.first(mine, instants_s)
    found = sight.placed(single, instant_spacing(material), ends_s)
    best = max(mine, found, key=sight.gain)
    # Half of what chance may do is left to either kind.
    pairs, alone = len(ends_s) * (len(ends_s) + 1) // 2, 2 + len(instants_s)
    terms = tuple(best if same(t, mine) else t for t in model.terms)
    return replace(model, terms=terms), 2 * (pairs if ends(best) else alone)


def begun(robot: Robot, terms: Sequence[ActiveEffect]) -> Robot:
    """A robot whose effects come and go when those of a model do.

    Parameters
    ----------
    robot : Robot
        With effects of the same names and targets.
    terms : sequence of ActiveEffect
    """
    times: dict[tuple[str, str], dict[str, float]] = {}
    for term in terms:
        if term.effect.start:
            names = [p.name for p in term.effect.parameters]
            values = dict(zip(names, term.parameters.tolist(), strict=True))
            own = {name: values[name] for name in term.effect.edges}
            times[term.effect.name, term.target] = own
    effects = tuple(
        replace(e, parameters={**e.parameters, **times.get((e.name, e.target), {})})
        for e in robot.effects
    )
    return replace(robot, effects=effects) if times else robot
