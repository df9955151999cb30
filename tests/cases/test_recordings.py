"""Recordings of old firmware, and those that tell nothing, replayed by the command line."""

from __future__ import annotations

import json
import struct

import pytest
from mcap.writer import Writer

from moar_companion.analysis.replay.dataflash_listener import MESSAGES, DataflashListener
from moar_companion.commands import cli
from moar_companion.mavlink.dataflash import rows
from moar_companion.service.recording.schemas import CALLS
from tests.cases.dataflash import DataflashLog
from tests.mavlink.peer import Peer

GPS_32 = ("BIHBcLLeeEefI", "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T")
COPTER_32 = {
    "PARM": ("Nf", "Name,Value"),
    "MSG": ("Z", "Message"),
    "MODE": ("Mh", "Mode,ThrCrs"),
    "EV": ("B", "Id"),
    "GPS": GPS_32,
    "ATT": ("IccccCC", "TimeMS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
    "CURR": ("IhIhhhf", "TimeMS,ThrOut,ThrInt,Volt,Curr,Vcc,CurrTot"),
    "EKF1": ("IccCffffffccc", "TimeMS,Roll,Pitch,Yaw,VN,VE,VD,PN,PE,PD,GX,GY,GZ"),
    "EKF2": ("Ibbbcchhhhhh", "TimeMS,Ratio,AZ1bias,AZ2bias,VWN,VWE,MN,ME,MD,MX,MY,MZ"),
    "EKF4": ("IcccccccbbBBH", "TimeMS,SV,SP,SH,SMX,SMY,SMZ,SVT,OFN,EFE,FS,TS,SS"),
    "RCOU": ("Ihhhhhhhhhhhh", "TimeMS,Ch1,Ch2,Ch3,Ch4,Ch5,Ch6,Ch7,Ch8,Ch9,Ch10,Ch11,Ch12"),
    "RAD": ("IBBBBBHH", "TimeMS,RSSI,RemRSSI,TxBuf,Noise,RemNoise,RxErrors,Fixed"),
}
"""Layouts of ArduCopter 3.2 (libraries/DataFlash/DataFlash.h, ArduCopter/Log.pde)."""
CURRENTS = {
    "3.3": (("QhhhHfh", "TimeUS,Throttle,Volt,Curr,Vcc,CurrTot,Volt2"), (500, 1560, 1200, 5000)),
    "3.4": (("Qfff", "TimeUS,Volt,Curr,CurrTot"), (15.6, 12.0)),
    "3.6": (("Qfffffcf", "TimeUS,Volt,VoltR,Curr,CurrTot,EnrgTot,Temp,Res"), (15.6, 16.0, 12.0)),
}
"""Layouts of CURR by release, with the stored values of 15.6 V and 12 A."""


@pytest.fixture
def replay(capsys):
    """The JSON of a recording, which must be read without a word on stderr."""

    def run(path):
        assert cli.main(["replay", str(path), "--json", "-"]) == 0
        out, err = capsys.readouterr()
        assert err == ""
        return json.loads(out)

    return run


@pytest.fixture
def refused(capsys):
    """The one line with which a recording is refused."""

    def run(path):
        status = cli.main(["replay", str(path)])
        out, err = capsys.readouterr()
        assert (status, out, err.count("\n")) == (2, "", 1)
        return err

    return run


def copter_32(path, *, gps=GPS_32):
    """A minute of ArduCopter 3.2 in LOITER: times in milliseconds, of some messages none."""
    log = DataflashLog(COPTER_32 | {"GPS": gps})
    log.put("PARM", b"BATT_CAPACITY", 5000.0)
    log.put("MSG", b"ArduCopter V3.2.1 (36b405fb)")
    log.put("MSG", b"Frame: HEXA")
    log.put("MODE", 5, 450)
    log.put("EV", 10)
    for tenth in range(600):
        ms = 90_000 + 100 * tenth
        log.put("ATT", ms, 0, 100 + tenth % 3, 0, -50, 0, 9_000)
        log.put("RCOU", ms, *[1500] * 6, *[0] * 6)
        log.put("EKF1", ms, 0, 0, 0, 0.1, 0.2, 0.3, 1.0, 2.0, -20.0, 0, 0, 0)
        if tenth % 10 == 0:
            log.put("EKF2", ms, 0, 0, 0, 300, -400, 0, 0, 0, 0, 0, 0)
            log.put("EKF4", ms, 10, 20, 30, 30, 40, 0, 0, 0, 0, 0, 0, 0x3F)
            log.put("CURR", ms, 500, 0, 1560, 1200, 5000, 2000.0 + tenth)
            log.put("RAD", ms, 200, 190, 100, 40, 50, 0, 0)
            stored = [3, 302_400_000 + 100 * tenth, 1850, 14, 90, 453_781_000, -719_295_000]
            stored += [2_000, 22_000, 10, 0, 0.1, ms]
            log.put("GPS", *stored[: len(gps[0])])
    log.put("MODE", 9, 450)
    return log.save(path)


@pytest.mark.parametrize(
    ("gps", "tolerance_s"),
    [(GPS_32, 1e-3), ((GPS_32[0][:-2], GPS_32[1].removesuffix(",VZ,T")), 2.0)],
    ids=["of 3.2", "dated by GPS alone"],
)
def test_a_log_with_milliseconds_is_a_whole_flight(replay, tmp_path, gps, tolerance_s):
    answer = replay(copter_32(tmp_path / "32.bin", gps=gps))
    assert (answer["autopilot"], answer["vehicle_type"]) == ("ardupilot", "hexarotor")
    assert answer["duration_s"] == pytest.approx(59.9, abs=tolerance_s)
    texts = [(event["time_s"], event["text"]) for event in answer["events"]]
    assert {(0.0, "LOITER"), (0.0, "armed"), (0.0, "3D fix")} <= set(texts)
    assert (answer["duration_s"], "LAND") in texts
    assert not any("clock" in text for _, text in texts)
    read = {name for name, item in answer["inputs"].items() if item["messages"]}
    assert {"attitude", "battery", "estimator", "gps", "local_position", "motors"} <= read
    risks = answer["samples"][-1]["risk"]
    assert all(value is not None for value in risks.values())


def test_a_log_of_3_1_has_the_times_of_its_receiver(replay, tmp_path):
    log = DataflashLog(
        {
            "MODE": ("Mh", "Mode,ThrCrs"),
            "GPS": GPS_32,
            "ATT": ("cccccCC", "RollIn,Roll,PitchIn,Pitch,YawIn,Yaw,NavYaw"),
            "CURR": ("hIhhhf", "ThrOut,ThrInt,Volt,Curr,Vcc,CurrTot"),
            "MOT": ("hhhh", "Mot1,Mot2,Mot3,Mot4"),
        }
    )
    log.put("MODE", 0, 352)
    for step in range(50):
        week_ms, boot_ms = 109_214_200 + 200 * step, 67_138 + 200 * step
        place = [-394_950_310, 1_767_483_504, 4, 4_682]
        log.put("GPS", 3, week_ms, 1774, 9, 242, *place, 6, 20_277, 0.14, boot_ms)
        log.put("ATT", 0, -49, 0, -476, 0, 35_892, 35_892)
        log.put("MOT", 994, 994, 994, 994)
        log.put("CURR", 0, 0, 1691, 0, 4962, 0.0)
    answer = replay(log.save(tmp_path / "31.bin"))
    assert answer["duration_s"] == pytest.approx(9.8)
    read = {name: item["messages"] for name, item in answer["inputs"].items() if item["messages"]}
    assert read == {"autopilot": 1, "attitude": 50, "battery": 50, "gps": 50, "motors": 50}


@pytest.mark.parametrize("release", CURRENTS)
def test_the_battery_of_each_release_is_in_volts_amperes_and_percent(tmp_path, release):
    layout, stored = CURRENTS[release]
    columns = layout[1].split(",")
    log = DataflashLog({"PARM": ("QNf", "TimeUS,Name,Value"), "CURR": layout})
    log.put("PARM", 1_000_000, b"BATT_CAPACITY", 5000.0)
    values = [2_000_000, *stored, 1500.0]
    log.put("CURR", *values, *[0] * (len(columns) - len(values)))
    battery = _batteries(log.save(tmp_path / "curr.bin"))[0]
    assert (battery.voltage_v, battery.current_a) == pytest.approx((15.6, 12.0))
    assert battery.remaining == pytest.approx(0.7)


def test_without_a_capacity_or_a_measured_current_the_charge_is_unknown(tmp_path):
    log = DataflashLog({"PARM": ("QNf", "TimeUS,Name,Value"), "CUR2": CURRENTS["3.4"][0]})
    log.put("CUR2", 2_000_000, 15.6, 12.0, 1500.0)
    assert _batteries(log.save(tmp_path / "a.bin"))[1].remaining is None
    log.put("PARM", 1_000_000, b"BATT2_CAPACITY", 5000.0)
    log.put("CUR2", 2_000_000, 15.6, 0.0, 0.0)
    assert _batteries(log.save(tmp_path / "b.bin"))[1].remaining is None


def _batteries(path):
    listener = DataflashListener()
    for time_s, row in rows(str(path), MESSAGES):
        listener.handle(row, time_s)
    return listener.telemetry.batteries


# Recordings that tell nothing


def tlog(path):
    """A ground station alone, which repeats its heartbeat."""
    heartbeat = Peer(system_id=255, component_id=190).ground_heartbeat()
    path.write_bytes(
        b"".join(struct.pack(">Q", 10**15 + 10**6 * second) + heartbeat for second in range(9))
    )
    return path


def dataflash(path):
    log = DataflashLog({"IMU": ("Qf", "TimeUS,GyrX"), "VIBE": ("Qf", "TimeUS,VibeX")})
    for second in range(9):
        log.put("IMU", 10**6 * second, 0.1)
        log.put("VIBE", 10**6 * second, 0.1)
    return log.save(path)


def ulog(path, *messages, formats=()):
    """A ULog with a topic that is not read, and these formats and messages: kind and content."""
    content = [
        ("F", b"sensor_baro:uint64_t timestamp;float pressure;"),
        *(("F", item) for item in formats),
        ("A", struct.pack("<BH", 0, 0) + b"sensor_baro"),
        *(("D", struct.pack("<HQf", 0, 10**6 * second, 1e5)) for second in range(9)),
        *messages,
    ]
    packed = (struct.pack("<HB", len(body), ord(kind)) + body for kind, body in content)
    path.write_bytes(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 10**6) + b"".join(packed))
    return path


