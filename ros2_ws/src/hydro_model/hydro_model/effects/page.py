"""The catalogue as a page of documentation, from the `Effect` objects alone.

``python -m hydro_model.effects.page`` prints it; a test holds the page in the documentation to
what this prints.
"""

from __future__ import annotations

import sys

from hydro_model.effects.catalogue import CATALOGUE
from hydro_model.effects.effect import Effect
from hydro_model.effects.law import ParameterSpec, Stage

_HEAD = """# The effects

<!-- Generated: python -m hydro_model.effects.page > hydro_msgs_docs/effects.md -->

What a first model of a hydraulic manipulator leaves out, one `Effect` object per name
(`hydro_model/effects/`). Each is physics written once: the simulator rolls it out, `identify`
and `diagnose` fit it, the controller compensates what it can of it, and this page is printed from
it. A robot file lists an effect as

```yaml
effects:
  - {name: coulomb_friction, target: lift_cylinder, parameters: {force: 3000.0}}
```

**Targets.** A cylinder, its valve or its joint; `<cylinder>/a` or `/b` for one chamber; a joint; a
pressure's name; the robot's name for all of them, or for what acts on the whole machine.

**Three forms.** A *law* adds to one cylinder's equations: to its friction (N, against motion), its
flows, volumes or compliances (per chamber), its valve signal, or the rails. A *change* makes
another robot: masses, gravity, delays. A *reading* is what sensors show of it; it acts on no
machine, and `hydro_model.effects.read_with` applies it to simulated signals.

**In series.** Laws of one stage add, but for two: those of the valve signal map it one after the
other, and those of the valve's flow (underlap, compensation, counterbalance valve, hose, cushion)
each see what the ones before, in this order, have left of it. A rail gives way by the flow behind
them, but for what a hose stores.

**Signs.** Friction opposes positive piston motion (extension). Flows count into the chamber.
Pressures are gauge unless said. `q`, `x`, `v`, `u`, `p1` and `p2` are joint position, stroke,
piston velocity, normalised valve signal and the pressures of chambers A and B.

**Parameters.** *lin*: what the effect contributes is proportional to it (superposition), so that a
fit of it is linear. *opt*: a file may leave it out and gets the default. Values outside the bounds
are rejected. Units are those of a cylinder; at a turning joint without one N m stands for N and
rad for m (but not at the tip).

"""

_STAGES = {
    Stage.FRICTION: "friction force",
    Stage.SIGNAL: "valve signal",
    Stage.FLOW_A: "flow into A",
    Stage.FLOW_B: "flow into B",
    Stage.VOLUME_A: "volume of A",
    Stage.VOLUME_B: "volume of B",
    Stage.COMPLIANCE_A: "compliance of A",
    Stage.COMPLIANCE_B: "compliance of B",
    Stage.SUPPLY: "supply pressure",
    Stage.TANK: "tank pressure",
}
_FAMILIES = {
    "force": "Effects of force",
    "flow": "Effects of flow",
    "timing": "Effects of timing",
}
_KINDS = {
    "cylinder": "cylinders",
    "joint": "joints",
    "pressure": "pressure sensors",
    "robot": "the whole robot",
}


def page() -> str:
    """The page as Markdown."""
    parts = [_HEAD, _index()]
    for family, title in _FAMILIES.items():
        parts.append(f"## {title}\n\n")
        parts += [_section(e) for e in CATALOGUE.values() if e.channel == family]
    return "".join(parts).rstrip() + "\n"


def form(effect: Effect) -> str:
    """How an effect acts, in words: its laws' stages, a change of the robot, a reading."""
    words = [_STAGES[stage] for stage in effect.stages]
    if effect.change is not None:
        words.append("change of the robot")
    if effect.reading is not None:
        words.append("reading of sensors")
    return ", ".join(words)


def _index() -> str:
    rows = [
        f"| [`{e.name}`](#{e.name}) | {_cell(form(e))} | {', '.join(e.channels)} |"
        f" {', '.join(_name(n) for n in e.looks_like)} |"
        for family in _FAMILIES
        for e in CATALOGUE.values()
        if e.channel == family
    ]
    head = "| effect | acts on | shows in | looks like |\n|---|---|---|---|\n"
    return head + "\n".join(rows) + "\n\n"


def _section(effect: Effect) -> str:
    lines = [
        f"### {effect.name}",
        "",
        f"`{effect.equation}`",
        "",
        f"- acts on {_target(effect)}: {form(effect)}",
        f"- shows in {', '.join(effect.channels)}",
        f"- looks like {', '.join(_name(n) for n in effect.looks_like)}",
        f"- told apart by: {effect.separating_experiment}",
        f"- source: {effect.source}",
    ]
    if effect.limits:
        lines.append(f"- limits: {effect.limits}")
    other = effect.elsewhere
    if other is not None:
        place = "joints without cylinder" if other.drive_only else _target(other)
        lines.append(f"- at {place}: `{other.equation}` ({form(other)});")
        lines.append(f"  {other.source}; {other.limits}")
    lines += [
        "",
        "| parameter | unit | meaning | bounds | typical | |",
        "|---|---|---|---|---|---|",
    ]
    specs = [_parameter(spec) for one in effect.forms for spec in one.parameters]
    lines += dict.fromkeys(specs)
    return "\n".join(lines) + "\n\n"


def _target(effect: Effect) -> str:
    if effect.drive_only:
        return "joints without cylinder"
    kind = _KINDS[effect.acts_on]
    bare = effect.acts_on == "cylinder" and not effect.needs_cylinder
    return f"{kind}, or joints without" if bare else kind


def _parameter(spec: ParameterSpec) -> str:
    marks = ["lin"] if spec.linear else []
    if spec.optional:
        default = spec.typical if spec.default is None else spec.default
        marks.append("opt" if default == spec.typical else f"opt, default {default:g}")
    bounds = f"{spec.lower:g} to {spec.upper:g}"
    return (
        f"| `{spec.name}` | {spec.unit} | {_cell(spec.text)} | {bounds} | {spec.typical:g} |"
        f" {', '.join(marks)} |"
    )


def _name(name: str) -> str:
    return f"`{name}`" if name in CATALOGUE else _cell(name)


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


if __name__ == "__main__":
    sys.stdout.write(page())
