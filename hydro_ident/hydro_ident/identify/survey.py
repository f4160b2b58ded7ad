"""The first pass over recordings: what the later passes have to know before they start."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from hydro_ident.bag.channels import channels_of
from hydro_ident.bag.digest import Digest
from hydro_ident.bag.recorded_run import Recording
from hydro_ident.bag.recorded_with import recorded_apart
from hydro_ident.bag.streaming import cut_recording
from hydro_ident.errors import NoCyclesError
from hydro_ident.estimate.forces.standstill import Rest, least_travel, rests_of, still_joints
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.estimate.signals.traces import traces_of_piece
from hydro_ident.identify.continuity import Continuity, bridged_notes, partial_notes
from hydro_ident.identify.spool_look import SpoolLook
from hydro_ident.identify.verdict import BagLoss, losses_of, recorded_as_others
from hydro_ident.inspecting.mistaken_inputs import mistaken_rates
from hydro_ident.inspecting.mistaken_pressures import mistaken_notes
from hydro_ident.recordings.sources import Source
from hydro_model.robot import Robot


@dataclass(slots=True)
class Survey:
    """What a first look at one recording found.

    Attributes
    ----------
    name : str
    recording : Recording
        Thinned out where it is long.
    duration_s : float
    signals : SignalSurvey
    wet, dry : bool
        Pressures, joint torques were recorded.
    referenced_s, usable_s : float
        Time with a recorded reference throughout, and time in all.
    continuity : Continuity
    spools : SpoolLook
    """

    name: str
    recording: Recording
    duration_s: float
    signals: SignalSurvey
    wet: bool = False
    dry: bool = False
    referenced_s: float = 0.0
    usable_s: float = 0.0
    continuity: Continuity = field(default_factory=Continuity)
    spools: SpoolLook = field(default_factory=SpoolLook)


@dataclass(frozen=True, slots=True)
class NoCycles:
    """A recording that has no cycle of the robot.

    Attributes
    ----------
    name : str
    text : str
        What was expected and found.
    losses : tuple of BagLoss
        Every channel of the robot.
    """

    name: str
    text: str
    losses: tuple[BagLoss, ...]


@dataclass(frozen=True, slots=True)
class Looked:
    """Recordings after a first look.

    Attributes
    ----------
    sources, others : tuple of Source
        To learn from and to verify on, as far as they have cycles.
    surveys : tuple of Survey
        Of these, in that order.
    without : tuple of NoCycles
        What is left out of both.
    """

    sources: tuple[Source, ...]
    others: tuple[Source, ...]
    surveys: tuple[Survey, ...]
    without: tuple[NoCycles, ...]

    @property
    def losses(self) -> tuple[BagLoss, ...]:
        """Channels that recordings do not give."""
        none = (loss for one in self.without for loss in one.losses)
        return (*losses_of([s.recording for s in self.surveys]), *none)

    @property
    def left_out(self) -> tuple[str, ...]:
        """What is left out of both, and why, in words; none where nothing is left."""
        if not self.sources:
            return ()
        return tuple(f"{one.name}: left out: {one.text}" for one in self.without)


def looked_at(
    robot: Robot,
    sources: Sequence[Source],
    others: Sequence[Source],
    run: Callable[[Callable[[Source], Any], Sequence[Source]], Iterable[Any]] = map,
) -> Looked:
    """Look at recordings from start to end.

    Parameters
    ----------
    robot : Robot
    sources, others : sequence of Source
        To learn from and to verify on.
    run : callable
        As `map`: where the recordings are read.

    Returns
    -------
    Looked

    Raises
    ------
    BagError
        As `read_recording`, but for recordings without a cycle.
    """
    every = (*sources, *others)
    found = list(run(partial(_survey_or_none, robot=robot), every))
    kept = [isinstance(one, Survey) for one in found]

    def with_cycles(first: int, given: Sequence[Source]) -> tuple[Source, ...]:
        return tuple(source for k, source in enumerate(given, first) if kept[k])

    return Looked(
        with_cycles(0, sources),
        with_cycles(len(sources), others),
        tuple(one for one in found if isinstance(one, Survey)),
        tuple(one for one in found if isinstance(one, NoCycles)),
    )


def _survey_or_none(source: Source, robot: Robot) -> Survey | NoCycles:
    try:
        return survey_source(source, robot)
    except NoCyclesError as error:
        losses = (BagLoss(source.name, name, error.reason) for name in channels_of(robot))
        return NoCycles(source.name, str(error), tuple(losses))


def survey_source(source: Source, robot: Robot) -> Survey:
    """Look at one recording from start to end."""
    digest, signals = Digest(), SignalSurvey(robot)
    found = _Found()
    for piece in source.pieces():
        digest.add(piece)
        found.spools.add(cut_recording(piece.recording, piece.core))
        traces = traces_of_piece(piece)
        found.continuity.add(piece, traces)
        for trace in traces:
            signals.add(trace)
            found.wet |= bool(np.isfinite(trace.p_a).any() or np.isfinite(trace.p_b).any())
            found.dry |= bool(np.isfinite(trace.joint_torque).any())
            own = (trace.owned.stop - trace.owned.start) * trace.step_s
            found.usable_s += own
            found.referenced_s += 0.0 if trace.q_ref is None else own
    return Survey(
        source.name,
        digest.recording(),
        digest.duration_s,
        signals,
        found.wet,
        found.dry,
        found.referenced_s,
        found.usable_s,
        found.continuity,
        found.spools,
    )


@dataclass(slots=True)
class _Found:
    wet: bool = False
    dry: bool = False
    referenced_s: float = 0.0
    usable_s: float = 0.0
    continuity: Continuity = field(default_factory=Continuity)
    spools: SpoolLook = field(default_factory=SpoolLook)


def recorded_notes(surveys: Iterable[Survey]) -> tuple[str, ...]:
    """What is to be said of recordings themselves, each time with the recording's name."""
    looked_at = list(surveys)
    recordings = [s.recording for s in looked_at]
    others = [*mistaken_rates(recordings), *mistaken_notes(recordings)]
    others += recorded_as_others(recordings)
    names, continuities = [s.name for s in looked_at], [s.continuity for s in looked_at]
    bridged = bridged_notes(names, continuities) + partial_notes(names, continuities)
    notes = [f"{s.name}: {note}" for s in looked_at for note in s.recording.notes]
    return (*others, *apart_notes(looked_at), *notes, *bridged)


