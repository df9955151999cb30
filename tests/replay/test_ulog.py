"""PX4's onboard logs, read as the telemetry that the companion receives."""

from __future__ import annotations

import math

import pytest

from moar_companion.analysis.replay.ulog import UlogListener, samples
from moar_companion.analysis.replay.ulog_topics import UlogTopic
from moar_companion.commands.replay import played
from moar_companion.mavlink.telemetry import LandedState, Telemetry
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.vehicle import Vehicle
from tests.mavlink.conftest import SHARED
from tests.mavlink.messages import updated

NAN = math.nan
STATUS = {"nav_state": 14, "arming_state": 2, "failsafe": 0, "system_type": 2, "system_id": 1}


def received(*rows):
    """The telemetry after rows of topics: name and instance, and the fields."""
    listener = UlogListener()
    for number, (name, fields) in enumerate(rows, start=1):
        topic, _, instance = name.partition(":")
        columns = {key: [value] for key, value in ({"timestamp": number * 10**6} | fields).items()}
        one = UlogTopic(name=topic, instance=int(instance or 0), columns=columns)
        for time_s, sample in samples([one], [], 0):
            listener.handle(sample, time_s)
    return listener


def telemetry(name, **fields):
    return received((name, fields)).telemetry


def test_the_status_is_the_heartbeat_of_the_same_mode():
    listener = received(("vehicle_status", STATUS | {"component_id": 1}))
    status = listener.telemetry.autopilot
    assert (status.mode, status.armed, status.ours, status.failsafe) == (
        "OFFBOARD",
        True,
        True,
        False,
    )
    assert (listener.vehicle_type, listener.leans, status.motors) == ("quadrotor", True, 4)


@pytest.mark.parametrize(
    ("nav_state", "mode"),
    [(0, "MANUAL"), (2, "POSCTL"), (4, "HOLD"), (5, "RTL"), (12, "LAND"), (18, "LAND")],
)
def test_the_modes_have_the_names_of_mavlink(nav_state, mode):
    status = telemetry("vehicle_status", **(STATUS | {"nav_state": nav_state})).autopilot
    assert (status.mode, status.ours) == (mode, False)


def test_a_plane_does_not_lean_against_the_wind():
    assert not received(("vehicle_status", STATUS | {"system_type": 1})).leans


def test_the_attitude_is_that_of_the_quaternion():
    half = math.radians(10.0)
    pitched = telemetry(
        "vehicle_attitude", **{"q[0]": math.cos(half), "q[1]": 0, "q[2]": math.sin(half), "q[3]": 0}
    ).attitude
    assert (pitched.roll_rad, pitched.pitch_rad, pitched.yaw_rad) == pytest.approx(
        (0.0, math.radians(20.0), 0.0)
    )


POSITION = {
    "x": 1.0,
    "y": 2.0,
    "z": -3.0,
    "vx": 0.1,
    "vy": 0.2,
    "vz": 0.3,
    **dict.fromkeys(("xy_valid", "z_valid", "v_xy_valid", "v_z_valid"), 1),
}


def test_a_position_counts_where_the_estimator_calls_it_valid():
    local = telemetry("vehicle_local_position", **POSITION).local_position
    assert (local.position_ned_m, local.velocity_ned_mps) == ((1, 2, -3), (0.1, 0.2, 0.3))
    for flag in ("xy_valid", "z_valid", "v_xy_valid", "v_z_valid"):
        assert telemetry("vehicle_local_position", **(POSITION | {flag: 0})) == Telemetry()
    assert telemetry("vehicle_local_position", **(POSITION | {"x": NAN})) == Telemetry()


def test_the_origin_is_used_once_it_is_global():
    reference = {"ref_lat": 45.0, "ref_lon": -72.0, "ref_alt": 200.0, "xy_global": 1, "z_global": 1}
    origin = telemetry("vehicle_local_position", **POSITION, **reference).local_origin
    assert (origin.point.latitude_deg, origin.point.altitude_amsl_m) == (45.0, 200.0)
    reference["xy_global"] = 0
    assert telemetry("vehicle_local_position", **POSITION, **reference).local_origin is None


BATTERY = {"connected": 1, "remaining": 0.7, "voltage_v": 15.2, "current_a": 12.0, "warning": 1}


