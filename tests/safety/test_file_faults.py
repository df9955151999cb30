"""Faults of the service's files are reported to operators, not to the log alone."""

from __future__ import annotations

import errno
import os
from dataclasses import replace

import pytest

from moar_companion.companion.safety.check_inputs import Host
from moar_companion.companion.safety.file_faults import FileFault, FileFaultTexts, words
from moar_companion.mavlink.telemetry import PeerHeartbeat

from ..companion.desk import Desk

FULL = FileFault(reason="no state file: disk full", action="restart goes idle")
FULL_TEXT = "MOAR: no state file: disk full, restart goes idle"
ENDED = FileFault(reason="recording ended: folder gone", action="flying on")


def test_a_fault_is_reported_once_with_its_consequence_and_so_is_its_end():
    desk = Desk().run(2.0)
    for _ in range(30):
        desk.companion.note_host(Host(file_faults=(FULL,)))
        desk.run(1.0)
    assert [text for text in desk.texts() if "state file" in text] == [FULL_TEXT]
    desk.companion.note_host(Host())
    desk.run(1.0)
    assert desk.texts()[-1] == "MOAR: no state file: disk full, over"


def test_each_of_several_faults_is_reported():
    desk = Desk().run(2.0)
    desk.companion.note_host(Host(file_faults=(FULL, ENDED)))
    desk.run(1.0)
    assert desk.texts()[-2:] == [FULL_TEXT, "MOAR: recording ended: folder gone, flying on"]


def test_a_fault_at_the_start_is_reported_once_the_autopilot_is_received():
    desk = Desk()
    desk.mute = {"HEARTBEAT"}
    desk.companion.note_host(Host(file_faults=(FULL,)))
    desk.run(2.0)
    assert desk.texts() == []
    desk.mute = set()
    desk.run(2.0)
    assert desk.texts().count(FULL_TEXT) == 1


def test_earlier_faults_are_reported_again_to_the_first_ground_station():
    texts = FileFaultTexts()
    alone = replace(Desk().run(2.0).companion.telemetry, ground_station=None)
    received = replace(alone, ground_station=PeerHeartbeat(received_s=52.0, system_id=255))
    sent = [
        list(texts.texts((FULL,), telemetry)) for telemetry in (alone, alone, received, received)
    ]
    assert sent == [[(FULL, False)], [], [(FULL, False)], []]


def test_faults_that_end_together_are_reported_in_the_order_they_began():
    faults = tuple(replace(FULL, reason=f"fault {number}") for number in range(8))
    texts, telemetry = FileFaultTexts(), Desk().run(2.0).companion.telemetry
    began = [fault for fault, _ in texts.texts(faults, telemetry)]
    assert [fault for fault, _ in texts.texts((), telemetry)] == began == list(faults)


def test_a_new_planner_does_not_end_a_fault():
    desk = Desk().run(2.0)
    desk.companion.note_host(Host(file_faults=(FULL,)))
    desk.run(1.0)
    desk.companion.take_ground(desk.companion.state.routes.limits.site_maps)
    desk.run(1.0)
    assert not desk.said("over")


@pytest.mark.parametrize(
    ("number", "short"),
    [
        (errno.ENOSPC, "disk full"),
        (errno.ENOENT, "folder gone"),
        (errno.EROFS, "read-only"),
        (errno.EACCES, "read-only"),
        (errno.EIO, "I/O error"),
    ],
)
def test_an_operating_system_error_has_a_short_reason(number, short):
    assert words(OSError(number, os.strerror(number))) == short
