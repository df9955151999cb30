"""Telemetry of the autopilot among the packets of all senders."""

from __future__ import annotations

import pytest

from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.dialect import mavlink
from moar_companion.mavlink.identity import AutopilotFound, AutopilotRestarted
from moar_companion.mavlink.packet_count import SourceStatistics
from moar_companion.mavlink.telemetry_receiver import MESSAGE_IDS, TelemetryReceiver
from moar_companion.settings.link_config import LinkRole

from .peer import Peer


def handle(listener, packet, *, link="wire", role=LinkRole.AUTOPILOT, now_s=1.0):
    (message,) = Codec(system_id=1, component_id=195, wanted=MESSAGE_IDS).receive(packet)
    return listener.handle(message, link=link, role=role, now_s=now_s)


def test_only_the_autopilot_on_its_own_link_updates_telemetry():
    listener, autopilot = TelemetryReceiver(), Peer(1, 1)
    assert isinstance(handle(listener, autopilot.heartbeat()), AutopilotFound)
    handle(listener, Peer(1, 195).attitude(1.0))
    handle(listener, autopilot.attitude(1.0), link="another")
    assert listener.telemetry.attitude is None
    handle(listener, autopilot.attitude(1.0), now_s=2.5)
    assert listener.telemetry.attitude.received_s == 2.5


def test_a_heartbeat_on_an_operators_link_finds_no_autopilot():
    listener = TelemetryReceiver()
    assert handle(listener, Peer(1, 1).heartbeat(), role=LinkRole.OPERATOR) is None
    assert handle(listener, Peer(255, 190).ground_heartbeat(), role=LinkRole.OPERATOR) is None
    assert listener.autopilot is None
    assert listener.telemetry.ground_station.system_id == 255


def test_a_restart_clears_the_autopilots_telemetry_and_no_other():
    listener, autopilot = TelemetryReceiver(), Peer(1, 1)
    handle(listener, autopilot.heartbeat())
    handle(listener, Peer(255, 190).ground_heartbeat())
    handle(listener, autopilot.attitude(50.0))
    boot = autopilot.heartbeat(system_status=mavlink.MAV_STATE_BOOT)
    assert isinstance(handle(listener, boot), AutopilotRestarted)
    assert listener.telemetry.attitude is None
    assert listener.telemetry.ground_station is not None
    assert handle(listener, autopilot.attitude(1.0)) is None  # the clock starts again


@pytest.mark.parametrize("later_s", [0.6, 2.0, 6.0])
@pytest.mark.parametrize("gap_s", [0.0, 0.4])
def test_copies_by_a_slower_route_are_neither_a_restart_nor_another_autopilot(later_s, gap_s):
    """The direct route pauses once; the copies of its packets still arrive."""
    listener, autopilot = TelemetryReceiver(), Peer(1, 1)
    handle(listener, autopilot.heartbeat(), now_s=0.0)
    packets = {step: autopilot.attitude(100.0 + 0.02 * step) for step in range(1000)}
    copied = round(later_s / 0.02)
    for step in range(1000):
        now_s = 1.0 + 0.02 * step
        if not 10.0 <= now_s < 10.0 + gap_s:
            assert handle(listener, packets[step], now_s=now_s) is None
            assert listener.telemetry.attitude.received_s == now_s
        if step >= copied:
            before = listener.telemetry.attitude
            assert handle(listener, packets[step - copied], now_s=now_s + 0.01) is None
            assert listener.telemetry.attitude == before


def test_the_link_is_dated_by_the_autopilots_last_packet():
    listener, autopilot = TelemetryReceiver(), Peer(1, 1)
    handle(listener, autopilot.heartbeat(), now_s=3.0)
    handle(listener, Peer(255, 190).ground_heartbeat(), now_s=9.0)
    listener.count_packets(SourceStatistics(received=7, lost=2))
    link = listener.telemetry.link
    assert (link.received_s, link.packets_received, link.packets_lost) == (3.0, 7, 2)


SENSOR = mavlink.MAV_COMP_ID_OBSTACLE_AVOIDANCE


def distances(sender, *, ahead_cm=500, time_s=20.0):
    return sender.send(
        "OBSTACLE_DISTANCE",
        time_usec=int(time_s * 1e6),
        sensor_type=0,
        distances=[ahead_cm] + [65535] * 71,
        increment=5,
        min_distance=20,
        max_distance=2000,
        increment_f=0.0,
        angle_offset=0.0,
        frame=mavlink.MAV_FRAME_BODY_FRD,
    )


