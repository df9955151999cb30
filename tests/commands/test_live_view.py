"""The live view of a status: its content and its size."""

import copy
import io
import json

import pytest
from rich.console import Console

from moar_companion.commands.live_view import LiveView, line_of, silence_of
from moar_companion.risk import InputReport

from ..mqtt.statuses import flying, status_of


def index(value, *, known=True, worst=None, inputs=()):
    return {"value": value, "known": known, "worst": worst, "inputs": list(inputs)}


def measured(name, value, unit="", risk=0.2, age_s=0.1):
    item = InputReport(name=name, value=value, unit=unit, age_s=age_s, risk=risk)
    return item._asdict() | {"reading": item.reading}


UNHEARD = measured("radio margin here", None, risk=None, age_s=None)
FLYING = {
    "time_s": 1795274219.2,
    "autopilot": {
        "kind": "px4",
        "system_id": 7,
        "mode": "OFFBOARD",
        "ours": True,
        "armed": True,
        "failsafe": False,
        "age_s": 0.4,
    },
    "mission": {
        "state": "flying",
        "for_s": 75.2,
        "mission": "inspection",
        "goal": "splice-inner",
        "text": "MOAR: flying inspection",
        "text_age_s": 3.2,
    },
    "aircraft": {
        "landed": "in_air",
        "position_m": [12.345, -0.001, 8.5],
        "position_ned_m": [1.5, -3.25, -8.5],
        "velocity_mps": [1.0, 0.0, 0.0],
        "speed_mps": 1.234,
        "yaw_rad": 0.1,
        "clearance_m": 2.345,
    },
    "path": {
        "setpoint": {"position_m": [12.5, 0.0, 8.5], "velocity_mps": [1, 0, 0], "yaw_rad": 0.1},
        "error_m": 0.155,
        "left_m": 8.34,
        "left_s": 12.6,
    },
    "risk": {
        "wind": index(0.84, worst="tilt", inputs=[measured("tilt", 0.3491, "rad", 0.84)]),
        "communication": index(0.5, known=False, inputs=[UNHEARD]),
        "localization": index(
            0.1, worst="satellites", inputs=[measured("satellites", 10, "", 0.1, 4.0)]
        ),
        "battery": index(0.0, worst="cell", inputs=[measured("cell", 3.987, "V", 0.0)]),
    },
    "weights": {
        "base": {"safety": 0.4, "time": 0.5, "energy": 0.1},
        "adjusted": {"safety": 0.57, "time": 0.29, "energy": 0.14},
    },
    "plan": {
        "status": "found",
        "mission": "inspection",
        "target": "splice-inner",
        "cost": {"total": 4.312, "safety": 1.0, "time": 2.0, "energy": 1.3},
        "search_ms": 0.34,
        "age_s": 1.4,
        "reason": "wind risk 0.47 -> 0.58",
        "change": "path 1.4 m outward, 0.6 m on average",
        "paths": 5,
        "replans": 16,
    },
    "link": {"packets_received": 5000, "packets_lost": 3, "rate_hz": 212.4},
    "radio": None,
    "age_s": {
        "attitude": 0.01,
        "local_position": 0.03,
        "gnss": 0.2,
        "battery": 1.2,
        "radio": None,
        "ground_station": 0.6,
    },
    "recorder": "/var/lib/moar-companion/flights/flight_20261121T151539Z",
}
UNKNOWN = {
    "time_s": 1795274219.2,
    "autopilot": None,
    "mission": {"state": "idle"}
    | dict.fromkeys(("for_s", "mission", "goal", "text", "text_age_s")),
    "aircraft": dict.fromkeys(FLYING["aircraft"]),
    "path": None,
    "risk": {name: index(0.5, known=False, inputs=[UNHEARD]) for name in FLYING["risk"]},
    "weights": FLYING["weights"],
    "plan": None,
    "link": None,
    "radio": None,
    "age_s": dict.fromkeys(FLYING["age_s"]),
    "recorder": None,
}
SEEING = FLYING | {
    "gate": {
        "action": "held",
        "reason": "setpoint jumps by 0.3 m",
        "value": 0.3,
        "limit": 0.05,
        "unit": "m",
        "age_s": 12.3,
    },
    "refused": {"serial": {"unsigned": 3}},
    "parameters": {"RISK_H_ACCUR_R0": 1.25, "GUID_LAND_HEIGHT": 2.5, "WGT_EVAC_SAFETY": 0.875},
    "perception": {
        "conductors": [{}] * 6,
        "solids": 2,
        "refusal": None,
        "scan_age_s": 0.1,
        "returns": 0.42,
        "refused": 0,
        "late": 0,
        "line": {
            "age_s": 0.2,
            "offset_m": [1.21, -0.34],
            "covariance_m2": [0.01, 0.0, 0.02],
            "heading_offset_rad": -0.2,
            "wires": 5,
        },
    },
}
"""With a lidar, signed links and parameters that were set: the most rows."""


