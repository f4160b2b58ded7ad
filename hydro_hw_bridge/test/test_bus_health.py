"""How a bus is: what is counted, whether its controller is there, how long frames waited."""

from __future__ import annotations

import errno

import can
import pytest

from hydro_hw_bridge.bus.bus_health import BusCounters, BusHealth
from hydro_hw_bridge.bus.error_frames import BUS_OFF, CONTROLLER, RESTARTED, error_frame

ACTIVE, ERROR = can.BusState.ACTIVE, can.BusState.ERROR
INTERFACES = ("socketcan", "virtual", "udp_multicast", "simulated_faults", "pcan")
NO_FRAME = can.CanOperationError("could not unpack received message")


def frame() -> can.Message:
    return can.Message(arbitration_id=0x80, is_extended_id=False, data=b"\x01")


@pytest.fixture
def health() -> BusHealth:
    return BusHealth("socketcan")


def test_a_bus_that_was_just_opened_is_well(health: BusHealth) -> None:
    assert health.counters == BusCounters(0, 0, 0, 0, 0, 0)
    assert (health.off, health.last_error, health.passed) == (False, "", 0)
    assert not hasattr(health.counters, "__dict__")  # what is misspelt is no counter


def test_data_frames_are_given_on_and_nothing_else_is(health: BusHealth) -> None:
    one = frame()
    assert health.read(one) is one
    assert health.read(None) is None
    assert health.read(error_frame(CONTROLLER)) is None
    assert health.counters == BusCounters(received=1, error_frames=1)
    assert health.last_error == "controller"


def test_a_controller_is_off_until_it_is_restarted_or_receives(health: BusHealth) -> None:
    for on_again in (error_frame(RESTARTED), frame()):
        health.read(error_frame(BUS_OFF))
        assert health.off
        # Neither a pause nor another error says that it is back.
        health.read(None)
        health.read(error_frame(CONTROLLER))
        assert health.off
        health.read(on_again)
        assert not health.off
    assert health.counters == BusCounters(received=1, error_frames=5)
    # One that says both at once has left.
    health.read(error_frame(BUS_OFF | RESTARTED))
    assert health.off


@pytest.mark.parametrize("interface", INTERFACES)
def test_what_is_no_frame_is_passed_over_where_anybody_may_send_it(interface: str) -> None:
    health = BusHealth(interface)
    anybody = interface in ("udp_multicast", "simulated_faults")
    assert health.passes_over(NO_FRAME) == anybody
    assert health.passed == health.counters.malformed == int(anybody)
    # An interface that is gone is none, whatever its name.
    for gone in (
        can.CanOperationError("Network is down"),
        OSError("unpack"),
        ValueError("unpack"),
    ):
        assert not health.passes_over(gone)
    assert health.counters.malformed == int(anybody)


def test_whatever_is_passed_over_is_counted_once() -> None:
    health = BusHealth("udp_multicast")
    health.passes_over(NO_FRAME)
    health.read(error_frame(CONTROLLER))
    health.read(error_frame(CONTROLLER))
    health.read(frame())
    assert health.passed == 3


@pytest.mark.parametrize("interface", INTERFACES)
def test_frames_waited_since_this_computer_got_them(interface: str) -> None:
    health = BusHealth(interface)
    told = interface != "pcan"  # its stamps count from when it was opened
    assert health.waited_s(100.0, 100.25) == (0.25 if told else 0.0)
    assert health.waited_s(100.25, 100.0) == 0.0


def test_a_sender_hears_itself_but_where_it_is_known_not_to() -> None:
    """Where it does not, whoever sends the same frame again is somebody else."""
    hear = [interface for interface in INTERFACES if BusHealth(interface).hears_itself]
    assert hear == ["udp_multicast", "simulated_faults", "pcan"]


@pytest.mark.parametrize("interface", INTERFACES)
def test_an_interface_tells_when_frames_came_or_does_not(interface: str) -> None:
    assert BusHealth(interface).tells_waiting is (interface != "pcan")


def caused(error: BaseException, cause: BaseException) -> BaseException:
    error.__cause__ = cause
    return error


@pytest.mark.parametrize("number", [errno.ENOBUFS, errno.EAGAIN])
def test_a_full_queue_drops_whoever_says_it(health: BusHealth, number: int) -> None:
    full = OSError(number, "full")
    told = (
        full,
        can.CanOperationError("full", number),
        caused(can.CanOperationError("failed"), full),
        caused(can.CanOperationError("failed"), caused(OSError("again"), full)),
    )
    for error in told:
        health.refused(error, ACTIVE)
    assert health.counters == BusCounters(dropped=4)
    assert not health.off


def test_what_is_refused_otherwise_is_an_error(health: BusHealth) -> None:
    down = OSError(errno.ENETDOWN, "down")
    for error in (down, can.CanOperationError("down"), caused(can.CanError("failed"), down)):
        health.refused(error, ACTIVE)
    # The error's own number counts before that of what caused it.
    health.refused(caused(down, OSError(errno.ENOBUFS, "full")), ACTIVE)
    assert health.counters == BusCounters(send_errors=4)
    assert not health.off


def test_an_interface_that_refuses_may_say_that_its_controller_left(health: BusHealth) -> None:
    full = OSError(errno.ENOBUFS, "full")
    health.refused(full, ERROR)
    assert health.off
    # It does not come back by what is refused, nor by what is sent.
    health.refused(full, ACTIVE)
    health.took()
    assert health.off
    assert health.counters == BusCounters(sent=1, dropped=2)
