"""What is hidden shows where it should, and as much as its size says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_hw_bridge.rig.extras import Extras
from hydro_ident.study.detection_limit import (
    HALF_POWER,
    channel_names,
    detectability,
    noise_spectra,
)
from hydro_ident.study.experiments import Motion
from hydro_ident.study.hidden import Machine, Scene, machine_extras
from hydro_ident.study.planting import KNOWN, OUTSIDE
from hydro_ident.study.traces import EVERY, drive, nuisance, thinned, trace
from hydro_model.effects.catalogue import CATALOGUE
from hydro_model.effects.effect import Stage
from hydro_model.effects.rows import signal_rows

#: What may show beside the channel an effect belongs to: its own cylinder's others, or all.
FORCE = {"force"}
FLOW = {"flow_a", "flow_b"}
EVERYWHERE = {
    *("payload_change", "base_tilt", "external_contact", "encoder_offset"),
    *("encoder_eccentricity", "structural_flexibility", "cylinder_inertia"),
    *("supply_droop", "tank_back_pressure", "entrained_air", "pump_ripple"),
    *("command_delay", "pressure_delay"),
}
BOTH = {"backlash", "pressure_sensor_bias", "pressure_sensor_gain", "sensor_hum"}


def test_plain_machine_leaves_no_trace(plain: Machine, motion: Motion) -> None:
    left = trace(drive(plain, motion, 1), plain)
    assert np.abs(left[:, 0::3]).max() < 1e-6
    assert np.abs(np.delete(left, [0, 3], axis=1)).max() < 1e-14


@pytest.mark.parametrize("name", [*KNOWN, *OUTSIDE])
def test_effect_shows_in_its_channel_and_in_no_other(
    name: str, plain: Machine, scene: Scene, motion: Motion
) -> None:
    hidden = (KNOWN | OUTSIDE)[name]
    assert hidden.needs(plain, 1)
    size = float(np.sqrt(hidden.low * hidden.high))
    machine = hidden.apply(plain, scene, 1, size, 3)
    left = trace(drive(machine, motion, 1), plain)
    sizes = np.sqrt(np.mean(left**2, axis=0)) / np.tile([1.0, 1e-7, 1e-7], 2)
    shown = {n for n, s in zip(channel_names(plain), sizes, strict=True) if s > 1e-3}
    assert shown, name
    if name in EVERYWHERE:
        return
    own = {n.split("/")[1] for n in shown if n.startswith("tilt/")}
    assert not any(n.startswith("lift/") for n in shown), shown
    in_force = name in BOTH or own == FORCE
    in_flow = name in BOTH or own <= FLOW
    assert in_force or in_flow, (name, shown)
    expected = "force" if "friction" in name or "force" in name else None
    assert expected is None or own == FORCE


@pytest.mark.parametrize("name", ["coulomb_friction", "dead_volume", "pressure_sensor_bias"])
def test_trace_grows_like_the_size(
    name: str, plain: Machine, scene: Scene, motion: Motion
) -> None:
    hidden, sizes = KNOWN[name], []
    for factor in (1.0, 2.0):
        size = 3.0 * hidden.low * factor
        run = drive(hidden.apply(plain, scene, 0, size, 5), motion, 1)
        sizes.append(detectability(run, plain, size, delay=True))
    assert sizes[1].limit == pytest.approx(sizes[0].limit, rel=0.1)
    assert sizes[1].noncentrality == pytest.approx(4.0 * sizes[0].noncentrality, rel=0.25)


def test_limit_is_where_the_best_test_has_half_power(
    plain: Machine, scene: Scene, motion: Motion
) -> None:
    """Monte Carlo: random forces on the piston, and the effect's trace at its limit."""
    hidden, size = KNOWN["coulomb_friction"], 100.0
    loud = machine_extras(plain, disturbance_n=300.0, disturbance_time_s=0.05)
    run = drive(hidden.apply(loud, scene, 0, size, 5), motion, 1)
    found = detectability(run, loud, size, delay=True)
    shape = trace(run, loud)[:, 0] * found.limit / size
    columns = nuisance(run, loud, delay=True)[0][: len(shape)]
    spectrum = noise_spectra(run, loud)[0]

    def white(values: np.ndarray) -> np.ndarray:
        spectral = np.fft.rfft(values, axis=0)
        return np.asarray(np.fft.irfft((spectral.T / np.sqrt(spectrum)).T, len(values), axis=0))

    basis, size_, _ = np.linalg.svd(white(columns), full_matrices=False)
    basis = basis[:, size_ > 1e-9 * size_[0]]
    direction = white(shape)
    direction -= basis @ (basis.T @ direction)
    direction /= np.linalg.norm(direction)
    random, hits, chance, tries = np.random.default_rng(4), 0, 0, 300
    steps, keep = len(shape) * EVERY, np.exp(-2e-3 / 0.05)
    from scipy.signal import lfilter

    for _ in range(tries):
        fresh = random.standard_normal(steps + 500) * 300.0 * np.sqrt(1.0 - keep**2)
        noise = thinned(lfilter([1.0], [1.0, -keep], fresh)[500:, None])[:, 0]
        hits += (direction @ white(noise + shape)) ** 2 > 6.635
        chance += (direction @ white(noise)) ** 2 > 6.635
    assert pytest.approx(6.63, abs=0.01) == HALF_POWER
    # The refit shares columns between the joints here: half power within sampling and that.
    assert 0.35 < hits / tries < 0.65
    assert chance / tries < 0.04


def test_quiet_machine_has_no_extras_left(plain: Machine) -> None:
    assert replace(plain.truth, extras=Extras()).extras == Extras()


def test_the_catalogues_play_is_what_a_loose_pin_leaves(plain: Machine, scene: Scene) -> None:
    """Another simulator's dead zone, by the law that is fitted: most of its trace."""
    width, tilt = 3e-4, 1
    # To and fro through where the outer link hangs down: its load turns every time.
    t = np.arange(0.0, 16.0, 2e-3)
    turned = 0.35 * np.sin(1.1 * t) * np.clip(t / 2.0, 0.0, 1.0)
    q = np.stack([np.full(t.size, 0.2), -0.5 * np.pi - 0.2 + turned], axis=1)
    machine = KNOWN["backlash"].apply(plain, scene, tilt, width, 3)
    run = drive(machine, Motion("excite", q, np.gradient(q, 2e-3, axis=0)), 1)
    states, step_s = run.track.states, run.track.cycle_s
    p_a, p_b = states[:, 5], states[:, 7]
    pressures = np.stack([p_a, p_b, np.full(p_a.size, np.nan), np.zeros(p_a.size)], axis=1)
    rows = signal_rows(
        plain.robot, tilt, tilt, t, states[:, :2], states[:, 2:4], pressures=pressures
    )
    parameters = [width, 300.0, plain.truth.cylinders[tilt].viscous_friction, 0.0]
    left = trace(run, plain)
    for column, stage in ((4, Stage.FLOW_A), (5, Stage.FLOW_B)):
        law = CATALOGUE["backlash"].evaluate(rows, parameters, stage, step_s)
        # What is left is what the chamber took up less than the law puts in; as mean flows over
        # 40 ms, without the start.
        wanted, found = (thinned(x, 4)[75:] for x in (-left[:, column], thinned(law)))
        assert np.sum((wanted - found) ** 2) < 0.25 * np.sum(wanted**2), stage
        assert found @ wanted / (found @ found) == pytest.approx(1.0, abs=0.15)
