"""What an effect of a robot file acts on: cylinders, joints, pressures or the whole robot."""

from __future__ import annotations

from dataclasses import dataclass

from hydro_model.effects.effect import Effect
from hydro_model.effects.law import COMPLIANCE, FLOW, VOLUME, Term
from hydro_model.effects.units import effect_units
from hydro_model.errors import RobotError
from hydro_model.robot import FloatArray, Robot

#: Stages that belong to one chamber.
CHAMBER_STAGES = {
    side: frozenset({FLOW[side], VOLUME[side], COMPLIANCE[side]}) for side in ("a", "b")
}


@dataclass(frozen=True, slots=True)
class Place:
    """One thing that an effect acts on.

    Attributes
    ----------
    name : str
        Of the cylinder, joint, pressure or robot.
    cylinder : int or None
        Index in `Robot.cylinders`, where it is one or a chamber of one.
    joint : int or None
        Index in `Robot.joints`, where it is a joint.
    index : int
        What a `ReadingChange` is given: of the joint, of the pressure in `Robot.pressure_names`,
        of the cylinder, or 0.
    side : str
        ``a`` or ``b`` where laws act on that chamber alone, else empty.
    """

    name: str
    cylinder: int | None = None
    joint: int | None = None
    index: int = 0
    side: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class ActiveEffect:
    """An effect at work on one target of a robot.

    Attributes
    ----------
    effect : Effect
    cylinder : int or None
        Index in `Robot.cylinders`; None where the effect acts on the whole robot or on a joint.
    parameters : (k,) array
        In the order of `Effect.parameters`.
    joint : int or None
        Index in `Robot.joints` of a joint without cylinder, or of the joint that an effect of
        joints acts on.
    target : str
        Name of the one cylinder, joint, pressure or robot.
    index : int
        What `Effect.reading` is given.
    side : str
        ``a`` or ``b`` where the laws act on that chamber alone, else empty.
    prismatic : bool or None
        Whether `joint` slides; None where the effect acts on none.
    """

    effect: Effect
    cylinder: int | None
    parameters: FloatArray
    joint: int | None = None
    target: str = ""
    index: int = 0
    side: str = ""
    prismatic: bool | None = None

    @property
    def everywhere(self) -> bool:
        """Whether it acts on the whole robot, and on no joint or cylinder alone."""
        return self.cylinder is None and self.joint is None

    @property
    def units(self) -> tuple[str, ...]:
        """Units of its parameters at this target: at a joint without cylinder those of the joint.

        They are in the order of `Effect.parameters`.
        """
        return effect_units(self.effect, self.prismatic)

    @property
    def terms(self) -> tuple[Term, ...]:
        """Its laws at this target: those of a single chamber where it is one."""
        if not self.side:
            return self.effect.terms
        other = CHAMBER_STAGES["b" if self.side == "a" else "a"]
        return tuple(term for term in self.effect.terms if term.stage not in other)


def at_work(robot: Robot, effect: Effect, place: Place, parameters: FloatArray) -> ActiveEffect:
    """An effect at work at a place of a robot.

    Parameters
    ----------
    robot : Robot
    effect : Effect
    place : Place
    parameters : (k,) array
    """
    own = place.cylinder, parameters, place.joint, place.name, place.index, place.side
    prismatic = None if place.joint is None else robot.joints[place.joint].prismatic
    return ActiveEffect(effect, *own, prismatic)


def joint_of(robot: Robot, one: ActiveEffect) -> int:
    """Index of the joint that an effect acts on, by itself or by its cylinder (else the first).

    Parameters
    ----------
    robot : Robot
    one : ActiveEffect
    """
    if one.joint is not None:
        return one.joint
    return robot.joint_index(robot.cylinders[one.cylinder or 0].joint)


def parts(robot: Robot, one: ActiveEffect) -> list[ActiveEffect]:
    """An effect at each of its targets, by the same numbers, where it acts on the whole robot.

    Parameters
    ----------
    robot : Robot
    one : ActiveEffect

    Returns
    -------
    list of ActiveEffect
        Itself alone where it acts on a single target.
    """
    if not one.everywhere or one.effect.acts_on == "robot":
        return [one]
    own = places(robot, one.effect, robot.name, robot.name)
    return [at_work(robot, one.effect, place, one.parameters) for place in own]


