"""Colours of a report: safe for colour-blind eyes, one for each joint everywhere.

Those of joints are of the palette of M. Okabe and K. Ito, "Color Universal Design" (2008), without
its yellow, which white paper swallows. Names that begin with two dashes are of the style sheet and
differ between light and dark.
"""

from __future__ import annotations

from collections.abc import Sequence

JOINTS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
#: Of points that belong to joints of several colours: after six joints these repeat, and the next
#: symbol is taken.
_SYMBOLS = ("circle", "diamond-open", "square", "triangle-up-open")
INK, BEFORE, BAND = "--ink", "--before", "--band"


def joint_colour(joints: Sequence[str], joint: str) -> str:
    """Colour of a joint, by its place in the robot; that of text for what is no joint's.

    After six joints colours repeat: no more of them are told apart by every eye. The page says so,
    names stand beside, and points in one figure differ by `joint_symbol`.
    """
    return JOINTS[list(joints).index(joint) % len(JOINTS)] if joint in joints else INK


def joint_symbol(joints: Sequence[str], joint: str) -> str:
    """Symbol of a joint's points where others share the figure: no two have colour and symbol."""
    turn = list(joints).index(joint) // len(JOINTS) if joint in joints else 0
    return _SYMBOLS[turn % len(_SYMBOLS)]
