"""The service manager's watchdog: fed only by finished cycles."""

from __future__ import annotations

import contextlib
import signal
import socket
from itertools import pairwise

import pytest

from tests.real_time import real_time

from .manager import Manager
from .rig import COMPANION, HOLD, PAUSE_CONTINUE, Service, free_ports
from .tap import OLDEST_S, clock_s

pytestmark = pytest.mark.xdist_group("watchdog")

TIMEOUT_S = 0.8


@contextlib.contextmanager
def manager(folder):
    """Messages to the service manager."""
    address = str(folder / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as item:
        item.bind(address)
        item.settimeout(30.0)
        yield item, address


@contextlib.contextmanager
def watched(folder, **environment):
    """A service and the socket with its messages to the manager."""
    service = Service(folder, *free_ports(1))
    with manager(folder) as (receiver, address):
        service.start(NOTIFY_SOCKET=address, **environment)
        try:
            assert receiver.recv(64) == b"READY=1"
            yield service, receiver
        finally:
            service.end(signal.SIGKILL)


def fed_s(receiver, count):
    """Times at which the watchdog was fed."""
    times_s = []
    while len(times_s) < count:
        message = receiver.recv(64)
        if not message.startswith(b"STATUS="):
            assert message == b"WATCHDOG=1"
            times_s.append(clock_s())
    return times_s


@pytest.mark.slow
def test_the_watchdog_is_fed_twice_per_period_and_not_while_no_cycle_ends(tmp_path):
    with watched(tmp_path, WATCHDOG_USEC=f"{TIMEOUT_S * 1e6:.0f}") as (service, receiver):
        times_s = fed_s(receiver, 4)
        assert all(later - earlier < TIMEOUT_S for earlier, later in pairwise(times_s))
        assert times_s[-1] - times_s[0] > 2 * TIMEOUT_S / 2
        with service.stopped():
            receiver.settimeout(2 * TIMEOUT_S)
            with contextlib.suppress(TimeoutError):
                fed_s(receiver, 1)  # a message that was sent before the stop
            with pytest.raises(TimeoutError):
                receiver.recv(64)
        receiver.settimeout(30.0)
        fed_s(receiver, 2)
        service.process.terminate()
        assert receiver.recv(64) in {b"STOPPING=1", b"WATCHDOG=1"}
        assert service.process.wait(20) == 0


@real_time
def test_a_service_that_hangs_in_flight_is_restarted_reports_its_mission_and_waits(rig, tmp_path):
    rig.service.end(signal.SIGKILL)
    rig.operator.companion_received = False
    with Manager(rig.service, tmp_path) as manager:
        rig.operator.wait_for("the companion", lambda: rig.operator.companion_received, 30.0)
        rig.hover()
        rig.fly()
        hung_s = clock_s()
        rig.service.process.send_signal(signal.SIGSTOP)
        rig.operator.wait_for("the end", lambda: manager.statuses, 20.0)
        rig.operator.texts.clear()
        assert manager.statuses == [-signal.SIGABRT]
        rig.wait_for_text("MOAR: restarted, was flying inspection", 30.0)
        rig.watch(2.0)
        assert len(manager.starts) == 2
        assert rig.operator.custom_mode == HOLD
        assert rig.tap.since(hung_s + OLDEST_S) == []
        assert "Fatal Python error: Aborted" in rig.service.log()
        rig.operator.command("continue", PAUSE_CONTINUE, 1, component=COMPANION)
        rig.engage()
        assert rig.tap.since(hung_s + OLDEST_S)
