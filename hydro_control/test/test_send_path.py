"""`send_path` sends within its time or not at all."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from hydro_control.node import send_path
from hydro_control.node.send_path import SendError, _deliver


@pytest.fixture
def publisher() -> Any:
    """One that keeps what it was given, and is believed at once."""
    sent: list[str] = []
    return SimpleNamespace(
        topic_name="/tip_path", sent=sent, publish=sent.append, wait_for_all_acked=lambda _s: True
    )


@pytest.mark.parametrize("stopped_s", [0.0, 60.0])
def test_a_path_whose_time_is_over_is_not_sent_however_it_went_by(
    publisher: Any, monkeypatch: pytest.MonkeyPatch, stopped_s: float
) -> None:
    """A process that was stopped on its way finds a controller when nobody waits any more."""
    now = [100.0]

    def heard(*_: Any) -> bool:
        now[0] += stopped_s
        return True

    node = SimpleNamespace(context=SimpleNamespace(get_domain_id=lambda: 7))
    clock = SimpleNamespace(monotonic=lambda: now[0], sleep=lambda _s: None)
    monkeypatch.setattr(send_path, "time", clock)
    monkeypatch.setattr(send_path, "_is_heard", heard)
    if not stopped_s:
        _deliver(node, publisher, "path", 5.0)
        assert publisher.sent == ["path"]
        return
    with pytest.raises(
        SendError, match=r"no controller listens on /tip_path within 5 s in ROS domain 7"
    ):
        _deliver(node, publisher, "path", 5.0)
    assert publisher.sent == []
