"""The autopilots' fences: PX4's as recorded (r_fence) and in its source; uploaded areas."""

import math

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl.fence_areas import FenceAreas, Item

PX4_LAND, PX4_HOLD = (4, 6), (4, 3)
POLYGON_IN, POLYGON_OUT, CIRCLE_IN, CIRCLE_OUT = range(5001, 5005)
DISTANCE = "Geofence: exceeding maximum distance to Home\t"
ALTITUDE = "Geofence: exceeding maximum altitude above Home\t"
AREA = "Geofence: approaching or outside geofence\t"


def flown_out(make_flight, **parameters):
    """A flight in OFFBOARD at 10 m, towards a point 30 m north."""
    flight = make_flight(parameters={"COM_OF_LOSS_T": 0.5, **parameters})
    flight.take_off()
    flight.hold_at(x=30.0)
    return flight


def test_a_breach_of_the_circle_holds_with_system_status_five(make_flight):
    """Recorded: the text, 0.05 s later "Failsafe activated", HOLD with system_status 5."""
    flight = flown_out(make_flight, GF_MAX_HOR_DIST=10.0, GF_ACTION=2)
    assert flight.run(20.0, until=lambda f: f.truth.mode == "AUTO.LOITER")
    assert 9.5 < flight.truth.position_ned_m[0] < 12.0
    flight.run(0.2)
    assert flight.gcs.texts()[-2:] == [DISTANCE, "Failsafe activated\t"]
    assert flight.heartbeat().system_status == 5


def test_the_text_is_sent_once_more_while_px4_is_outside(make_flight):
    flight = flown_out(make_flight, GF_MAX_HOR_DIST=10.0, GF_ACTION=2)
    flight.run(20.0, until=lambda f: f.truth.mode == "AUTO.LOITER")
    first_s = flight.now_s
    flight.run(8.0)
    sent_s = [t for t, m in flight.gcs.received if getattr(m, "text", "") == DISTANCE]
    assert len(sent_s) == 2
    assert sent_s[1] - sent_s[0] == pytest.approx(2.1, abs=0.2)
    assert sent_s[0] == pytest.approx(first_s, abs=0.3)


def test_a_landing_ordered_outside_is_overruled_to_hold(make_flight):
    """Recorded: LAND with status 4 for 3.1 s, then HOLD, status 5, until the end."""
    flight = flown_out(make_flight, GF_MAX_HOR_DIST=10.0, GF_ACTION=2)
    flight.run(20.0, until=lambda f: f.truth.mode == "AUTO.LOITER")
    flight.run(3.0)
    flight.stream = None
    assert set(flight.mode(flight.gcs, PX4_LAND)) == {0}
    ordered_s = flight.now_s
    flight.run(1.5)
    assert flight.truth.mode == "AUTO.LAND"
    assert flight.heartbeat().system_status == 4
    assert flight.run(5.0, until=lambda f: f.truth.mode == "AUTO.LOITER")
    assert flight.now_s - ordered_s == pytest.approx(3.1, abs=0.3)
    flight.run(30.0)
    assert flight.truth.mode == "AUTO.LOITER"
    assert flight.heartbeat().system_status == 5
    assert not flight.truth.on_ground


@pytest.mark.parametrize(
    ("action", "mode"),
    [(0, "OFFBOARD"), (1, "OFFBOARD"), (2, "AUTO.LOITER"), (3, "AUTO.RTL"), (5, "AUTO.LAND")],
)
def test_gf_action_decides(make_flight, action, mode):
    flight = flown_out(make_flight, GF_MAX_HOR_DIST=10.0, GF_ACTION=action)
    flight.run(20.0, until=lambda f: f.truth.position_ned_m[0] > 10.5)
    flight.run(0.5)
    assert flight.truth.mode == mode
    assert (DISTANCE in flight.gcs.texts()) is bool(action)


def test_the_height_counts_from_home(make_flight):
    flight = make_flight(parameters={"GF_MAX_VER_DIST": 15.0, "GF_ACTION": 2})
    flight.take_off()
    flight.hold_at(z=-20.0)
    assert flight.run(20.0, until=lambda f: f.truth.mode == "AUTO.LOITER")
    assert flight.truth.position_ned_m[2] == pytest.approx(-15.0, abs=2.0)
    flight.run(0.2)
    assert ALTITUDE in flight.gcs.texts()