def mcap(path):
    """The service without an autopilot."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(name="Calls", encoding="jsonschema", data=b"{}")
        channel = writer.register_channel(topic=CALLS, message_encoding="json", schema_id=schema)
        for second in range(9):
            stamp_ns = 10**9 * second
            writer.add_message(channel, stamp_ns, b'{"calls": []}', stamp_ns)
        writer.finish()
    return path


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (tlog, "no heartbeat of an autopilot in 9 packets"),
        (mcap, "no heartbeat of an autopilot in 0 packets"),
        (dataflash, "no message that is read, only FMT, IMU, VIBE"),
        (ulog, "no topic that is read, only sensor_baro"),
    ],
)
def test_a_recording_that_tells_nothing_of_an_aircraft_is_refused(refused, tmp_path, make, reason):
    path = make(tmp_path / f"nothing.{make.__name__}")
    assert refused(path) == f"moar-companion: {path}: tells nothing of an aircraft: {reason}\n"


# Texts


ESCAPES = b"\x1b[2J\x1b]0;owned\x07a text"


def texts_of_a_ulog(path):
    return ulog(
        path,
        ("A", struct.pack("<BH", 0, 1) + b"vehicle_status"),
        ("D", struct.pack("<HQB", 1, 10**6, 2)),
        ("L", struct.pack("<BQ", ord("4"), 2 * 10**6) + ESCAPES),
        formats=[b"vehicle_status:uint64_t timestamp;uint8_t nav_state;"],
    )


def texts_of_a_dataflash_log(path):
    log = DataflashLog({"MODE": ("QB", "TimeUS,ModeNum"), "MSG": ("QZ", "TimeUS,Message")})
    log.put("MODE", 10**6, 4)
    log.put("MSG", 10**6, ESCAPES)
    return log.save(path)


@pytest.mark.parametrize("make", [texts_of_a_ulog, texts_of_a_dataflash_log])
def test_escape_codes_in_a_recordings_texts_do_not_reach_the_terminal(capsys, tmp_path, make):
    path = make(tmp_path / "a\x1b[31m.log")
    assert cli.main(["replay", str(path)]) == 0
    out, _ = capsys.readouterr()
    assert "[2J ]0;owned a text" in out
    assert all(line.isprintable() for line in out.splitlines())
