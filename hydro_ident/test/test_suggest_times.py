"""A vector that nothing calls a time is offered as one where signals have no other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from hydro_ident.logs.file import read_log
from hydro_ident.logs.guess import Guess
from hydro_ident.logs.suggest import Suggestion, suggest

FAST = 0.002 * np.arange(2000)
SLOW = 0.8003 + 0.01 * np.arange(200)


def guesses(folder: Path, **times: np.ndarray) -> dict[str, Guess]:
    """Of a MAT file of angles with their time and of slower pressures."""
    columns = {"t": FAST, "q_rad": 0.8 + 0.1 * np.sin(FAST)}
    savemat(folder / "log.mat", {**columns, **times, "p_bar": 100.0 + 20.0 * np.sin(SLOW)})
    return {g.column: g for g in suggest(read_log(folder / "log.mat")).guesses}


@pytest.mark.parametrize("factor", [1.0, 1e3])
def test_an_even_vector_without_a_name_is_offered_as_the_time_it_may_be(
    factor: float, tmp_path: Path
) -> None:
    """It had been left out, and then no time had as many samples as the pressures."""
    found = guesses(tmp_path, tp=factor * SLOW)
    assert (found["tp"].section, found["tp"].level) == ("clocks", "guess")
    assert found["tp"].entry["unit"] == ("s" if factor == 1.0 else "ms")
    assert found["tp"].why[0] == "rises in even steps, with as many samples as 'p_bar'"
    assert found["p_bar"].entry["time"] == "tp"
    assert found["t"].entry["keep"] == "common"


def test_a_time_that_ends_where_it_began_says_nothing_of_another(tmp_path: Path) -> None:
    """Its last sample is padded with 0: there is no length to compare with."""
    found = guesses(tmp_path, t=np.append(FAST[:-1], 0.0), tp=SLOW)
    assert found["tp"].section != "clocks"


@pytest.mark.parametrize(
    "ramp",
    [
        SLOW**2,  # uneven
        SLOW[::-1],  # falls
        3.0 * SLOW,  # of another run's length
        np.append(SLOW, SLOW[-1] + 0.01),  # of no signal's
    ],
)
def test_what_is_no_even_vector_of_that_length_and_span_is_no_time(
    ramp: np.ndarray, tmp_path: Path
) -> None:
    found = guesses(tmp_path, tp=ramp)
    assert found["tp"].section == ""
    assert found["p_bar"].entry["time"] == "FILL_IN"


def test_of_two_vectors_that_may_be_the_time_neither_is_taken(tmp_path: Path) -> None:
    found = guesses(tmp_path, tp=SLOW, tx=SLOW + 1.0)
    assert found["p_bar"].entry["time"] == "FILL_IN"
    assert found["p_bar"].why[-1].endswith("of tp or tx")


LATE_1904 = 3_856_325_400.0  # 2026-03-12 in LabVIEW's seconds


def suggested(folder: Path, **times: np.ndarray) -> Suggestion:
    columns = {**times, "q_rad": 0.8 + 0.1 * np.sin(FAST), "p_bar": 100.0 + 20.0 * np.sin(FAST)}
    savemat(folder / "log.mat", columns)
    return suggest(read_log(folder / "log.mat"))


@pytest.mark.parametrize("name", ["t", "t_s", "Time"])
def test_seconds_since_1904_are_told_with_their_start(name: str, tmp_path: Path) -> None:
    found = suggested(tmp_path, **{name: LATE_1904 + FAST})
    assert found.start == "1904-01-01T00:00:00Z"
    assert found.start_why == f"'{name}' counts from 1904"
    [time] = [g for g in found.guesses if g.section == "time"]
    assert (time.entry["unit"], time.level != "open") == ("s", True)
    assert "counts s from 1904" in time.why


@pytest.mark.parametrize(
    "times",
    [
        {"t_us": np.round(1e6 * FAST) + LATE_1904},  # over an hour of a counter
        {"t": np.round(1e6 * FAST) + LATE_1904},
        {"t": LATE_1904 + 2e9 + FAST},  # after 2038 from either
    ],
)
def test_what_does_not_count_from_1904_gets_no_start(
    times: dict[str, np.ndarray], tmp_path: Path
) -> None:
    assert suggested(tmp_path, **times).start == ""
