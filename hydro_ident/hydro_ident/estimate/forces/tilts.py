"""Base parameters that show only by a slight tilt of an axis: fitted where the data show them.

Of a second axis that is 0.1 degrees off the first one's direction, inertias that parallel axes
hide show by a share of 2e-3 of what the others do, and by the square of that. No run of a machine
tells those from its noise, so that asking for more motion would help nobody: what the recordings
do not determine of them stays as in the robot file, as parameters of barrels and rods do.
"""

from __future__ import annotations

import math

from hydro_ident.estimate.forces.closed_chain import HeldPart, Solve, held_fit
from hydro_ident.estimate.forces.force_rows import ForceModel
from hydro_ident.estimate.forces.listed_values import Determined
from hydro_ident.estimate.statistics.least_squares import Fit
from hydro_model.multibody.base_parameters import base_map
from hydro_model.multibody.square_axes import squared

#: Tilts up to this are slight: a degree and a bit, by which a parameter shows to two percent.
SLIGHT_RAD = 0.02


def tilted_names(model: ForceModel) -> frozenset[str]:
    """Base parameters that there would not be with slightly tilted axes parallel or square.

    Parameters
    ----------
    model : ForceModel

    Returns
    -------
    frozenset of str
        Empty also where the other parameters would be led by others than now.
    """
    straight, slips = squared(model.robot, SLIGHT_RAD)
    left = set(base_map(straight).names) if slips else set(model.base.names)
    return frozenset(set(model.base.names) - left if left <= set(model.base.names) else ())


def keep_tilted(
    model: ForceModel,
    fit: Fit,
    held: tuple[HeldPart, ...],
    solve: Solve,
    determined: Determined,
) -> tuple[Fit, tuple[HeldPart, ...]]:
    """Hold what shows by a slight tilt alone and is not determined, the least certain first.

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
        Those given, and those that stay the robot file's.
    """
    names, slight = model.base.names, frozenset[str]()
    while True:
        fixed, known = {part.index for part in held}, determined(fit, held)
        missing = [i for i in range(len(names)) if not known[i] and i not in fixed]
        if missing and not slight:
            slight = tilted_names(model)
        missing = [i for i in missing if names[i] in slight]
        if not missing:
            return fit, held
        worst = max(missing, key=lambda i: float(fit.std[i]))
        value = float((model.base.combination @ model.robot.parameter_vector)[worst])
        reason = (
            f"stays the robot file's, {value:.4g}: it shows only by axes that are less than"
            f" {math.degrees(SLIGHT_RAD):.2g} degrees from parallel or square, and these"
            f" recordings leave it uncertain by {fit.std[worst]:.2g}"
        )
        held = (*held, HeldPart(worst, value, reason))
        fit = held_fit(fit, {part.index: part.value for part in held}, solve)
