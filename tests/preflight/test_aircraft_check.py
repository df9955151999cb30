"""The aircraft checked before a flight: in lockstep with the fake autopilot, and by example."""

from dataclasses import replace

import pytest

from moar_companion.companion.error_margin import flown_site
from moar_companion.companion.preflight.aircraft_check import WAIT_S, Preflight
from moar_companion.companion.preflight.findings import Level
from moar_companion.mavlink.dialect import mavlink
from moar_companion.mavlink.signing import Signing, SigningKey
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Site
from moar_companion.settings.config import CompanionConfig, Supervision, shipped_configs
from moar_companion.settings.link_config import LinkConfig, LinkRole
from moar_companion.settings.vehicle import Vehicle
from moar_companion.types import ARDUPILOT, Mission
from sitl.autopilot import DEFAULT_LINKS, FakeAutopilot, Options
from sitl.fence_areas import Item
from sitl.signing import SignOptions

from ..copies import flown_once
from ..flights.aircraft import set_unread_streams
from ..mavlink.signed import MINUTE, OTHER_SECRET, SECRET, SignedPeer

CONFIGS = shipped_configs()
SITE = Site.load(CONFIGS / "sites" / "315kv_double_circuit.yaml")
VEHICLE = Vehicle.load(CONFIGS / "vehicles" / "x500.yaml")
PLANNER = Planner(flown_site(SITE, VEHICLE, Supervision()), VEHICLE)
LINK = "udp:127.0.0.1:14540"
STEP_S = 0.02
OK, NOTE, WARNING, NO_GO = Level
PX4_AS_ASKED = {
    "COM_OF_LOSS_T": 0.5,
    "COM_OBL_RC_ACT": 5,
    "COM_RC_OVERRIDE": 3,
    "NAV_RCL_ACT": 1,
}


def planner_of(site, vehicle):
    same = (site, vehicle) == (SITE, VEHICLE)
    return PLANNER if same else Planner(flown_site(site, vehicle, Supervision()), vehicle)


@flown_once
def running(age_s, **options):
    """A fake autopilot that has run for a while."""
    autopilot = FakeAutopilot(Options(**options))
    set_unread_streams(autopilot, -1)
    autopilot.step(age_s)
    autopilot.data_to_send()
    return autopilot


class Look:
    """A look at a fake autopilot on the site, which has run for a while."""

    def __init__(
        self,
        *,
        site=SITE,
        vehicle=VEHICLE,
        at_m=(27.0, 0.0, 0.0),
        age_s=10.0,
        ground_station=False,
        signing=None,
        **options,
    ):
        home = SITE.frame.to_geodetic(at_m)
        place = {
            "latitude_deg": home.latitude_deg,
            "longitude_deg": home.longitude_deg,
            "altitude_amsl_m": home.altitude_amsl_m,
        }
        # The text of links, by which a flight is known, hides their key.
        run = running.__wrapped__ if "links" in options else running
        self.autopilot = run(age_s, **{**place, **options})
        config = CompanionConfig(
            vehicle=CONFIGS, links=(LinkConfig(url=LINK, signed=signing is not None),)
        )
        planner = None if site is None else planner_of(site, vehicle)
        self.preflight = Preflight(config, vehicle, planner, signing=signing)
        self.sent = []
        self.now_s = 0.0
        self.connected = True
        self.lost = set()
        """Names of parameters whose values never arrive."""
        self.deaf_to_fences = False
        """True if requests for the uploaded fence never arrive."""
        self._ground = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self._ground_station = ground_station
        self._age_s = age_s

    def step(self):
        self.now_s += STEP_S
        if self._ground_station and round(self.now_s / STEP_S) % 50 == 1:
            beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
            self.autopilot.receive("gcs", beat.pack(self._ground))
        self.autopilot.step(self._age_s + self.now_s)
        for link, data in self.autopilot.data_to_send():
            if link == "companion" and self.connected and not self._is_lost(data):
                self.preflight.receive(LINK, data, self.now_s)
        self.preflight.tick(self.now_s)
        for _, data in self.preflight.data_to_send():
            self.sent.append(data)
            asks = any(item.get_type() == "MISSION_REQUEST_LIST" for item in messages([data]))
            if not (asks and self.deaf_to_fences):
                self.autopilot.receive("companion", data)

    def _is_lost(self, data):
        return any(name.encode() in data for name in self.lost)

    def findings(self):
        """Everything that was found, by subject."""
        while not self.preflight.done:
            self.step()
        return {item.subject: item for item in self.preflight.findings()}


