"""Listed effects that no motion tells from the base: they stay as the robot file lists them.

A rotor's inertia and the inertia of the link that it drives are one number where the axis stands
square on the one before it, as at the second joint of most arms. Whoever lists the rotor has it
from a data sheet, so that the link's is what is fitted. Without that neither would be determined,
and no run would help.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from hydro_ident.estimate.forces.closed_chain import HeldPart, Solve, held_fit
from hydro_ident.estimate.forces.force_rows import ForceModel
from hydro_ident.estimate.statistics.least_squares import Fit

Determined = Callable[[Fit, tuple[HeldPart, ...]], Sequence[bool]]


def keep_listed(
    model: ForceModel,
    fit: Fit,
    held: tuple[HeldPart, ...],
    solve: Solve,
    determined: Determined,
) -> tuple[Fit, tuple[HeldPart, ...]]:
    """Hold what is listed where that determines parameters of the base or friction.

    Parameters
    ----------
    model : ForceModel
    fit : Fit
        Of all parameters.
    held : tuple of HeldPart
        Parameters that are not free already.
    solve : callable
        The estimator.
    determined : callable
        Which parameters a fit determines.

    Returns
    -------
    Fit
    tuple of HeldPart
        Those given, and effects that stay as listed.
    """
    first = len(model.names) - len(model.effect_names)
    while True:
        missing = _missing(fit, held, determined)
        alike = [i for i in missing if i >= first and model.effect_values]
        tried = [_kept(model, fit, held, solve, i) for i in alike]
        gained = [_told(first, missing, *one, determined) for one in tried]
        best = max(range(len(tried)), key=lambda k: len(gained[k]), default=None)
        if best is None or not gained[best]:
            return fit, held
        fit, held = tried[best]
        told = ", ".join(model.names[i] for i in gained[best])
        reason = (
            f"stays as listed, {held[-1].value:.4g}: no motion of these recordings tells it"
            f" from {told}"
        )
        held = (*held[:-1], HeldPart(held[-1].index, held[-1].value, reason))


def _missing(fit: Fit, held: tuple[HeldPart, ...], determined: Determined) -> list[int]:
    fixed = {part.index for part in held}
    return [i for i, known in enumerate(determined(fit, held)) if not known and i not in fixed]


def _kept(
    model: ForceModel, fit: Fit, held: tuple[HeldPart, ...], solve: Solve, index: int
) -> tuple[Fit, tuple[HeldPart, ...]]:
    """With one more effect as it is listed."""
    value = model.effect_values[index - len(model.names) + len(model.effect_names)]
    held = (*held, HeldPart(index, value, ""))
    return held_fit(fit, {part.index: part.value for part in held}, solve), held


def _told(
    first: int,
    missing: Sequence[int],
    fit: Fit,
    held: tuple[HeldPart, ...],
    determined: Determined,
) -> list[int]:
    """What other than effects is determined once one more of these is held."""
    left = set(_missing(fit, held, determined))
    return [i for i in missing if i < first and i not in left]