def upload(flight, items):
    """A ground station's upload; items: command, param1, metres north and east of home."""
    options = flight.vehicle.options
    scale = math.radians(6_371_000.0)
    flight.gcs.send(mavlink.MAVLink_mission_count_message(1, 1, len(items), 1))
    for seq, (command, value, north_m, east_m) in enumerate(items):
        flight.run(0.1)
        assert flight.gcs.last("MISSION_REQUEST_INT").seq == seq
        latitude = options.latitude_deg + north_m / scale
        longitude = options.longitude_deg + east_m / (
            scale * math.cos(math.radians(options.latitude_deg))
        )
        flight.gcs.send(
            mavlink.MAVLink_mission_item_int_message(
                1, 1, seq, 0, command, 0, 1, value, 0, 0, 0,
                round(latitude * 1e7), round(longitude * 1e7), 0, 1,
            )
        )  # fmt: skip
    flight.run(0.1)
    assert flight.gcs.last("MISSION_ACK").type == 0


SQUARE = [
    (POLYGON_IN, 4, north_m, east_m)
    for north_m, east_m in ((-10, -10), (12, -10), (12, 10), (-10, 10))
]


def test_the_companion_can_read_back_an_uploaded_fence(make_flight):
    flight = make_flight()
    flight.run(1.0)
    upload(flight, [*SQUARE, (CIRCLE_OUT, 7.5, 30.0, 0.0)])
    flight.companion.send(mavlink.MAVLink_mission_request_list_message(1, 1, 1))
    flight.run(0.1)
    assert flight.companion.last("MISSION_COUNT").count == 5
    flight.companion.send(mavlink.MAVLink_mission_request_int_message(1, 1, 4, 1))
    flight.run(0.1)
    item = flight.companion.last("MISSION_ITEM_INT")
    assert (item.seq, item.command, item.param1) == (4, CIRCLE_OUT, 7.5)
    assert (item.target_system, item.target_component, item.mission_type) == (1, 195, 1)


def test_px4_holds_at_an_uploaded_polygon(make_flight):
    flight = make_flight(parameters={"GF_ACTION": 2})
    flight.take_off()
    upload(flight, SQUARE)
    flight.hold_at(x=30.0)
    assert flight.run(20.0, until=lambda f: f.truth.mode == "AUTO.LOITER")
    assert flight.truth.position_ned_m[0] == pytest.approx(12.0, abs=1.5)
    flight.run(0.2)
    assert AREA in flight.gcs.texts()


def test_ardupilot_rejects_a_target_outside_a_polygon_and_brakes_at_the_polygon(make_ardupilot):
    flight = make_ardupilot(parameters={"FENCE_ENABLE": 1, "FENCE_TYPE": 4, "FENCE_ACTION": 4})
    flight.take_off()
    upload(flight, SQUARE)
    flight.hold_at(x=30.0)
    flight.run(4.0)
    assert flight.truth.position_ned_m[0] < 1.0
    upload(flight, [(CIRCLE_OUT, 5.0, 0.0, 0.0)])
    assert flight.run(1.0, until=lambda f: f.truth.mode == "BRAKE")
    assert "Polygon fence breached" in flight.gcs.texts()


def test_ardupilots_least_height_counts_once_it_was_reached_and_not_in_a_landing(make_ardupilot):
    flight = make_ardupilot(
        parameters={
            "FENCE_ENABLE": 1, "FENCE_TYPE": 8, "FENCE_ALT_MIN": 4.0, "FENCE_ACTION": 4,
        }
    )  # fmt: skip
    flight.take_off()
    assert flight.truth.mode == "GUIDED"
    flight.vehicle.set_parameter("FENCE_ALT_MIN", 12.0)
    flight.run(1.0)
    assert flight.truth.mode == "BRAKE"
    assert "Min Alt fence breached" in flight.gcs.texts()


def test_areas_count_together_or_each():
    areas = FenceAreas()
    areas.items = (
        Item(command=CIRCLE_IN, value=100.0, latitude_deg=45.0, longitude_deg=7.0),
        Item(command=CIRCLE_IN, value=100.0, latitude_deg=45.001, longitude_deg=7.0),
    )
    assert areas.outside(45.0, 7.0)
    assert not areas.outside(45.0, 7.0, union=True)
    assert not areas.outside(45.0005, 7.0)
    assert areas.outside(45.01, 7.0, union=True)