def obstacle(sender, x, *, boot_s=20.0):
    return sender.send(
        "OBSTACLE_DISTANCE_3D",
        time_boot_ms=int(boot_s * 1000),
        sensor_type=0,
        frame=mavlink.MAV_FRAME_BODY_FRD,
        obstacle_id=65535,
        x=x,
        y=0.0,
        z=0.0,
        min_distance=0.2,
        max_distance=20.0,
    )


@pytest.mark.parametrize("component", [1, SENSOR, 158])
def test_obstacles_are_taken_from_the_autopilot_and_from_sensors_of_its_system(component):
    listener = TelemetryReceiver()
    handle(listener, Peer(1, 1).heartbeat())
    handle(listener, distances(Peer(1, component)), now_s=2.0)
    proximity = listener.telemetry.proximity
    assert (proximity.points_m, proximity.sender) == (((5.0, 0.0, 0.0),), component)
    handle(listener, obstacle(Peer(1, component), 7.0), now_s=2.1)
    assert listener.telemetry.proximity.points_m[-1] == (7.0, 0.0, 0.0)


def test_obstacles_of_other_systems_and_on_operator_links_are_ignored():
    listener, sensor = TelemetryReceiver(), Peer(1, SENSOR)
    handle(listener, distances(sensor))
    handle(listener, Peer(1, 1).heartbeat())
    handle(listener, distances(Peer(2, SENSOR)))
    handle(listener, distances(Peer(2, 1)))
    handle(listener, distances(sensor), link="radio", role=LinkRole.OPERATOR)
    assert listener.telemetry.proximity is None
    handle(listener, distances(sensor), link="radio")  # another link to the same vehicle
    assert listener.telemetry.proximity is not None


@pytest.mark.parametrize("kind", [distances, obstacle])
def test_a_late_packet_of_a_sensor_is_dropped_and_a_restarted_sensor_is_received(kind):
    listener, sensor = TelemetryReceiver(), Peer(1, SENSOR)
    handle(listener, Peer(1, 1).heartbeat())
    field = {"ahead_cm": 900} if kind is distances else {"x": 9.0}
    near = {"ahead_cm": 300} if kind is distances else {"x": 3.0}
    stamp = "time_s" if kind is distances else "boot_s"
    handle(listener, kind(sensor, **near, **{stamp: 20.0}), now_s=2.0)
    handle(listener, kind(sensor, **field, **{stamp: 19.8}), now_s=2.01)
    assert listener.telemetry.proximity.points_m == ((3.0, 0.0, 0.0),)
    for step in range(20):
        handle(listener, kind(sensor, **field, **{stamp: 1.0 + 0.1 * step}), now_s=5.0 + 0.1 * step)
    assert listener.telemetry.proximity.points_m == ((9.0, 0.0, 0.0),)
    assert listener.telemetry.proximity.received_s == pytest.approx(6.9)


def test_an_autopilot_restart_clears_the_obstacles():
    listener, autopilot, sensor = TelemetryReceiver(), Peer(1, 1), Peer(1, SENSOR)
    handle(listener, autopilot.heartbeat())
    handle(listener, distances(sensor))
    handle(listener, autopilot.heartbeat(system_status=mavlink.MAV_STATE_BOOT))
    assert listener.telemetry.proximity is None
    handle(listener, distances(sensor, time_s=20.1), now_s=1.1)
    assert listener.telemetry.proximity is not None


def heard(listener, *systems, since_s, until_s):
    """Heartbeats of ground stations, once a second."""
    for now_s in range(since_s, until_s):
        for system in systems:
            handle(listener, Peer(system, 190).ground_heartbeat(), now_s=float(now_s))
    return listener.telemetry


def test_two_ground_stations_of_one_cycle_are_both_kept():
    telemetry = heard(TelemetryReceiver(), 255, 254, since_s=1, until_s=2)
    assert list(telemetry.ground_stations) == [255, 254]


def test_the_ground_station_of_the_last_order_is_the_operators():
    listener = TelemetryReceiver()
    assert heard(listener, 255, 254, since_s=0, until_s=12).ground_station.system_id == 254
    listener.note_order(255)
    assert heard(listener, 254, since_s=12, until_s=40).ground_station.received_s == 11.0
    listener.note_order(254)
    assert listener.telemetry.ground_station.received_s == 39.0


def test_a_command_line_that_orders_and_leaves_is_no_operators_ground_station():
    listener = TelemetryReceiver()
    heard(listener, 255, since_s=0, until_s=20)
    listener.note_order(255)
    heard(listener, 255, 245, since_s=20, until_s=23)
    listener.note_order(245)
    assert heard(listener, 255, since_s=23, until_s=40).ground_station.system_id == 255
    listener.note_order(7)  # one that sends no heartbeats
    assert listener.telemetry.ground_station.system_id == 255