def test_each_battery_has_its_warning_in_mavlinks_numbers():
    both = received(
        ("battery_status", BATTERY), ("battery_status:1", BATTERY | {"remaining": -1, "warning": 0})
    ).telemetry.batteries
    assert (both[0].remaining, both[0].charge_state) == (0.7, 2)
    assert (both[1].remaining, both[1].charge_state) == (None, 1)


@pytest.mark.parametrize(
    ("warning", "charge_state"),
    [
        pytest.param(0, 1, id="none"),
        pytest.param(3, 4, id="emergency"),
        pytest.param(4, 5, id="failed"),
        pytest.param(5, None, id="undefined"),
        pytest.param(6, 6, id="unhealthy"),
        pytest.param(7, 7, id="charging"),
    ],
)
def test_a_logged_warning_is_the_charge_state_that_px4_sends(warning, charge_state):
    read = telemetry("battery_status", **(BATTERY | {"warning": warning})).batteries[0]
    assert read.charge_state == charge_state


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("battery_status", BATTERY | {"connected": 0}),
        ("wind", {"windspeed_north": 0.0, "windspeed_east": 0.0, "variance_north": 0.0}),
        ("wind", {"windspeed_north": NAN, "windspeed_east": 1.0, "variance_north": 1.0}),
        ("home_position", {"lat": 0.0, "lon": 0.0, "alt": 0.0, "x": 0.0, "y": 0.0, "z": 0.0}),
        ("vehicle_magnetometer", {f"magnetometer_ga[{axis}]": 0.0 for axis in range(3)}),
        ("telemetry_status", {"heartbeat_type_gcs": 0}),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_logged_unknown_value_is_unknown(name, fields):
    assert telemetry(name, **fields) == Telemetry()


def test_the_wind_direction_is_that_of_the_log():
    wind = telemetry("wind", windspeed_north=3.0, windspeed_east=-4.0, variance_north=0.2).wind
    assert wind.velocity_ned_mps == (3.0, -4.0, 0.0)


@pytest.mark.parametrize(("north_mps", "variance_m2ps2"), [(0.0, 0.0), (7.0, 0.0), (7.0, NAN)])
def test_a_wind_without_a_variance_is_that_of_its_message(north_mps, variance_m2ps2):
    fields = {"windspeed_east": 0.0, "variance_east": variance_m2ps2}
    logged = telemetry(
        "wind", windspeed_north=north_mps, variance_north=variance_m2ps2, **fields
    ).wind
    expected = updated("WIND_COV", now_s=1.0, wind_x=north_mps, var_horiz=variance_m2ps2).wind
    assert logged == expected


def test_the_uncertainty_of_the_wind_is_that_of_its_message():
    wind = {"windspeed_north": 0.0, "windspeed_east": 0.0}
    logged = telemetry("wind", **wind, variance_north=4.0, variance_east=14.0).wind
    assert logged.deviation_mps == pytest.approx(3.0)
    expected = updated("WIND_COV", wind_x=0.0, wind_y=0.0, var_horiz=18.0).wind
    assert expected.deviation_mps == logged.deviation_mps


@pytest.mark.parametrize(
    "signals", [(255, 40, 0, 0), (200, 255, 90, 60), (90, 40, 255, 255), (90, 40, 0, 30)]
)
def test_a_radio_is_read_as_its_message(signals):
    rssi, noise, remote_rssi, remote_noise = signals
    logged = telemetry(
        "radio_status",
        rssi=rssi,
        noise=noise,
        remote_rssi=remote_rssi,
        remote_noise=remote_noise,
        rxerrors=3,
        txbuf=90,
    ).radio
    expected = updated(
        "RADIO_STATUS",
        now_s=logged.received_s,
        rssi=rssi,
        noise=noise,
        remrssi=remote_rssi,
        remnoise=remote_noise,
        rxerrors=3,
        txbuf=90,
    ).radio
    assert logged == expected


def test_of_several_estimators_the_selected_one_is_read():
    first, second = {"pos_horiz_accuracy": 0.3}, {"pos_horiz_accuracy": 4.0}
    both = [("estimator_status", first), ("estimator_status:1", second)]

    def accuracy_m(*rows):
        return received(*rows).telemetry.estimator.horizontal_accuracy_m

    assert accuracy_m(*both) == 0.3
    assert accuracy_m(("estimator_selector_status", {"primary_instance": 1}), *both) == 4.0
    assert accuracy_m(("estimator_selector_status", {"primary_instance": 255}), *both) == 0.3