def targets(robot: Robot, effect: Effect) -> tuple[str, ...]:
    """The names of everything in a robot that an effect can act on, one by one.

    Parameters
    ----------
    robot : Robot
    effect : Effect

    Returns
    -------
    tuple of str
        Cylinders (and joints without cylinder for effects that need none), joints, chamber
        pressures, or the robot; empty where the robot has nothing of the kind.
    """
    if effect.needs_other_joint and robot.dof < 2:
        return ()
    return tuple(place.name for place in _all(robot, effect))


def known_targets(robot: Robot, effect: Effect) -> tuple[str, ...]:
    """Every name that a robot file may write as an effect's target, other names of it included.

    Parameters
    ----------
    robot : Robot
    effect : Effect
    """
    if effect.acts_on == "robot":
        return (robot.name,)
    return tuple(_known(robot, effect))


def places(robot: Robot, effect: Effect, target: str, where: str) -> list[Place]:
    """What a listed target means for an effect.

    Parameters
    ----------
    robot : Robot
    effect : Effect
    target : str
        A cylinder, its valve, its joint or a chamber `<cylinder>/a` of it; a joint; a pressure;
        the robot's name for all of them, or for the whole robot.
    where : str
        Place of the list, for messages.

    Returns
    -------
    list of Place

    Raises
    ------
    RobotError
        The robot has no such thing, or the effect does not act on things of its kind.
    """
    if effect.needs_other_joint and robot.dof < 2:
        raise RobotError(
            f"{where}: effect '{effect.name}' looks at another joint, robot '{robot.name}' has one"
        )
    if effect.acts_on == "robot":
        if target != robot.name:
            raise RobotError(
                f"{where}: effect '{effect.name}' acts on the whole robot, expected target"
                f" '{robot.name}', found '{target}'"
            )
        return [Place(robot.name)]
    known = _known(robot, effect)
    if target not in known:
        raise RobotError(
            f"{where}: effect '{effect.name}' has unknown target '{target}'"
            f" (known: {', '.join(known)})"
        )
    return known[target]


def _all(robot: Robot, effect: Effect) -> list[Place]:
    if effect.acts_on == "robot":
        return [Place(robot.name)]
    if effect.acts_on == "joint":
        return [Place(name, None, j, j) for j, name in enumerate(robot.joint_names)]
    if effect.acts_on == "pressure":
        return _chambers(robot)
    if effect.sided:
        return [p for i in range(len(robot.cylinders)) for p in _sides(robot, i)]
    wet = [
        Place(c.name, i, None, i) for i, c in enumerate(robot.cylinders) if not effect.drive_only
    ]
    dry = () if effect.needs_cylinder else robot.dry_joints
    return wet + [Place(robot.joint_names[j], None, j, j) for j in dry]


def _sides(robot: Robot, index: int) -> list[Place]:
    """The two chambers of a cylinder, for laws that act on one of them alone."""
    name = robot.cylinders[index].name
    return [Place(f"{name}/{side}", index, None, index, side) for side in "ab"]


def _chambers(robot: Robot) -> list[Place]:
    return [
        Place(f"{c.name}/{side}", i, None, 2 * i + k)
        for i, c in enumerate(robot.cylinders)
        for k, side in enumerate("ab")
    ]


def _known(robot: Robot, effect: Effect) -> dict[str, list[Place]]:
    """Everything a robot file may write for an effect that does not act on the whole robot."""
    every = _all(robot, effect)
    known = {robot.name: every} if every else {}
    known |= {place.name: [place] for place in every}
    for i, cylinder in enumerate(() if effect.drive_only else robot.cylinders):
        own = _of_cylinder(robot, effect, i)
        aliases = [cylinder.name, cylinder.joint]
        aliases += [v.name for v in robot.valves if v.cylinder == cylinder.name]
        known |= {name: own for name in aliases if name not in known}
        if effect.acts_on == "cylinder" and _has_sides(effect):
            known |= {place.name: [place] for place in _sides(robot, i)}
    if effect.acts_on == "pressure":
        first = 2 * len(robot.cylinders)
        known |= {
            name: [Place(name, index=first + k)] for k, name in enumerate(("supply", "tank"))
        }
    return known


def _of_cylinder(robot: Robot, effect: Effect, index: int) -> list[Place]:
    if effect.acts_on == "joint":
        joint = robot.joint_index(robot.cylinders[index].joint)
        return [Place(robot.joint_names[joint], None, joint, joint)]
    if effect.acts_on == "pressure":
        return _chambers(robot)[2 * index : 2 * index + 2]
    return [Place(robot.cylinders[index].name, index, None, index)]


def _has_sides(effect: Effect) -> bool:
    stages = set(effect.stages)
    return all(stages & side for side in CHAMBER_STAGES.values())
