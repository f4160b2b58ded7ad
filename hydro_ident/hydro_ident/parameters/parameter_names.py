"""Names of identified parameters taken apart: the owner's own name may have dots in it."""

from __future__ import annotations


def parts_of(name: str) -> tuple[str, str, str]:
    """Owner, effect and parameter of `[<owner>.][<effect>.]<parameter>`.

    Parameters
    ----------
    name : str

    Returns
    -------
    owner, effect, parameter : str
        Empty where there is none; an effect is one of the catalogue that has that parameter.

    Examples
    --------
    >>> parts_of("front.lift_cylinder.coulomb_friction.force")
    ('front.lift_cylinder', 'coulomb_friction', 'force')
    >>> parts_of("front.lift_link.mcx")
    ('front.lift_link', '', 'mcx')
    """
    from hydro_model.effects.catalogue import CATALOGUE

    owner, _, parameter = name.rpartition(".")
    before, _, effect = owner.rpartition(".")
    listed = CATALOGUE.get(effect)
    if listed and any(p.name == parameter for form in listed.forms for p in form.parameters):
        return before, effect, parameter
    return owner, "", parameter