def apart_notes(surveys: Iterable[Survey]) -> list[str]:
    """Recordings whose readings came about in another way than the first one's, in words."""
    bags = [(s.name, s.recording.metadata) for s in surveys]
    return [f"{one.bag}: {one.key}: {one.text}" for one in recorded_apart(bags)]


def stuck_notes(surveys: Sequence[Survey]) -> list[str]:
    """Transducers that read the same all the while their cylinders moved, with what hangs on them.

    A pressure that was read at rest alone has no reason to change.
    """
    notes = []
    for survey in surveys:
        signals = survey.signals
        for i, cylinder in enumerate(signals.robot.cylinders):
            moved = _moved_while_read(signals, i)
            for k, (side, sensor) in enumerate((("a", signals.p_a[i]), ("b", signals.p_b[i]))):
                if moved[k] and sensor.count and not sensor.smallest_change:
                    joint = cylinder.joint
                    notes.append(
                        f"{survey.name}: {cylinder.name}/{side} read {1e-5 * sensor.mean:.4g} bar"
                        f" (gauge) throughout, though {joint} moved: unless it is vented, its"
                        f" transducer is stuck, and {joint}/force and {joint}/flow_{side} with all"
                        " that is fitted from them are wrong; leave it out of the bag"
                    )
    return notes


def _moved_while_read(signals: SignalSurvey, index: int) -> tuple[bool, bool]:
    """Whether a piston went further than one that stands still while each chamber was read.

    By its own stroke, whatever is known of other joints.
    """
    robot = signals.robot
    joint = robot.joint_index(robot.cylinders[index].joint)
    # A stroke without an angle has no lever.
    least = float(least_travel(robot)[joint]) * (signals.mean_arm(index) or 1.0)
    travel = signals.longest[index] - signals.shortest[index]
    return bool(travel[0] >= least), bool(travel[1] >= least)


def by_torques(surveys: Sequence[Survey]) -> bool:
    """Whether forces are joint torques, as no pressure was recorded.

    Parameters
    ----------
    surveys : sequence of Survey
        Of all that is fitted; what is verified on may know more.
    """
    return any(s.dry for s in surveys) and not any(s.wet for s in surveys)


def merged_signals(robot: Robot, surveys: Iterable[Survey]) -> SignalSurvey:
    """Signals of several recordings together."""
    merged = SignalSurvey(robot)
    for survey in surveys:
        merged.merge(survey.signals)
    return merged


def still_positions(
    surveys: Sequence[Survey], still: Sequence[int]
) -> Mapping[str, Mapping[int, Rest]]:
    """How joints are that stand still, by recording: those in which they move leave them out.

    Parameters
    ----------
    surveys : sequence of Survey
        Also of recordings that are not fitted.
    still : sequence of int
        Joints that stand still in all that are fitted.
    """
    result = dict[str, dict[int, Rest]]()
    for one in surveys:
        own = still_joints(one.signals.robot, one.signals)
        rests = rests_of(one.signals, still)
        result[one.name] = {j: rest for j, rest in rests.items() if j in own}
    return result


def parked_elsewhere(
    fitted: SignalSurvey, still: Mapping[str, Mapping[int, Rest]]
) -> dict[str, dict[int, float]]:
    """Joints that stand still far from where they stood in all that is fitted, and how far.

    As far as a joint's least travel is near: a joint that goes no further stands still, too.

    Parameters
    ----------
    fitted : SignalSurvey
        Of all recordings that are fitted.
    still : mapping of str to mapping of int to Rest
        As `still_positions` returns it.

    Returns
    -------
    dict of str to dict of int to float
        Distances in rad or m by recording and joint; recordings without such joints left out.
    """
    near, result = least_travel(fitted.robot), dict[str, dict[int, float]]()
    for name, joints in still.items():
        off = {j: max(fitted.low[j] - r.at, r.at - fitted.high[j]) for j, r in joints.items()}
        far = {j: float(d) for j, d in off.items() if d > near[j]}
        result |= {name: far} if far else {}
    return result
