"""Faults of the service's files are reported to operators, not to the log alone."""

from __future__ import annotations

import errno
import os
from dataclasses import replace

import pytest

from moar_companion.safety.check_inputs import Host
from moar_companion.safety.file_faults import FileFault, FileFaultTexts, words
from moar_companion.telemetry import PeerHeartbeat

from ..companion.desk import Desk

FULL = FileFault(reason="no state file: disk full", action="restart goes idle")
FULL_TEXT = "MOAR: no state file: disk full, restart goes idle"
ENDED = FileFault(reason="recording ended: folder gone", action="flying on")


def test_a_fault_is_told_once_with_what_follows_and_so_is_its_end():
    desk = Desk().run(2.0)
    for _ in range(30):
        desk.companion.note_host(Host(file_faults=(FULL,)))
        desk.run(1.0)
    assert [text for text in desk.texts() if "state file" in text] == [FULL_TEXT]
    desk.companion.note_host(Host())
    desk.run(1.0)
    assert desk.texts()[-1] == "MOAR: no state file: disk full, over"


def test_several_faults_are_told_each():
    desk = Desk().run(2.0)
    desk.companion.note_host(Host(file_faults=(FULL, ENDED)))
    desk.run(1.0)
    assert desk.texts()[-2:] == [FULL_TEXT, "MOAR: recording ended: folder gone, flying on"]


def test_a_fault_of_the_start_waits_until_the_autopilot_is_heard():
    desk = Desk()
    desk.mute = {"HEARTBEAT"}
    desk.companion.note_host(Host(file_faults=(FULL,)))
    desk.run(2.0)
    assert desk.texts() == []
    desk.mute = set()
    desk.run(2.0)
    assert desk.texts().count(FULL_TEXT) == 1


def test_the_first_ground_station_is_told_what_was_told_before_it_came():
    texts = FileFaultTexts()
    alone = replace(Desk().run(2.0).companion.telemetry, ground_station=None)
    received = replace(alone, ground_station=PeerHeartbeat(received_s=52.0, system_id=255))
    told = [
        list(texts.texts((FULL,), telemetry)) for telemetry in (alone, alone, received, received)
    ]
    assert told == [[(FULL, False)], [], [(FULL, False)], []]


def test_faults_that_end_together_are_told_in_the_order_in_which_they_began():
    faults = tuple(replace(FULL, reason=f"fault {number}") for number in range(8))
    texts, telemetry = FileFaultTexts(), Desk().run(2.0).companion.telemetry
    began = [fault for fault, _ in texts.texts(faults, telemetry)]
    assert [fault for fault, _ in texts.texts((), telemetry)] == began == list(faults)


def test_a_new_planner_does_not_forget_a_fault():
    desk = Desk().run(2.0)
    desk.companion.note_host(Host(file_faults=(FULL,)))
    desk.run(1.0)
    desk.companion.take_ground(desk.companion._site_maps)
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
def test_the_reason_is_short(number, short):
    assert words(OSError(number, os.strerror(number))) == short