@pytest.fixture(scope="module")
def complete():
    """A status as the service makes it, with all inputs of the indices, and every optional row."""
    made = status_of(flying())
    return SEEING | {key: made[key] for key in ("risk", "age_s")}


def page(status, width=80, height=24, *, terminal=True, **named):
    console = Console(
        file=io.StringIO(),
        width=width,
        height=height,
        force_terminal=terminal,
        color_system=None,
        legacy_windows=False,
    )
    console.print(LiveView(status, **named))
    return console.file.getvalue()


def changed(status, section, **values):
    other = copy.deepcopy(status)
    other[section].update(values)
    return other


SIZES = [(80, 24), (80, 48), (80, 60), (120, 24), (120, 34), (140, 40), (250, 70)]


def assert_fits(status, width, height):
    lines = page(status, width, height, notes=["one", "two", "three"]).splitlines()
    assert max(map(len, lines)) <= width
    assert len(lines) <= height
    assert [line.strip() for line in lines[-3:]] == ["one", "two", "three"]


@pytest.mark.parametrize(("width", "height"), SIZES)
@pytest.mark.parametrize("status", [FLYING, UNKNOWN, SEEING], ids=["flying", "unknown", "seeing"])
def test_the_page_fits_its_terminal_with_three_notes(status, width, height):
    assert_fits(status, width, height)


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_the_page_with_all_inputs_fits_its_terminal_with_three_notes(complete, width, height):
    assert_fits(complete, width, height)


def test_a_taller_page_has_more_inputs_and_the_deciding_one_of_each_index_first(complete):
    indices = complete["risk"].values()
    names = [item["name"] for index in indices for item in index["inputs"]]

    def shown(height):
        text = page(complete, 80, height)
        return [name for name in names if f"  {name}  " in text]

    by_height = [shown(height) for height in (24, 48, 60, 70, 100)]
    counts = [len(each) for each in by_height]
    assert counts == sorted(counts)
    assert (counts[0], counts[-1]) == (0, len(names))
    assert 0 < counts[1] < counts[2] < counts[-1]
    for each in by_height[1:]:
        assert {index["worst"] for index in indices if index["worst"]} <= set(each)


def test_a_status_of_an_older_service_has_no_place_by_the_line():
    seen = {name: value for name, value in SEEING["perception"].items() if name != "line"}
    text = page(SEEING | {"perception": seen})
    assert "6 conductors" in text
    assert "known to" not in text


def test_the_important_values_are_on_the_smallest_page():
    text = page(FLYING)
    for words in (
        "px4, system 7   OFFBOARD, armed",
        "15:16:59 UTC",
        "flying inspection of splice-inner for 1 min 15 s",
        "MOAR: flying inspection   3.2 s ago",
        "1.23 m/s, in air   clearance 2.35 m",
        "x 12.35  y 0.00  z 8.50 m   NED 1.50  -3.25  -8.50 m",
        "x 12.50  y 0.00  z 8.50 m",
        "error 0.15 m   left 8.3 m, 13 s",
        "0.84   tilt 20.0°",
        "0.50   unknown",
        "0.10   satellites 10, 4.0 s ago",
        "0.00   cell 3.99 V",
        "safety 0.40→0.57  time 0.50→0.29  energy 0.10→0.14",
        "cost 4.31, 0.3 ms, 1.4 s ago; reason: wind risk 0.47 -> 0.58",
        "212 packets/s, 3 lost; ground station received 0.6 s ago",
        "radio         no data",
        "local position 0.0  attitude 0.0  gnss 0.2  battery 1.2",
        "flight_20261121T151539Z",
    ):
        assert words in text


