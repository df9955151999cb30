"""Packets of one sender, counted by their numbers and the sender's clock."""

from __future__ import annotations

import random

import pytest

from moar_companion.mavlink.packet_count import PacketCount

RATE_HZ = 400


class Sender:
    """A sender of 400 packets a second, each eighth with its time; a link that may drop them."""

    def __init__(self, *, boot_s: float = 100.0, number: int = 0, stamped_every: int = 8):
        self.count = PacketCount()
        self.boot_s = boot_s
        self.number = number
        self.stamped_every = stamped_every
        self.sent = 0

    def packet(self):
        """The next packet: its bytes, number and time."""
        boot_ms = int(self.boot_s * 1000) % 2**32 if self.sent % self.stamped_every == 0 else None
        packet = self.sent.to_bytes(4, "big"), self.number % 256, boot_ms
        self.sent += 1
        self.number += 1
        self.boot_s += 1 / RATE_HZ
        return packet

    def receive(self, *packets, off_stream=False):
        for data, sequence, boot_ms in packets:
            if not self.count.is_copy(data):
                self.count.count(data, sequence, boot_ms=boot_ms, off_stream=off_stream)

    def send(self, packets):
        self.receive(*(self.packet() for _ in range(packets)))

    def lose(self, packets):
        for _ in range(packets):
            self.packet()

    @property
    def counted(self):
        return self.count.statistics[:2]


@pytest.mark.parametrize("lost", [1, 79, 128, 176, 200, 255, 256, 257, 500, 512, 1000, 1500])
@pytest.mark.parametrize("before", [800, 803, 807])
def test_a_gap_of_any_length_is_lost_as_long_as_it_was(lost, before):
    sender = Sender()
    sender.send(before)
    sender.lose(lost)
    sender.send(800)
    assert sender.counted == (before + 800, lost)


def test_several_gaps_of_whole_rounds_add_up():
    sender = Sender()
    for _ in range(5):
        sender.send(800)
        sender.lose(256)
    sender.send(8)
    assert sender.counted == (4008, 5 * 256)


def test_packets_out_of_order_are_not_lost():
    sender, drawn = Sender(), random.Random(1)
    packets = [sender.packet() for _ in range(2000)]
    order = sorted(range(2000), key=lambda index: index + drawn.uniform(0.0, 60.0))
    order.remove(1999)
    sender.receive(*(packets[index] for index in order), packets[1999])
    sender.send(9)
    assert sender.counted == (2009, 0)


@pytest.mark.parametrize("late", [0, 5, 100, 127, 300])
def test_copies_count_neither_as_received_nor_as_lost(late):
    sender = Sender()
    packets = [sender.packet() for _ in range(2400)]
    sender.receive(*packets[:800])
    for index in range(800, 2400):
        sender.receive(packets[index], packets[index - late])
    sender.send(9)
    assert sender.counted == (2409, 0)


def test_copies_belong_to_no_stream_only_once():
    sender = Sender()
    packets = [sender.packet() for _ in range(64)]
    for packet in packets:
        sender.receive(packet, packet, off_stream=True)
    sender.send(1)
    assert sender.count.statistics == (65, 0, 64)


def test_the_clock_wraps_without_a_loss():
    sender = Sender(boot_s=2**32 * 1e-3 - 2.0)
    sender.send(1600)
    sender.lose(300)
    sender.send(400)
    assert sender.counted == (2000, 300)


@pytest.mark.parametrize("number", [0, 77, 200])
@pytest.mark.parametrize("boot_s", [0.5, 5000.0])
def test_a_restart_loses_no_packets_and_those_after_it_count(number, boot_s):
    sender = Sender()
    sender.send(1000)
    sender.number, sender.boot_s = number, boot_s
    sender.send(1000)
    assert sender.counted == (2000, 0)
    sender.lose(300)
    sender.send(80)
    assert sender.counted == (2080, 300)


def test_a_packet_of_another_clock_changes_nothing():
    sender = Sender()
    sender.send(1000)
    for boot_ms in (5, 10**9):
        sender.receive((b"other", 9, boot_ms))
        sender.send(16)
    sender.lose(300)
    sender.send(8)
    assert sender.counted == (1040, 300)


def test_after_a_pause_of_the_sender_nothing_counts_as_lost():
    sender = Sender()
    sender.send(1000)
    sender.lose(60 * RATE_HZ)
    sender.send(400)
    assert sender.count.statistics.lost == 0


def test_a_sender_without_a_clock_is_counted_by_its_numbers():
    sender = Sender(stamped_every=10**9)
    sender.sent = 1
    sender.send(600)
    sender.lose(100)
    sender.send(600)
    assert sender.counted == (1200, 100)
    repeated = (b"radio", 17, None)
    for _ in range(3):
        assert not sender.count.is_copy(b"radio")
        sender.receive(repeated)


def test_a_clock_that_ends_leaves_the_numbers():
    sender = Sender()
    sender.send(800)
    sender.stamped_every = 10**9
    sender.send(600)
    sender.lose(100)
    sender.send(600)
    assert sender.counted == (2000, 100)
