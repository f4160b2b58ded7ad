"""`Recording`: one run as aligned arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from hydro_ident.bag.channels import Loss
from hydro_ident.bag.ends import Ends
from hydro_ident.bag.gaps import Gap, contiguous
from hydro_ident.bag.turns import Turns
from hydro_ident.bag.valve_columns import ValveRates
from hydro_model.arrays import BoolArray, FloatArray, IntArray
from hydro_model.robot import Robot


def other_robot(metadata: Mapping[str, str], robot: Robot) -> str:
    """The robot that a bag says it was recorded of, where it is another one; else empty.

    Parameters
    ----------
    metadata : mapping of str to str
        Of the bag.
    robot : Robot
        That it is looked at as.
    """
    name = metadata.get("robot", "")
    return "" if name == robot.name else name


@dataclass(frozen=True, slots=True)
class Recording:
    """A recorded run on the grid of its cycles, N cycles of n joints, m cylinders and valves.

    Columns follow `robot.joints`, `robot.cylinders` and `robot.valves`. A quantity that was not
    recorded at all is None; an entry that is missing from a recorded topic is a column of NaN,
    and a cycle without a sample of an optional topic a row of NaN.

    Attributes
    ----------
    path : Path
    robot : Robot
    stamp_ns : (N,) int64 array
        Strictly increasing.
    period_s : float
        Median interval.
    q : (N, n) array
        rad or m; without the leaps of angles that were recorded within a turn.
    stroke : (N, m) array or None
        Measured strokes, m.
    effort : (N, n) array or None
        Measured joint torques, N m (N).
    p_a, p_b : (N, m) array or None
        Chamber pressures, Pa gauge.
    supply, tank : (N,) array or None
        Pa gauge; None: the robot file's constants hold.
    valve_v : (N, m) array or None
        V at the valves: from `/valve_state`, else (or of a valve that it does not tell) from
        `/valve_command`; of a sparse topic held from message to message, for 0.1 s at most.
    valve_source : str
        The topic that `valve_v` is from, or empty.
    command_v : (N, m) array or None
        V asked for, from `/valve_command`.
    spool : (N, m) array or None
        Measured spool position in [-1, 1].
    latched : (N,) bool array
        Cycles in which the gate held the valves at 0 V against the command.
    q_ref, qd_ref, force_ref : (N, n) array or None
        `/joint_reference`: what the controller followed, and the required piston force, N.
    tip_ref : (N, 3) array or None
        m.
    temperature_stamp_ns : (T,) int64 array or None
    temperature_c : (T,) array or None
        Oil temperature at its own stamps, degrees Celsius.
    losses : tuple of Loss
        Channels that this bag cannot give, each with its reason.
    gaps : tuple of Gap
        Where cycles are missing.
    duplicates : mapping of str to int
        Messages dropped per topic because their stamp had been there before.
    notes : tuple of str
        Damage, what is under no checksum and irregularities, in words.
    metadata : mapping of str to str
        The project's own metadata of the bag.
    dead : mapping of str to float
        Sensors that read the same throughout while their joint moved, or any in the case of an
        effort (`<joint> effort`, `<cylinder>/a`), and their readings; their columns are NaN.
    updated_between : bool
        Whether commands changed between the cycles, too, and not with each of them alone.
    turns : mapping of str to (K, 2) int array
        By joint that was recorded within a turn: stamps from which on a turn was put to it, and
        how many (1 or -1).
    commanded : tuple of str
        Valves that `/valve_state` does not tell although it tells others.
    valve_rates : ValveRates
        Which topics of valves are sparse: `valve_v` is held between their messages.
    ends : Ends
        What of joints and pressures lies outside the cycles.
    read_s : float
        From reading to reading of a message that came slower than the cycles; 0: none did.
    """

    path: Path
    robot: Robot
    stamp_ns: IntArray
    period_s: float
    q: FloatArray
    stroke: FloatArray | None
    effort: FloatArray | None
    p_a: FloatArray | None
    p_b: FloatArray | None
    supply: FloatArray | None
    tank: FloatArray | None
    valve_v: FloatArray | None
    valve_source: str
    command_v: FloatArray | None
    spool: FloatArray | None
    latched: BoolArray
    q_ref: FloatArray | None
    qd_ref: FloatArray | None
    force_ref: FloatArray | None
    tip_ref: FloatArray | None
    temperature_stamp_ns: IntArray | None
    temperature_c: FloatArray | None
    losses: tuple[Loss, ...]
    gaps: tuple[Gap, ...]
    duplicates: Mapping[str, int]
    notes: tuple[str, ...]
    metadata: Mapping[str, str]
    dead: Mapping[str, float] = field(default_factory=dict)
    updated_between: bool = False
    turns: Turns = field(default_factory=dict)
    commanded: tuple[str, ...] = ()
    valve_rates: ValveRates = field(default_factory=ValveRates)
    ends: Ends = field(default_factory=Ends)
    read_s: float = 0.0

    @property
    def other_robot(self) -> str:
        """The robot that the bag says it was recorded of, where it is another one; else empty."""
        return other_robot(self.metadata, self.robot)

    @property
    def told(self) -> list[int]:
        """Columns of the valves whose voltages are not their commands in place of them."""
        names = self.robot.valve_names
        return [k for k, name in enumerate(names) if name not in self.commanded]

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @property
    def time_s(self) -> FloatArray:
        """Time of each cycle from the first, (N,) s."""
        seconds: FloatArray = (self.stamp_ns - self.stamp_ns[0]) * 1e-9
        return seconds

    @property
    def duration_s(self) -> float:
        """From the first cycle to the last, s."""
        return float(self.stamp_ns[-1] - self.stamp_ns[0]) * 1e-9

    @property
    def segments(self) -> tuple[slice, ...]:
        """Contiguous stretches of cycles, none missing in between."""
        return contiguous(self.stamp_ns, self.period_s)