def test_an_unknown_value_is_shown_as_unknown_and_never_as_a_number():
    text = page(UNKNOWN, 140, 40)
    assert "no autopilot is received" in text
    assert "clearance unknown" in text
    assert text.count("0.50   unknown") == 4
    assert "none yet" in text
    assert "radio         no data" in text
    assert "None" not in text
    assert "nan" not in text.lower().replace("companion", "")


@pytest.mark.parametrize(("width", "height"), [(140, 40), (80, 60)])
def test_where_there_is_room_every_input_is_shown_with_risk_value_and_age(width, height):
    lines = page(FLYING, width, height).splitlines()
    (tilt,) = [line for line in lines if "tilt" in line]
    assert tilt.split()[-6:] == ["0.84", "tilt", "20.0°", "0.1", "s", "ago"]
    (silent,) = [line for line in lines if "radio margin here" in line]
    assert silent.split()[-6:] == ["unknown", "radio", "margin", "here", "no", "data"]


def test_bars_are_as_long_as_the_indices():
    lines = {
        line.split()[0]: line for line in page(FLYING).splitlines() if "█" in line or "░" in line
    }
    assert lines["wind"].count("█") == 17
    assert lines["communication"].count("█") == 10
    assert lines["battery"].count("█") == 0
    assert {line.count("█") + line.count("░") for line in lines.values()} == {20}


def test_into_a_file_the_page_is_complete_plain_text():
    text = page(FLYING, terminal=False)
    assert "\x1b" not in text
    assert "radio margin here" in text


def test_a_failsafe_and_a_silent_autopilot_stand_out():
    text = page(changed(FLYING, "autopilot", failsafe=True, age_s=4.2))
    assert "FAILSAFE" in text
    assert "silent for 4 s" in text


@pytest.mark.parametrize("status", [FLYING, UNKNOWN], ids=["flying", "unknown"])
def test_a_silent_service_is_not_mistaken_for_one_that_flies(status):
    """Its mode is long past; the first line is seen in a terminal of any height."""
    assert "no word from the service" not in page(status, silent_s=1.0)
    head, *_ = page(status, silent_s=3.4).splitlines()
    assert head.split("   ")[:2] == ["moar-companion", "no data from the service for 3 s"]
    assert "OFFBOARD" not in head


def test_a_silent_service_is_reported_with_the_same_text_without_a_page():
    assert silence_of(1.9) is None
    assert silence_of(3.4) == "no data from the service for 3 s"


@pytest.mark.parametrize(("width", "height"), [(120, 24), (120, 40), (140, 24), (140, 40)])
def test_beside_the_rest_no_name_of_an_input_is_cut(width, height):
    names = ["ground station silence", "radio margin there", "estimator without position"]
    inputs = [measured(name, 12.3, "s") for name in names]
    risk = FLYING["risk"] | {
        "communication": index(0.3, worst=names[0], inputs=inputs),
        "localization": index(0.3, worst=names[2], inputs=inputs),
    }
    text = page(FLYING | {"risk": risk}, width, height)
    shown = names if height >= 40 else [names[0], names[2]]
    assert [name for name in shown if f"{name} " not in text] == []
    assert "-8.50 m" in text  # the left is wrapped


def test_a_radio_is_shown_with_its_unknowns():
    radio = {
        "kind": "sik",
        "rssi": 180,
        "remote_rssi": None,
        "noise": 40,
        "remote_noise": 35,
        "transmit_buffer_percent": 90,
        "age_s": 0.3,
    }
    text = page(FLYING | {"radio": radio})
    assert "sik: 180 over 40 here, unknown over 35 there" in text