def messages(data):
    return mavlink.MAVLink(None).parse_buffer(b"".join(data)) or []


def test_an_aircraft_with_recommended_parameters_is_a_go():
    look = Look(ground_station=True, parameters=PX4_AS_ASKED)
    found = look.findings()
    assert {name for name, item in found.items() if item.level is NO_GO} == set()
    assert found["firmware"].text == "PX4 1.17.0"
    assert found["state"].text == "HOLD, disarmed, on the ground"
    assert found["ground station"].level is OK
    assert found["position"].text.startswith("x 27.")
    assert found["battery 0"].level is OK
    for name in ("LOCAL_POSITION_NED", "ATTITUDE", "ready to arm", "height", *PX4_AS_ASKED):
        assert found[name].level is OK, str(found[name])


def test_a_second_companion_is_a_warning():
    look, second = Look(), mavlink.MAVLink(None, srcSystem=1, srcComponent=195)
    for step in range(40):
        look.step()
        if step % 10 == 0:
            beat = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)
            look.preflight.receive(LINK, beat.pack(second), look.now_s)
    found = look.findings()
    assert found["companion"].level is WARNING
    assert found["companion"].text == "another sender has the ids 1 and 195"


def test_px4_with_default_parameters_is_a_no_go_for_its_offboard_loss_action():
    found = Look().findings()
    assert [name for name, item in found.items() if item.level is NO_GO] == [
        "take over",
        "companion failure",
    ]
    assert found["COM_OBL_RC_ACT"].level is WARNING
    assert found["COM_OF_LOSS_T"].level is WARNING
    assert found["ground station"].level is WARNING
    assert found["remote control"].level is WARNING


def test_ardupilot_with_recommended_parameters_is_a_go():
    vehicle = replace(VEHICLE, autopilot=None, risk=replace(VEHICLE.risk, cells=3))
    look = Look(
        autopilot="ardupilot",
        age_s=60.0,
        vehicle=vehicle,
        ground_station=True,
        parameters={"GUID_TIMEOUT": 0.5, "FS_THR_ENABLE": 3},
    )
    found = look.findings()
    assert {name for name, item in found.items() if item.level is NO_GO} == set()
    assert found["firmware"].text == "ArduPilot 4.6.3"
    for name in ("LOCAL_POSITION_NED", "ATTITUDE", "position", "GUID_TIMEOUT", "FS_THR_ENABLE"):
        assert found[name].level is OK, str(found[name])


def test_ardupilot_with_default_parameters_flies_on_for_long_and_hits_no_obstacle():
    vehicle = replace(VEHICLE, autopilot=None, risk=replace(VEHICLE.risk, cells=3))
    found = Look(autopilot="ardupilot", age_s=60.0, vehicle=vehicle).findings()
    assert [name for name, item in found.items() if item.level is NO_GO] == []
    assert found["GUID_TIMEOUT"].level is WARNING
    assert found["companion failure"].level is OK
    assert found["FS_THR_ENABLE"].level is WARNING


def test_ardupilot_before_its_gps_has_no_position():
    look = Look(autopilot="ardupilot", age_s=5.0, vehicle=replace(VEHICLE, autopilot=None))
    found = look.findings()
    assert found["LOCAL_POSITION_NED"].level is NO_GO
    assert found["LOCAL_POSITION_NED"].text == "not received"
    assert found["position"].text == "no local position is received"


def test_the_check_sends_heartbeats_and_requests_and_no_packet_that_commands_motion():
    look = Look()
    look.findings()
    sent = messages(look.sent)
    assert {item.get_srcComponent() for item in sent} == {195}
    assert {item.get_type() for item in sent} <= {
        "HEARTBEAT",
        "TIMESYNC",
        "PING",
        "COMMAND_LONG",
        "PARAM_REQUEST_READ",
        "MISSION_REQUEST_LIST",
        "MISSION_REQUEST_INT",
        "MISSION_ACK",
    }
    asking = {mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL}
    assert {item.command for item in sent if item.get_type() == "COMMAND_LONG"} <= asking
    beats = [item for item in sent if item.get_type() == "HEARTBEAT"]
    assert len(beats) == pytest.approx(look.now_s, abs=2)


def test_a_link_without_any_system_is_a_finding():
    look = Look()
    look.connected = False
    (finding,) = look.findings().values()
    assert look.now_s == pytest.approx(WAIT_S, abs=0.1)
    assert finding.level is NO_GO
    assert f"none received on {LINK} for 10 s" in finding.text
    assert "TX and RX crossed" in finding.remedy


