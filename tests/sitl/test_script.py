"""The demonstration's script in lockstep: every target and every landing point of a site."""

import math
from dataclasses import asdict, replace
from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.analysis.pictures.flight_picture import FlightStory
from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from sitl.demonstration import fly as demonstration
from sitl.demonstration.judge import FlightTruth, judge
from sitl.demonstration.manners import MANNERS
from sitl.demonstration.operator import Operator
from sitl.demonstration.script import Script
from sitl.demonstration.settings import landing_choices, landing_points, read_settings
from tests.flights.judging import assert_nothing_was_touched, in_plane
from tests.flights.lockstep import Lockstep
from tests.flights.operator import Manner
from tests.thorough import thorough


class Pilot(Operator):
    """The operator without socket and clock: to read is to move the flight on."""

    def __init__(self, flight):
        super().__init__(0, MANNERS[flight.operator.manner.value], speed=1.0, meanwhile=list)
        self._flight = flight
        self._socket.close()
        flight.set_unread_streams(0)
        flight.operator = self

    def _now_s(self):
        return self._flight.now_s

    def read(self):
        self._flight.step()

    def tick(self, now_s):
        if now_s >= self._heartbeat_due_s:
            self._heartbeat_due_s = now_s + 1.0
            self._send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))

    def receive(self, data):
        for message in self._codec.parse_buffer(data) or []:
            self._take(message)

    def _send(self, message):
        data = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) % 256
        self._flight.autopilot.receive("gcs", data)


def flown(site, manner, wanted):
    """The flight of the script, and the verdict on it."""
    flight = Lockstep(site=site, vehicle="x500", manner=manner)
    script = Script(
        operator=Pilot(flight),
        manner=MANNERS[manner.value],
        processes=(),
        speed=1.0,
        height_m=demonstration._height_m(site),
        dwells_s=tuple(target.dwell_s for target in site.targets),
        landings=demonstration._landings(site, wanted, flight.vehicle),
        battery_falls=False,
        planner_ready=lambda: True,
        print_text=[].append,
    )
    script.fly()
    flight.run(0.5)
    return flight, verdict(flight, site, wanted)


def verdict(flight, site, wanted):
    story = FlightStory.of([asdict(decision) for decision in flight.decisions])
    truth = [
        FlightTruth(
            time_s=row.time_s,
            position_m=in_plane(site, row.latitude_deg, row.longitude_deg, row.altitude_amsl_m),
            on_ground=row.on_ground,
            armed=row.armed,
        )
        for row in flight.truths[::5]
    ]
    landings = [landing_points(site, *mission) for mission in landing_choices(site, wanted)]
    radius_m = flight.vehicle.radius_m
    return judge(truth, site, radius_m, story.landing_legs_m, landings)


@pytest.mark.slow
def test_the_aircraft_is_turned_after_the_take_off():
    flight = Lockstep(site="315kv_double_circuit", vehicle="x500", manner=Manner.PX4)
    script = Script(
        operator=Pilot(flight),
        manner=MANNERS["px4"],
        processes=(),
        speed=1.0,
        height_m=5.0,
        heading_deg=-60.0,
        dwells_s=(),
        landings=(),
        battery_falls=False,
        planner_ready=lambda: True,
        print_text=[].append,
    )
    script._start()
    script._take_off(5.0)
    script._turn(-60.0)
    assert math.degrees(flight.truths[-1].attitude_rad[2]) == pytest.approx(-60.0, abs=4.0)
    assert abs(flight.truths[-1].position_ned_m[2]) == pytest.approx(5.0, abs=0.8)


@pytest.mark.slow
def test_nothing_is_armed_before_the_planner_is_ready():
    flight = Lockstep(site="315kv_double_circuit", vehicle="x500", manner=Manner.PX4)
    ready_s = flight.now_s + 20.0
    script = Script(
        operator=Pilot(flight),
        manner=MANNERS["px4"],
        processes=(),
        speed=1.0,
        height_m=5.0,
        dwells_s=(),
        landings=(),
        battery_falls=False,
        planner_ready=lambda: flight.now_s >= ready_s,
        print_text=[].append,
    )
    script._start()
    assert flight.now_s >= ready_s
    assert not flight.truths[-1].armed


def test_ardupilot_is_turned_by_a_command_of_its_own():
    class Noting(Operator):
        def __init__(self):
            super().__init__(0, MANNERS["ardupilot"], speed=1.0, meanwhile=list)
            self.commands = []

        def command(self, _, number, *parameters, component=1):  # noqa: ARG002
            self.commands.append((number, *parameters))

    operator = Noting()
    operator.turn(-60.0)
    operator.close()
    assert operator.commands == [(mavlink.MAV_CMD_CONDITION_YAW, 300.0)]


THREE_LANDINGS = {"exit": ((40.0, 2.5), (44.0, 2.5)), "evacuation": ((-10.0, 2.5), (40.0, 2.5))}


@thorough
@pytest.mark.slow
@pytest.mark.parametrize("manner", Manner)
def test_every_target_and_every_landing_point_of_a_site_is_flown(manner):
    before = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
    more = replace(before.targets[0], name="upper", position_m=(26.5, 16.0), look_at_m=None)
    landing_m = {mission: THREE_LANDINGS.get(mission.value, ()) for mission in before.landing_m}
    site = replace(before, targets=(*before.targets, more), landing_m=landing_m)
    flight, found = flown(site, manner, "all")
    assert found.faults == ()
    states = [state for _, state in flight.states]
    visits = sum(before != "at_target" == now for before, now in pairwise(states))
    assert visits == 3
    assert_nothing_was_touched(flight)


@pytest.mark.parametrize(
    ("wanted", "orders"),
    [
        (None, [("exit", -1)]),
        ("exit", [("exit", -1)]),
        ("evacuation:1", [("evacuation", 1)]),
        ("all", [("exit", 0), ("exit", 1), ("evacuation", 0)]),
    ],
)
def test_the_landing_points_are_flown_in_the_order_of_the_site_each_place_once(wanted, orders):
    site = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
    site = replace(
        site, landing_m={mission: THREE_LANDINGS[mission.value] for mission in site.landing_m}
    )
    choices = [(mission.value, index) for mission, index in landing_choices(site, wanted)]
    assert choices == orders


def test_a_site_of_the_users_is_flown_whole_and_in_calm(tmp_path):
    site = str(shipped_configs() / "sites" / "120kv_single_circuit.yaml")
    usual = read_settings(["--out", str(tmp_path)])
    assert (usual.landing, usual.scenario.name) == (None, "wind_then_battery.yaml")
    assert demonstration._battery_falls(usual.scenario)
    own = read_settings(["--out", str(tmp_path), "--site", site])
    assert (own.landing, own.scenario.name) == ("all", "tour.yaml")
    assert not demonstration._battery_falls(own.scenario)
    asked = read_settings(["--site", site, "--landing", "exit:0"])
    assert asked.landing == "exit:0"