def test_names_cannot_move_the_terminals_cursor():
    status = changed(FLYING, "mission", text="evil \x1b[2J\n\rname", goal="splice\x1b]0;x\x07")
    for text in (page(status), line_of(status)):
        assert "\x1b" not in text
        assert "\x07" not in text
    assert "\n" not in line_of(status)


def test_the_one_line_form_has_the_important_values():
    line = line_of(FLYING)
    for words in (
        "flying inspection of splice-inner",
        "OFFBOARD",
        "clearance 2.35 m",
        "8.3 m left",
    ):
        assert words in line
    assert "communication 0.50 (unknown)" in line
    assert "clearance unknown" in line_of(UNKNOWN)


def test_a_landing_point_is_a_goal_by_its_number():
    status = changed(FLYING, "mission", state="landing_leg", mission="exit", goal=0)
    assert "landing leg exit to landing point 0" in page(status)


def test_a_status_is_shown_the_same_after_json():
    assert page(json.loads(json.dumps(FLYING))) == page(FLYING)


@pytest.mark.parametrize(("width", "height"), [(80, 24), (120, 24), (140, 40)])
def test_signed_links_show_the_packets_that_they_have_refused(width, height):
    none = {"unsigned": 0, "wrong": 0, "old": 0}
    counts = {"serial:/dev/ttyTHS1:921600": none, "udp::14551": none}
    text = page({**FLYING, "refused": counts}, width, height)
    assert "refused none" in text
    counts["udp::14551"] = {"unsigned": 12, "wrong": 3, "old": 0}
    counts["udp::14552"] = {"unsigned": 1, "wrong": 0, "old": 0}
    text = page({**FLYING, "refused": counts}, width, height)
    assert "refused 13 unsigned, 3 wrong" in text
    assert len(text.splitlines()) <= height
    assert "refused" not in page({**FLYING, "refused": None}, width, height)


def test_a_row_of_the_page_shows_the_sensor_if_there_is_one():
    seen = {
        "scan_age_s": 0.12,
        "returns": 0.46,
        "refused": 3,
        "refusal": None,
        "late": 1,
        "conductors": [{}, {}],
        "solids": 4,
        "line": {"offset_m": (0.412, -1.3), "covariance_m2": (0.0144, 0.0, 0.01), "wires": 5}
        | {"heading_offset_rad": 0.21, "age_s": 0.2},
    }
    assert "+0.41 m, up -1.30 m, heading +12°; to 0.12 m by 5 wires, 0.2 s ago" in page(
        FLYING | {"perception": seen}
    )
    unknown = seen | {"line": seen["line"] | {"age_s": None}}
    assert "not known by its wires" in page(FLYING | {"perception": unknown})
    (row,) = (line for line in page(FLYING | {"perception": seen}).splitlines() if "seen" in line)
    assert "2 conductors, 4 other obstacles; scan 0.1 s ago, 46% of beams" in row
    assert not any(line.startswith("seen") for line in page(FLYING | {"perception": None}))
    refusal = page(FLYING | {"perception": seen | {"refusal": "with a wrong checksum"}})
    assert "packets with a wrong checksum" in refusal
    blind = page(FLYING | {"perception": seen | {"scan_age_s": None}})
    assert "no scan yet" in blind


def test_the_last_refused_setpoint_stands_beside_the_present_one():
    assert "   gate held 12 s ago: setpoint jumps by 0.3 m" in page(SEEING, 250, 70)
    assert "   gate held 12 s ago" in page(SEEING | {"path": None}, 250, 70)
    assert "gate" not in page(FLYING, 250, 70)


def test_what_was_set_in_flight_stands_on_the_page():
    values = {"LIM_WIND": 9.0, "SAFE_D_MIN": 1.5, "SAFE_D_MAX": 4.0, "SPEED_UP": 1.0}
    status = FLYING | {"parameters": values}
    assert "LIM_WIND 9, SAFE_D_MIN 1.5, SAFE_D_MAX 4 and 1 more" in page(status, 80, 48)
    assert "LIM_WIND" not in page(FLYING)