def test_bytes_without_an_autopilot_are_reported():
    look = Look()
    look.connected = False
    look.preflight.receive(LINK, bytes(500), 0.0)
    (finding,) = look.findings().values()
    assert "500 bytes received" in finding.remedy


def test_two_autopilots_are_both_named():
    look = Look()
    other = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    beat = mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 3, 3)
    for _ in range(50):
        look.step()
    look.preflight.receive(LINK, beat.pack(other), look.now_s)
    while not look.preflight.done:
        look.step()
    reported = [item for item in look.preflight.findings() if item.subject == "autopilot"]
    assert [item.level for item in reported] == [OK, NO_GO]
    assert "px4 with system id 1" in reported[0].text
    assert "ardupilot with system id 7" in reported[1].text


def test_an_autopilot_that_is_not_that_of_the_vehicle_file_is_a_finding():
    vehicle = replace(VEHICLE, autopilot=ARDUPILOT)
    finding = Look(vehicle=vehicle).findings()["autopilot"]
    assert (finding.level, "the vehicle file names ardupilot" in finding.text) == (NO_GO, True)


def upload(look, corners_m):
    """A polygon to stay in, by its corners (x, y) in the site's frame."""
    places = [SITE.frame.to_geodetic((x, y, 0.0)) for x, y in corners_m]
    look.autopilot.manner.areas.items = tuple(
        Item(
            command=5001,
            value=len(places),
            latitude_deg=place.latitude_deg,
            longitude_deg=place.longitude_deg,
        )
        for place in places
    )


def test_a_fence_that_does_not_limit_the_flight_is_reported():
    found = Look(parameters={"GF_MAX_HOR_DIST": 100.0, "GF_ACTION": 2}).findings()
    assert found["fence"].level is OK
    assert found["fence"].text == "the whole site and its landing points are inside"


def test_a_missing_fence_is_reported():
    assert Look().findings()["fence"].text == "none"


@pytest.mark.uncounted
@pytest.mark.parametrize(
    ("autopilot", "parameters", "name"),
    [
        ("px4", {"GF_MAX_HOR_DIST": 10.0}, "GF_MAX_HOR_DIST 10 m"),
        (
            "ardupilot",
            {"FENCE_ENABLE": 1, "FENCE_RADIUS": 11.0, "FENCE_TYPE": 2},
            "FENCE_RADIUS 11 m",
        ),
    ],
)
def test_targets_and_landing_points_outside_the_fence_are_a_no_go(autopilot, parameters, name):
    age_s = 60.0 if autopilot == "ardupilot" else 10.0
    vehicle = replace(VEHICLE, autopilot=None)
    look = Look(autopilot=autopilot, age_s=age_s, vehicle=vehicle, parameters=parameters)
    found = look.findings()
    outside = {subject for subject, item in found.items() if name in item.text} - {"fence"}
    assert {found[subject].level for subject in outside} == {NO_GO}
    assert {"target splice-inner", "landing exit 0", "landing evacuation 0"} <= outside
    assert "target splice-outer" not in outside


def test_px4s_action_on_a_landing_ordered_outside_the_fence_is_reported():
    look = Look(parameters={"GF_MAX_HOR_DIST": 10.0, "GF_ACTION": 2})
    while not look.preflight.done:
        look.step()
    texts = [item.text for item in look.preflight.findings() if item.subject == "fence"]
    assert "replace a LAND that is ordered there by that hold" in texts[0]


def test_an_uploaded_polygon_is_checked():
    look = Look()
    upload(look, [(15, -20), (35, -20), (35, 20), (15, 20)])
    found = look.findings()
    assert "outside inclusion polygon 1" in found["target splice-inner"].text
    assert found["landing exit 0"].level is NO_GO


def test_an_uploaded_fence_that_is_not_received_is_a_warning():
    look = Look()
    look.deaf_to_fences = True
    assert look.findings()["uploaded fence"].level is WARNING


def test_a_site_in_another_country_is_a_no_go():
    found = Look(latitude_deg=47.397742, longitude_deg=8.545594).findings()
    assert found["position"].level is NO_GO
    assert "km NE of the site 315 kV double circuit" in found["position"].text
    assert found["position"].text.startswith("5,8")
    assert "height" not in found


@pytest.mark.parametrize(
    ("at_m", "words"),
    [
        ((27.0, 12.0, 0.0), " m N of plane > 2; hover in the plane"),
        ((27.0, 400.0, 0.0), "400 m N of the workspace; beyond 60 m (guidance.recovery_m)"),
        ((330.0, -0.1, 0.0), "300 m E of the workspace; beyond 60 m (guidance.recovery_m)"),
        ((-80.0, -60.0, 0.0), "100 m SW of the workspace; beyond 60 m (guidance.recovery_m)"),
    ],
)
def test_a_take_off_place_elsewhere_is_a_warning_with_distance_and_direction(at_m, words):
    finding = Look(at_m=at_m).findings()["position"]
    assert finding.level is WARNING
    assert words in finding.explanation


