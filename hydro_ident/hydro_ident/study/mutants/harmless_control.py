"""Changes of the controller that no test can or need notice, each with the reason."""

from __future__ import annotations

from collections.abc import Iterator

from hydro_ident.study.mutants.arguments import LENGTHS, UNREAD, begins, each
from hydro_ident.study.mutants.listed import Harmless


def _runaway() -> Iterator[Harmless]:
    watch, ends = "RunawayWatch", "_driven_range"
    why = UNREAD.format("with the first sample driving begins, which sets it")
    yield from begins("runaway", f"{watch}.__init__", "_in_a_row", ("pass", "-1", "1"), why)
    judge = "def judge(self, stamp_s: float, q: FloatArray, *, driven: bool) -> str:"
    yield Harmless(
        "runaway", f"{watch}.judge", judge, judge.replace("*", "/"),
        "the controller's core says what the word means",
    )  # fmt: skip
    for looking in ("_beyond", "_too_fast"):
        yield Harmless(
            "runaway", f"{watch}.{looking}", 'return ""', "pass",
            "None is as empty as the text: it is only asked whether there is anything",
        )  # fmt: skip
    fast = "if tip_speed > self._tip_fastest:"
    yield Harmless(
        "runaway", f"{watch}._too_fast", fast, fast.replace(">", ">="),
        "a root of squares is not exactly a limit but by chance, and may be either then",
    )  # fmt: skip
    grid = "by a step of a hundredth of the reach more or less, it ends before the lever does"
    yield from each("runaway", "", "_STEPS = 100", ("_STEPS = 101", "_STEPS = 99"), grid)
    short = "short = arm {} np.sign(arm[{}]) {} SHORTEST_LEVER_M"
    before = short.format("*", "0", "<")
    yield Harmless(
        "runaway", ends, before, short.format("*", " 1", "<"),
        "a lever of 5 mm and more does not turn over within a hundredth of the reach",
    )  # fmt: skip
    yield Harmless(
        "runaway", ends, before, short.format("/", "0", "<"),
        "divided by 1 or -1 is multiplied by it",
    )  # fmt: skip
    yield Harmless(
        "runaway", ends, before, short.format("*", "0", "<="),
        "a lever computed along a grid is not exactly 5 mm but by chance, and may be either then",
    )  # fmt: skip


def _following_error() -> Iterator[Harmless]:
    judge = "self, stamp_s: float, q: FloatArray, q_d: FloatArray, epoch: int, *, held: bool"
    yield Harmless(
        "following_error", "FollowingWatch.judge", judge, judge.replace("*", "/"),
        "the controller's core says what the word means",
    )  # fmt: skip
    joints = "for i, (far, most) in enumerate(zip(behind, self._most, strict=True)):"
    yield Harmless(
        "following_error", "FollowingWatch.judge", joints, joints.replace("True", "False"),
        LENGTHS.format("the law has refused positions that are not one of each joint"),
    )  # fmt: skip
    forwards = "since, forwards = self._since[i], far {} 0.0"
    yield Harmless(
        "following_error", "FollowingWatch._stuck", forwards.format(">"), forwards.format(">="),
        "a joint that is further away than it may be is not at 0 from where it shall be",
    )  # fmt: skip


def _doubtful() -> Iterator[Harmless]:
    near = "bound not in (0.0, spec.typical) and abs(value - bound) {} _AT_BOUND * abs(bound)"
    yield Harmless(
        "doubtful", "_at_bound", near.format("<="), near.format("<"),
        "a fit ends at a bound or away from it: exactly a millionth off it may be either",
    )  # fmt: skip
    yield Harmless(
        "doubtful", "_doubt", 'return ""', "pass",
        "None is as empty as the text, and its caller gives the text on",
    )  # fmt: skip
    spanning = (
        "spanning = (i for i, p in enumerate(effect.parameters) if p.lower <= 0.0 {} p.upper)"
    )
    yield Harmless(
        "doubtful", "_sizes", spanning.format("<="), spanning.format("<"),
        "the catalogue has no parameter of which 0 is the highest value",
    )  # fmt: skip


def _sample_join() -> Iterator[Harmless]:
    of_one = "of_rails = tuple(None if rail is None else rail[{}] for rail in rails)"
    yield Harmless(
        "sample_join", "SampleJoin.add_pressures", of_one.format("0"), of_one.format(" -1"),
        "one name was asked for: the first of its values is the last",
    )  # fmt: skip
    yield Harmless(
        "sample_join", "SampleJoin.newest", "return None", "pass",
        "a function that ends without a value gives None, too",
    )  # fmt: skip


_NAMED = "every caller names the word, and one that does not is as right"


def _bad_samples() -> Iterator[Harmless]:
    judge = "def judge(self, stamp_ns: int, found: str, *, anew: bool) -> str:"
    after = judge.replace("*", "/")
    yield Harmless("bad_samples", "BadSampleWatch.judge", judge, after, _NAMED)


def _applied() -> Iterator[Harmless]:
    for where, arguments in (
        ("commanded", "stamp_ns: int, voltage_v: FloatArray"),
        ("_judge", "commanded: FloatArray, applied: FloatArray"),
    ):
        before = f"def {where}(self, {arguments}, *, moving: bool) -> None:"
        after = before.replace("*", "/")
        yield Harmless("applied", f"AppliedWatch.{where}", before, after, _NAMED)


def _stamps() -> Iterator[Harmless]:
    off = "if abs(steps - max(1, round(steps))) {} _OFF:"
    yield Harmless(
        "stamps", "StampWatch.follows", off.format(">"), off.format(">="),
        "no number of samples less a whole one is the very float 0.1: it has finer digits",
    )  # fmt: skip


OF_CONTROL: tuple[Harmless, ...] = (
    *_runaway(),
    *_following_error(),
    *_doubtful(),
    *_sample_join(),
    *_bad_samples(),
    *_applied(),
    *_stamps(),
)
