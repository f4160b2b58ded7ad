"""Which numbers the base has on some rows: those of forces, of balances and of instruments."""

from __future__ import annotations

from dataclasses import dataclass

from hydro_ident.estimate.flows.chambers import INVERSE_BULK, Chamber
from hydro_ident.mismatch.rows.material import Material
from hydro_ident.mismatch.rows.ripple import ripple_name
from hydro_ident.mismatch.rows.skew import TORQUE_SKEW, TORQUES, skew_name

DELAY = "command_delay"


def delay_name(chamber: Chamber) -> str:
    """What the delay of a chamber's valve is called."""
    return f"{chamber.valve.name}.{DELAY}"


@dataclass(frozen=True, slots=True)
class BaseColumns:
    """The base's numbers by name, and where among them those of valves and sensors are.

    Attributes
    ----------
    names : tuple of str
        Of forces, by cylinder bulk and edges, valves' delays, ripples, skews.
    delays, ripples : dict of int to int
        Where the delay of each cylinder's valve is, and the ripple of its pressures; of a valve
        that was never commanded no delay can be told, and none is there.
    skews : dict of int to int
        Where the skew of each chamber's pressure is, chambers a and b of each cylinder in turn,
        and that of all measured torques, `TORQUES`.
    torque_joints : tuple of int
        Joints with rows of a torque that is measured.
    """

    names: tuple[str, ...]
    delays: dict[int, int]
    ripples: dict[int, int]
    skews: dict[int, int]
    torque_joints: tuple[int, ...]

    @staticmethod
    def of(material: Material) -> BaseColumns:
        """The numbers that a material's rows have columns of."""
        cylinders = material.robot.cylinders
        by_torques = _read_by_torques(material)
        forces = any(not material.is_flow(k) for k in range(len(material.channels)))
        names = list(material.forces.names) if forces else []
        chambers = _flow_chambers(material)
        for chamber in chambers:
            own = [f"{chamber.cylinder.name}.{INVERSE_BULK}"]
            own += [f"{chamber.valve.name}.{edge}" for edge in chamber.edges]
            names += [name for name in own if name not in names]
        commanded = material.commanded()
        delays = {c.index: delay_name(c) for c in chambers if c.index in commanded}
        ripples = {i: ripple_name(cylinders[i].name) for i in _rippled(material)}
        read = dict.fromkeys([*_read_by_pressures(material), *(c.index for c in chambers)])
        skews = {2 * i + k: skew_name(cylinders[i].name, side)
                 for i in read for k, side in enumerate("ab")}  # fmt: skip
        skews |= {TORQUES: TORQUE_SKEW} if by_torques else {}
        whole = (*names, *delays.values(), *ripples.values(), *skews.values())
        return BaseColumns(
            whole,
            {i: whole.index(name) for i, name in delays.items()},
            {i: whole.index(name) for i, name in ripples.items()},
            {i: whole.index(name) for i, name in skews.items()},
            tuple(by_torques),
        )


def _read_by_pressures(material: Material) -> list[int]:
    """Cylinders with rows of a force that is that of pressures."""
    if material.forces.torque:
        return []
    robot = material.robot
    forced = {material.joint_of(p.channel) for p in material.places
              if not material.is_flow(p.channel)}  # fmt: skip
    joints = [robot.joint_index(cylinder.joint) for cylinder in robot.cylinders]
    return [i for i, joint in enumerate(joints) if joint in forced]


def _read_by_torques(material: Material) -> list[int]:
    """Joints with rows of a torque that is measured."""
    forced = {material.joint_of(p.channel) for p in material.places
              if not material.is_flow(p.channel)}  # fmt: skip
    dry = material.robot.dry_joints
    return [j for j in sorted(forced) if material.forces.torque or j in dry]


def _rippled(material: Material) -> list[int]:
    """Cylinders read by pressures beside a balance that knows the valve."""
    known = dict.fromkeys(c.index for c in _flow_chambers(material))
    forced = _read_by_pressures(material)
    return [i for i in known if i in forced]


def _flow_chambers(material: Material) -> list[Chamber]:
    """Chambers with rows of their balance."""
    return [
        material.chambers[material.chamber_index(k)]
        for k in range(len(material.channels))
        if material.is_flow(k)
    ]
