"""Claiming a bus: who is heard, who gives way, and when a foreign bridge is gone."""

from __future__ import annotations

from collections.abc import Callable

import can
import pytest

from hydro_hw_bridge.bus import claims
from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.bus.bus_name import BusName
from hydro_hw_bridge.bus.claims import CLAIM_PERIOD_S, CONTEST_S, GONE_S, LISTEN_S, Claim
from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.protocol.codec import Codec

#: No whole number of them is the time of listening: the last wait has to be cut.
STEP_S = 0.016


class Wire(Bus):
    """A bus on which time passes by waiting, and others speak when it is theirs."""

    def __init__(self) -> None:
        super().__init__(BusName("fake", "wire"), object())
        self.now = 100.0
        self.sent: list[tuple[float, can.Message]] = []
        self.others: list[tuple[float, can.Message]] = []

    def monotonic(self) -> float:
        return self.now

    def send(self, message: can.Message) -> bool:
        self.sent.append((self.now, message))
        return True

    def receive(self, timeout_s: float) -> can.Message | None:
        assert 0.0 < timeout_s <= 0.02
        if self.others and self.others[0][0] <= self.now:
            return self.others.pop(0)[1]
        self.now += min(timeout_s, STEP_S)
        return None


@pytest.fixture
def wire(monkeypatch: pytest.MonkeyPatch) -> Wire:
    wire = Wire()
    monkeypatch.setattr(claims, "time", wire)
    return wire


@pytest.fixture
def claim(wire: Wire, codec: Codec) -> Claim:
    claim = Claim(wire, codec)
    claim.instance = 1000
    return claim


def test_whoever_lives_is_heard_in_time() -> None:
    assert pytest.approx(10 * CLAIM_PERIOD_S) == LISTEN_S
    assert 2 * CLAIM_PERIOD_S < CONTEST_S < 5 * CLAIM_PERIOD_S
    # Gone is who missed as many claims as one listens for, and not much later.
    assert LISTEN_S < GONE_S < 2 * LISTEN_S


def test_a_free_bus_is_claimed_after_listening(wire: Wire, claim: Claim, codec: Codec) -> None:
    claim.take()
    assert wire.now == pytest.approx(100.0 + LISTEN_S + CONTEST_S, abs=1e-6)
    times = [at - 100.0 for at, _ in wire.sent]
    expected = [LISTEN_S + i * CLAIM_PERIOD_S for i in range(3)]
    assert times == pytest.approx(expected, abs=STEP_S)
    assert times[0] == pytest.approx(LISTEN_S, abs=1e-6)
    frames = [codec.receive(message) for _, message in wire.sent]
    assert [f.alive for f in frames if f is not None] == list(range(len(frames)))
    assert {codec.decode_claim(f) for f in frames if f is not None} == {1000}


@pytest.mark.parametrize(
    ("at_s", "instance", "refused"),
    [
        (0.5, 1, True),
        (0.5, 2000, True),  # while listening, whoever is there stays
        (0.5, 1000, False),  # our own
        (LISTEN_S + 0.1, 999, True),  # both claim: the smaller number stays
        (LISTEN_S + 0.1, 1001, False),
        (LISTEN_S + 0.1, 1000, False),
    ],
)
def test_another_bridge_is_refused_or_refuses(
    wire: Wire, claim: Claim, codec: Codec, at_s: float, instance: int, refused: bool
) -> None:
    wire.others = [(100.0 + at_s, codec.encode_claim(instance, 3))]
    if not refused:
        claim.take()
        return
    with pytest.raises(BridgeError, match=f"instance {instance:08x}.* on CAN bus fake:wire"):
        claim.take()


def test_what_is_no_intact_claim_is_not_heard(
    wire: Wire, claim: Claim, codec: Codec, every_other: Callable[[], list[can.Message]]
) -> None:
    wire.others = [(100.1, message) for message in every_other()]
    claim.take()
    assert wire.others == []


@pytest.fixture
def every_other(codec: Codec) -> Callable[[], list[can.Message]]:
    """A claim with a bit flipped, a valve frame, and a frame of nobody's."""

    def make() -> list[can.Message]:
        broken = codec.encode_claim(1, 3)
        broken.data[3] ^= 1
        command = codec.encode_command(7, [0.0] * len(codec.valve_names), False)
        return [broken, command, can.Message(arbitration_id=0x555, is_extended_id=False)]

    return make


def test_a_foreign_bridge_is_gone_after_a_while_without_a_claim(wire: Wire, claim: Claim) -> None:
    assert not claim.others_gone()  # never heard
    assert not claim.hear(1000)  # our own
    assert not claim.others_gone()
    assert claim.hear(7)
    wire.now += GONE_S
    assert not claim.others_gone()
    wire.now += STEP_S
    assert claim.others_gone()
    assert claim.hear(7)
    assert not claim.others_gone()


def test_two_claims_have_numbers_of_their_own(wire: Wire, codec: Codec) -> None:
    numbers = {Claim(wire, codec).instance for _ in range(100)}
    assert len(numbers) == 100
    assert 1 << 31 < max(numbers) < 1 << 32
