"""Report sections: bodies that can exist, and the paper's summed flow equation."""

from __future__ import annotations

from collections.abc import Sequence

from hydro_ident.estimate.bodies.physical import ConsistentBody
from hydro_ident.estimate.flows.chambers import INVERSE_BULK
from hydro_ident.estimate.flows.summed_flow import SummedComparison
from hydro_ident.identify.consistent_robot import PhysicalResult, body_dict
from hydro_ident.report.page import bullets, number, table


def physical_part(result: PhysicalResult | None) -> str:
    """Consistent bodies, and whether they reproduce the base parameters.

    Parameters
    ----------
    result : PhysicalResult or None

    Returns
    -------
    str
        Empty without a result.
    """
    if result is None:
        return ""
    parts = ["<h3>Physically consistent bodies</h3>", bullets(result.problems, "no")]
    found = result.parameters
    if found is None:
        return "\n".join(parts)
    said = (
        "They reproduce the base parameters exactly; what motion does not show is as close to"
        " the given values as can be."
        if found.feasible
        else "They belong to the closest base parameters that bodies can have, which are not"
        " used: the model keeps those identified."
    )
    head = ("body", "mass in kg", "centre of mass in m", "inertia about it in kg m²", "change")
    parts += [f"<p>{said}</p>", table(head, [_row(body) for body in found.bodies])]
    parts.append(
        "<p>Inertia: xx, yy, zz, xy, xz, yz. Change: log-determinant divergence from the given"
        " body.</p>"
    )
    return "\n".join(parts)


def _row(body: ConsistentBody) -> tuple[str, ...]:
    data = body_dict(body)
    com, inertia = data.get("com_m"), data.get("inertia_com_kg_m2")
    if com is None or inertia is None:
        moments = ", ".join(f"{k} {v:.4g}" for k, v in body.parameters.items() if k != "mass")
        return body.name, f"{data['mass_kg']:.5g}", "–", moments, f"{body.divergence:.3g}"
    order = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    return (
        body.name,
        f"{data['mass_kg']:.5g}",
        ", ".join(f"{v:.4g}" for v in com),
        ", ".join(f"{inertia[i][k]:.4g}" for i, k in order),
        f"{abs(body.divergence):.3g}",
    )


def summed_part(comparisons: Sequence[SummedComparison]) -> str:
    """Eq. 14 beside the separate chambers: conditioning and estimates.

    Parameters
    ----------
    comparisons : sequence of SummedComparison

    Returns
    -------
    str
        Empty where there are none.
    """
    if not comparisons:
        return ""
    head = ("parameter", "summed", "chamber A", "chamber B", "error factor summed", "A", "B")
    rows = []
    for c in comparisons:
        parts = (c.summed, c.chamber_a, c.chamber_b)
        conditions = [f"{p.condition_number:.3g}" for p in parts]
        rows.append((f"{c.cylinder}: condition number", *conditions, "", "", ""))
        for name in c.summed.names:
            at = [p.names.index(name) if name in p.names else -1 for p in parts]
            pairs = list(zip(parts, at, strict=True))
            values = [number(p.theta[k]) if k >= 0 else "–" for p, k in pairs]
            factors = [number(p.error_factor[k], 3) if k >= 0 else "–" for p, k in pairs]
            unit = "1/Pa" if name == INVERSE_BULK else "m³/(s √Pa)"
            rows.append((f"{c.cylinder}.{name} in {unit}", *values, *factors))
    return "\n".join(
        (
            "<p>Not used. Same windows and delay, ordinary least squares, without listed effects;"
            " an error factor is what collinearity multiplies a parameter's error by.</p>",
            table(head, rows),
        )
    )
