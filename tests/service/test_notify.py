"""Notifications of the service manager, and their rate."""

from __future__ import annotations

import socket

import pytest

from moar_companion.service.systemd import Watchdog, notify


@pytest.fixture(params=["a path", "an abstract name"])
def manager(request, tmp_path, monkeypatch):
    """The service manager's socket."""
    address = str(tmp_path / "notify")
    if request.param == "an abstract name":
        address = "@" + address
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as item:
        item.bind(address.replace("@", "\0"))
        item.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", address)
        for name in ("WATCHDOG_USEC", "WATCHDOG_PID"):
            monkeypatch.delenv(name, raising=False)
        yield item


def notifications(manager):
    """All notifications since the last call."""
    received = []
    while True:
        try:
            received.append(manager.recv(64))
        except BlockingIOError:
            return received


def test_a_service_manager_is_notified(manager):
    notify("READY=1")
    assert notifications(manager) == [b"READY=1"]


def test_without_a_manager_nothing_happens(monkeypatch, tmp_path):
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    notify("READY=1")
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "nobody"))
    notify("READY=1")


def test_the_watchdog_is_fed_at_once_and_then_twice_in_its_time(manager, monkeypatch):
    monkeypatch.setenv("WATCHDOG_USEC", "2000000")
    watchdog = Watchdog()
    for tick in range(101):
        watchdog.feed(50.0 + 0.02 * tick)  # two seconds at 50 Hz
    assert notifications(manager) == [b"WATCHDOG=1"] * 3


def test_after_a_pause_the_watchdog_is_fed_once(manager, monkeypatch):
    monkeypatch.setenv("WATCHDOG_USEC", "2000000")
    watchdog = Watchdog()
    watchdog.feed(50.0)
    watchdog.feed(90.0)
    watchdog.feed(90.02)
    assert notifications(manager) == [b"WATCHDOG=1"] * 2


@pytest.mark.parametrize(
    "environment", [{}, {"WATCHDOG_USEC": "100000", "WATCHDOG_PID": "1"}, {"WATCHDOG_USEC": "soon"}]
)
def test_a_service_manager_that_does_not_ask_this_process_is_not_notified(
    environment, manager, monkeypatch
):
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    Watchdog().feed(50.0)
    assert notifications(manager) == []
