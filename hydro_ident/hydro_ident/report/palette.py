"""Colours of a report: safe for colour-blind eyes, one for each joint everywhere.

Those of joints are of the palette of M. Okabe and K. Ito, "Color Universal Design" (2008), without
its yellow, which white paper swallows. Names that begin with two dashes are of the style sheet and
differ between light and dark.
"""

from __future__ import annotations

from collections.abc import Sequence

JOINTS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
INK, BEFORE, BAND = "--ink", "--before", "--band"


def joint_colour(joints: Sequence[str], joint: str) -> str:
    """Colour of a joint, by its place in the robot; that of text for what is no joint's."""
    return JOINTS[list(joints).index(joint) % len(JOINTS)] if joint in joints else INK
