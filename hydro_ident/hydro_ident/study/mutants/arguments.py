"""How changes that need no notice are written down, and reasons that several have."""

from __future__ import annotations

from collections.abc import Iterator

from hydro_ident.study.mutants.listed import Harmless

UNREAD = "the first value is never read: {}"
NO_NEGATIVE = "counters begin at 0: any number below stands for none of them"
HALF_A_WRAP = "half a wrap ahead and half a wrap back are the same place of a wrap"
LENGTHS = "the lengths are equal by then: {}"
DRIVING_FIRST = "it is read while driving alone, and what begins to drive sets it"


def each(
    target: str, where: str, before: str, afters: tuple[str, ...], why: str
) -> Iterator[Harmless]:
    """A line with each of several others in its place.

    Parameters
    ----------
    target : str
        Name of a module's tests, as in `listed`.
    where : str
        Class and function.
    before : str
        As it stands there.
    afters : tuple of str
    why : str
        Nothing notices.
    """
    for after in afters:
        yield Harmless(target, where, before, after, why)


def begins(
    target: str, where: str, name: str, values: tuple[str, ...], why: str, first: str = "0"
) -> Iterator[Harmless]:
    """An assignment in a constructor with other values; `pass`: without it.

    Parameters
    ----------
    target : str
        Name of a module's tests, as in `listed`.
    where : str
        Class and function.
    name : str
        Of the attribute.
    values : tuple of str
    why : str
        Nothing notices.
    first : str
        The value that it is given.
    """
    before = f"self.{name} = {first}"
    afters = tuple("pass" if value == "pass" else f"self.{name} = {value}" for value in values)
    yield from each(target, where, before, afters, why)
