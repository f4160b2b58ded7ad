"""A transducer that stands still within its scale while its joint moves."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hydro_ident.identify.identification import Identification, identify
from hydro_model.robot_files import load_robot

pytestmark = pytest.mark.needs("clarabel")


def test_a_transducer_that_stands_still_is_said(clean: Any, found: Identification) -> None:
    """It may measure so, vented: its equations stay, and a note has the likely cause."""
    still = np.where([True, False], 5.0e6, clean.p_b)
    stuck = identify(load_robot("xs031"), [clean.recording(p_b=still)])
    [note] = [n for n in stuck.notes if "throughout, though" in n]
    assert "lift_cylinder/b read 50 bar (gauge) throughout, though lift moved" in note
    assert "lift/force and lift/flow_b" in note
    assert not [n for n in found.notes if "throughout, though" in n]