def test_a_logged_accuracy_of_zero_is_unknown():
    gnss = telemetry("vehicle_gps_position", fix_type=3, satellites_used=14, eph=0.0, hdop=NAN).gnss
    assert (gnss.satellites, gnss.hdop, gnss.horizontal_accuracy_m) == (14, None, None)
    estimator = telemetry("estimator_status", solution_status_flags=0x10, mag_test_ratio=0.0)
    assert (estimator.estimator.horizontal_position_ok, estimator.estimator.compass_innovation) == (
        True,
        None,
    )


def test_a_signal_strength_of_zero_from_the_start_is_unknown():
    assert telemetry("input_rc", rssi=0).remote_control.rssi is None
    lost = received(("input_rc", {"rssi": 80}), ("input_rc", {"rssi": 0})).telemetry
    assert lost.remote_control.rssi == 0.0
    assert telemetry("input_rc", rssi=-1).remote_control.rssi is None


def test_ground_stations_are_received_by_a_flag_or_by_the_times_of_their_heartbeats():
    flag = telemetry("telemetry_status", heartbeat_type_gcs=1)
    assert flag.ground_station.received_s == 1.0
    slots = {"heartbeats[1].type": 6, "heartbeats[1].timestamp": 4 * 10**5}
    assert telemetry("telemetry_status", **slots).ground_station.received_s == pytest.approx(0.4)


def test_outputs_that_idle_are_not_in_use():
    outputs = {f"output[{n}]": value for n, value in enumerate((1500, 1600, 900, 0))}
    motors = telemetry("actuator_outputs", noutputs=4, **outputs).motors
    assert motors.pulse_us == (1500, 1600)


def test_on_ground_and_in_air_are_reported():
    assert telemetry("vehicle_land_detected", landed=1).landed.state is LandedState.ON_GROUND
    assert telemetry("vehicle_land_detected", landed=0).landed.state is LandedState.IN_AIR


def test_samples_are_in_order_and_none_is_before_the_start_of_the_log():
    topics = [
        UlogTopic(name="vehicle_land_detected", instance=0, columns={"timestamp": [5, 30]}),
        UlogTopic(name="vehicle_attitude", instance=0, columns={"timestamp": [10, 20, 40]}),
        UlogTopic(name="cpuload", instance=0, columns={"timestamp": [15]}),
    ]
    read = list(samples(topics, [(25, 4, "a warning"), (7, 99, "nonsense")], 12))
    assert [round(time_s * 1e6) for time_s, _ in read] == [12, 12, 12, 20, 25, 30, 40]
    texts = [(sample.text.severity, sample.text.text) for _, sample in read if sample.text]
    assert texts == [("debug", "nonsense"), ("warning", "a warning")]


LOGS = sorted((SHARED / "data" / "px4_ulog").glob("*.ulg"))


@pytest.mark.recordings
@pytest.mark.skipif(not LOGS, reason="no recordings beside the checkout")
def test_two_batteries_and_a_vtol_on_the_ground_that_has_no_position():
    pytest.importorskip("pyulog")
    vehicle = Vehicle.load(shipped_configs() / "vehicles" / "linedrone.yaml")
    replay = played(str(LOGS[1]), vehicle)
    assert (replay.autopilot, replay.duration_s) == ("px4", pytest.approx(6.5, abs=0.1))
    assert replay.inputs["gps"][0] == 32
    last = replay.samples[-1]
    assert last.why["localization"] == "estimator without position"
    assert last.risk["wind"] is None
    assert {"battery 0 remaining", "battery 1 remaining"} <= set(replay.measures["battery"])
    events = [(event.kind, event.text) for event in replay.events]
    assert ("text", "autopilot info: [commander] Takeoff detected") in events
    assert ("armed", "disarmed") in events


@pytest.mark.recordings
@pytest.mark.skipif(not LOGS, reason="no recordings beside the checkout")
def test_a_log_on_the_bench_has_few_values():
    pytest.importorskip("pyulog")
    vehicle = Vehicle.load(shipped_configs() / "vehicles" / "linedrone.yaml")
    replay = played(str(LOGS[0]), vehicle)
    unknown = {name for name, value in replay.samples[-1].risk.items() if value is None}
    assert unknown == {"wind", "communication", "battery"}