def test_a_take_off_place_is_shown_with_its_side_of_the_plane():
    finding = Look(at_m=(27.0, -1.5, 0.0)).findings()["position"]
    assert finding.level is OK
    assert finding.text.endswith(" m S of the plane")


def test_a_take_off_place_kilometres_from_the_plane_is_another_site():
    finding = Look(at_m=(27.0, 3000.0, 0.0)).findings()["position"]
    assert finding.level is NO_GO
    assert "load the right site file" in finding.remedy


@pytest.mark.parametrize(
    ("height_m", "level", "words"),
    [
        (2.5, WARNING, "m too low"),
        pytest.param(4.0, NO_GO, "m too low", marks=pytest.mark.slow),
        (20.0, NO_GO, "m too low"),
        (-1.5, NO_GO, "m too high"),
        pytest.param(-4.0, NO_GO, "m too high", marks=pytest.mark.slow),
    ],
)
def test_an_altitude_that_differs_from_the_site_is_reported(height_m, level, words):
    """Keep-outs are 0.9 m, and the landing points are at 2.5 m."""
    finding = Look(at_m=(27.0, 0.0, height_m)).findings()["height"]
    assert finding.level is level
    assert f"z = {'+' if height_m > 0 else '-'}" in finding.text
    assert words in finding.remedy
    assert ("within -1.0 to +3.5 m" in finding.text) is (level is NO_GO)


@pytest.mark.uncounted
def test_ground_is_where_the_site_has_a_landing_point():
    hill = replace(SITE, landing_m={Mission.EXIT: ((40.0, 18.0),), Mission.EVACUATION: ()})
    at_m = (27.0, 0.0, 16.0)
    assert Look(site=hill, at_m=at_m).findings()["height"].level is WARNING
    finding = Look(site=hill, at_m=(27.0, 0.0, 22.0)).findings()["height"]
    assert finding.level is NO_GO
    assert "to +19.0 m" in finding.text


def test_without_a_site_there_is_no_place_to_judge():
    found = Look(site=None).findings()
    assert {"position", "companion failure"}.isdisjoint(found)
    assert found["LOCAL_POSITION_NED"].level is OK


def test_an_autopilot_that_has_just_started_is_not_ready():
    look = Look(age_s=0.5)
    look.autopilot.conditions.satellites = 3
    found = look.findings()
    assert found["ready to arm"].level is NO_GO
    assert found["localization risk"].level is NO_GO
    assert found["position"].level >= WARNING


def test_few_satellites_are_a_warning():
    look = Look()
    look.autopilot.conditions.satellites = 7
    finding = look.findings()["localization risk"]
    assert finding.level is WARNING
    assert "satellites 7" in finding.text


def test_a_battery_that_is_nearly_empty_is_a_no_go():
    look = Look()
    look.autopilot.conditions.battery_percent = 10.0
    assert look.findings()["battery risk"].level is NO_GO


def test_the_capacity_and_the_powers_of_the_vehicle_file_count():
    power = replace(VEHICLE.power, hover_w=1000.0, capacity_wh=20.0)  # 72 s of hovering
    finding = Look(site=None, vehicle=replace(VEHICLE, power=power)).findings()["battery risk"]
    assert finding.level is WARNING
    assert "battery 0 flight time left at home 71." in finding.text


def test_a_condition_that_makes_the_service_refuse_an_inspection_is_a_no_go():
    remaining = replace(VEHICLE.risk.battery_remaining, low=0.5, high=0.05)
    risk = replace(VEHICLE.risk, cells=None, battery_remaining=remaining)
    look = Look(site=None, vehicle=replace(VEHICLE, risk=risk))
    look.autopilot.conditions.battery_percent = 18.0
    found = look.findings()
    assert found["battery risk"].level is WARNING
    assert found["battery reserve"].level is NO_GO
    assert "<= 20%: no inspection starts" in found["battery reserve"].text


@pytest.mark.uncounted
@pytest.mark.parametrize("cells", [3, 6])
def test_an_impossible_number_of_cells_is_a_no_go(cells):
    vehicle = replace(VEHICLE, risk=replace(VEHICLE.risk, cells=cells))
    finding = Look(vehicle=vehicle).findings()["battery 0"]
    assert finding.level is NO_GO
    assert f"with {cells} cells, which is impossible" in finding.text


