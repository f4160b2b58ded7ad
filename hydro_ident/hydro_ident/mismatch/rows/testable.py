"""What recordings cannot show whatever its size, and why."""

from __future__ import annotations

from hydro_ident.mismatch.rows.material import Material
from hydro_ident.mismatch.rows.rests import motions_in
from hydro_ident.mismatch.settings import FEW_MOTIONS
from hydro_model.effects.catalogue import targets
from hydro_model.effects.effect import Effect, Stage


def untestable(material: Material, effect: Effect) -> str:
    """Why an effect cannot show in these recordings whatever its size; empty where it can."""
    wet = any(material.is_flow(k) for k in range(len(material.channels)))
    forced = any(not material.is_flow(k) for k in range(len(material.channels)))
    flows = {Stage.FLOW_A, Stage.FLOW_B, Stage.VOLUME_A, Stage.VOLUME_B, Stage.COMPLIANCE_A}
    flows |= {Stage.COMPLIANCE_B, Stage.SIGNAL, Stage.SUPPLY, Stage.TANK}
    stages = set(effect.stages)
    if stages and stages <= flows and not wet:
        return "no flow channel was recorded (valve voltage, both pressures and position)"
    # A late pressure is told by the forces it makes, other delays by what passes the valves.
    if effect.channel == "timing" and not wet and not (forced and effect.acts_on == "pressure"):
        return "no flow channel was recorded"
    if effect.channel == "force" and not forced and not stages & flows:
        return "no force channel was recorded"
    if effect.acts_on == "pressure" and material.forces.torque:
        return "no pressures were recorded"
    if not targets(material.robot, effect):
        return "the robot has nothing that it could act on"
    if effect.channel == "force" and motions_in(material) < 2:
        return (
            "the joints move one way only: friction, gravity, levers and sensors' errors are one"
            " curve over the position"
        )
    if effect.start and (count := motions_in(material)) < FEW_MOTIONS:
        return (
            f"motions of the joints in all: {count}; an instant is not told from the"
            " position at which it falls"
        )
    return ""