def test_a_full_battery_of_fewer_cells_than_the_vehicle_file_has_is_not_to_be_charged():
    look = Look(autopilot="ardupilot", age_s=60.0, vehicle=replace(VEHICLE, autopilot=None))
    found = look.findings()
    assert found["battery 0"].level is WARNING
    assert found["battery risk"].level is NO_GO
    for name in ("battery 0", "battery risk"):
        assert found[name].remedy.startswith("risk.cells or the charge is wrong: ")


def test_a_link_that_loses_packets_is_a_warning():
    look = Look()
    look.autopilot.conditions.link_loss_percent = 25.0
    found = look.findings()
    assert found["communication risk"].level is WARNING
    assert "% of packets" in found["communication risk"].text
    # Each parameter is requested again until it is received.
    assert "unknown" not in found["COM_OBL_RC_ACT"].text
    assert "unread" not in found["companion failure"].text


@pytest.mark.uncounted
@pytest.mark.parametrize(
    ("name", "level"),
    [("COM_OBL_RC_ACT", NO_GO), ("GF_ACTION", NO_GO), ("COM_RC_OVERRIDE", WARNING)],
)
def test_a_parameter_that_decides_and_is_lost_on_the_link_is_a_no_go(name, level):
    look = Look(parameters=PX4_AS_ASKED)
    look.lost = {name}
    finding = look.findings()[name]
    assert (finding.level, finding.text.startswith("unknown")) == (level, True)


def test_a_pause_of_the_link_longer_than_the_position_timeout_is_a_no_go():
    look = Look()
    for _ in range(100):
        look.step()
    look.connected = False
    for _ in range(40):
        look.step()
    look.connected = True
    finding = look.findings()["LOCAL_POSITION_NED"]
    assert finding.level is NO_GO
    assert "longest pause 0.8" in finding.text


def test_an_autopilot_that_falls_silent_during_the_check_is_reported():
    look = Look(site=None)
    for _ in range(150):
        look.step()
    look.connected = False
    found = look.findings()
    assert found["LOCAL_POSITION_NED"].level is NO_GO
    assert found["ATTITUDE"].level is NO_GO


def test_a_missing_autopilot_is_not_reported_for_an_operators_link():
    links = (LinkConfig(url=LINK), LinkConfig(url="udp::14550", role=LinkRole.OPERATOR))
    preflight = Preflight(CompanionConfig(vehicle=CONFIGS, links=links), VEHICLE, PLANNER)
    preflight.tick(0.0)
    preflight.tick(WAIT_S)
    assert preflight.done
    (finding,) = preflight.findings()
    assert "14550" not in finding.text


def signed_look(secret):
    """At an autopilot that signs with a key, or not at all."""
    signed = secret and SignOptions(key=secret)
    links = tuple(replace(link, signing=signed) for link in DEFAULT_LINKS)
    return Look(signing=Signing(key=SigningKey(SECRET), wall_s=0.0), links=links)


def test_an_autopilot_on_a_signed_link_is_checked():
    found = signed_look(SECRET).findings()
    assert found["firmware"].text == "PX4 1.17.0"
    assert "signing" not in found


def test_an_autopilot_whose_time_stamps_stay_behind_is_named():
    config = CompanionConfig(vehicle=CONFIGS, links=(LinkConfig(url=LINK, signed=True),))
    signing = Signing(key=SigningKey(SECRET), wall_s=1_420_070_400 + 6000.0)
    preflight = Preflight(config, VEHICLE, PLANNER, signing=signing)
    preflight.receive(LINK, SignedPeer(1, 1, timestamp=98 * MINUTE).heartbeat(), 0.0)
    preflight.tick(0.0)
    preflight.tick(WAIT_S)
    texts = [item.text for item in preflight.findings() if item.subject == "signing"]
    assert f"{LINK}: system 1 signs 120 s behind, refused" in texts


@pytest.mark.parametrize(
    ("secret", "reason", "remedy"),
    [
        (None, "unsigned", "the key"),
        (OTHER_SECRET, "wrong signature", "the key of `signing`"),
    ],
)
def test_an_autopilot_that_does_not_sign_as_configured_is_reported(secret, reason, remedy):
    found = signed_look(secret).findings()
    assert found["autopilot"].level is NO_GO
    assert found["signing"].text.startswith(f"{LINK}: ")
    assert found["signing"].text.endswith(f" packets refused, {reason}")
    assert remedy in found["signing"].remedy
