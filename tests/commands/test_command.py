"""The operator's command against a companion of raw pymavlink."""

from __future__ import annotations

import json
import math
import signal
import socket
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.commands import cli
from moar_companion.commands.ground_station import mavsdk_url
from moar_companion.mavlink.urls import parse_url
from moar_companion.settings.config import shipped_configs
from tests.processes import companion

from .answering import (
    ACCEPTED,
    AUTOPILOT,
    CANCELLED,
    COMPANION,
    DENIED,
    FAILED,
    IN_PROGRESS,
    OPERATOR,
    PAUSE_CONTINUE,
    TEMPORARILY_REJECTED,
    UNSUPPORTED,
    USER_1,
    Aircraft,
    acknowledgement,
    always,
    text,
)

SITE = str(shipped_configs() / "sites" / "315kv_double_circuit.yaml")


def started(*arguments):
    return companion("command", *arguments)


@pytest.fixture
def ordered(capfd):
    """Run the command in this process. Return its status and its output."""

    def run(*arguments):
        status = cli.main(["command", *arguments])
        return SimpleNamespace(status=status, **capfd.readouterr()._asdict())

    return run


@pytest.mark.parametrize(
    ("arguments", "command", "parameters"),
    [
        (["inspection"], USER_1, (1, -1)),
        (["inspection", "--target", "4"], USER_1, (1, 4)),
        (["inspection", "--target", "splice-inner", "--site", SITE], USER_1, (1, 1)),
        (["inspection", "--target=1", "--site", SITE], USER_1, (1, 1)),
        (["inspection", "--target", "all", "--site", SITE], USER_1, (1, -1)),
        (["inspection", "--target", "all"], USER_1, (1, -1)),
        (["exit", "--target", "0", "--site", SITE], USER_1, (2, 0)),
        (["evacuation"], USER_1, (3, -1)),
        (["hold"], USER_1, (0, -1)),
        (["release"], USER_1, (4, -1)),
        (["pause"], PAUSE_CONTINUE, (0, -1)),
        (["continue"], PAUSE_CONTINUE, (1, -1)),
    ],
)
def test_an_order_is_one_command_to_the_companion(ordered, arguments, command, parameters):
    with Aircraft(always(acknowledgement(ACCEPTED, command=command))) as aircraft:
        done = ordered(*arguments, "--connect", aircraft.url)
    assert (done.status, done.out, done.err) == (0, f"{arguments[0]}: ACCEPTED\n", "")
    (sent,) = aircraft.commands
    assert (sent.get_srcSystem(), sent.get_srcComponent()) == OPERATOR
    assert (sent.target_system, sent.target_component) == (1, COMPANION)
    assert (sent.command, sent.param1, sent.param2, sent.confirmation) == (command, *parameters, 0)


def test_a_denial_is_printed_with_its_reason_joined_from_chunks(ordered):
    reason = "MOAR: a text of another version that is longer than one chunk, denied"
    answer = always(
        acknowledgement(DENIED),
        text(reason[:50], chunk=(7, 0)),
        text(reason[50:], chunk=(7, 1)),
    )
    with Aircraft(answer) as aircraft:
        done = ordered("inspection", "--connect", aircraft.url)
    assert (done.status, done.err) == (1, "")
    assert done.out == f"inspection: DENIED\n{reason}\n"


@pytest.mark.parametrize(
    ("result", "word"),
    [
        (TEMPORARILY_REJECTED, "temporarily rejected"),
        (DENIED, "denied"),
        (FAILED, "failed"),
        (CANCELLED, "cancelled"),
    ],
)
def test_an_order_that_is_not_accepted_waits_for_its_reason_and_ends_with_status_1(
    ordered, result, word
):
    reply = f"MOAR: so it is, {word.rpartition(' ')[2]}"
    why = text(reply)
    with Aircraft(always(text("MOAR idle"), acknowledgement(result), why)) as aircraft:
        done = ordered("hold", "--connect", aircraft.url)
    name = word.upper().replace(" ", "_")
    assert (done.status, done.err) == (1, "")
    assert done.out == f"MOAR idle\nhold: {name}\n{reply}\n"


def test_a_reason_whose_acknowledgement_was_lost_is_not_awaited_again(ordered):
    def answer(command):
        if command.confirmation == 0:
            return [text("MOAR: nothing is flown, rejected")]
        return [acknowledgement(TEMPORARILY_REJECTED)]

    with Aircraft(answer) as aircraft:
        done = ordered("hold", "--connect", aircraft.url)
    assert done.out == "MOAR: nothing is flown, rejected\nhold: TEMPORARILY_REJECTED\n"


@pytest.mark.parametrize(
    ("result", "printed"),
    [(UNSUPPORTED, "UNSUPPORTED"), (77, "REFUSED, result 77")],
)
def test_a_refusal_without_a_reason_is_printed_even_if_its_number_is_unknown(
    ordered, result, printed
):
    with Aircraft(always(acknowledgement(result))) as aircraft:
        done = ordered("hold", "--connect", aircraft.url)
    assert (done.status, done.err) == (1, "")
    assert done.out == f"hold: {printed}\n(no reason was received)\n"


def test_progress_of_planning_is_printed_once_and_restarts_the_timeout(ordered):
    def answer(command):
        if command.confirmation == 0:
            return [text("MOAR planning inspection"), acknowledgement(IN_PROGRESS)]
        if command.confirmation < 5:
            return [acknowledgement(IN_PROGRESS)]
        return [text("MOAR ready inspection"), acknowledgement(ACCEPTED)]

    with Aircraft(answer) as aircraft:
        done = ordered("inspection", "--connect", aircraft.url, "--timeout", "2")
    assert (done.status, done.err) == (0, "")
    assert done.out.splitlines() == [
        "MOAR planning inspection",
        "inspection: IN_PROGRESS",
        "MOAR ready inspection",
        "inspection: ACCEPTED",
    ]


def test_a_lost_order_is_repeated_as_such(ordered):
    def answer(command):
        return [acknowledgement(ACCEPTED)] if command.confirmation == 2 else []

    with Aircraft(answer) as aircraft:
        done = ordered("hold", "--connect", aircraft.url)
    assert (done.status, done.out) == (0, "hold: ACCEPTED\n")
    assert [sent.confirmation for sent in aircraft.commands] == [0, 1, 2]


def test_answers_to_other_systems_and_texts_of_other_systems_are_ignored(ordered):
    def answer(command):
        if command.confirmation:
            return [acknowledgement(ACCEPTED)]
        return [
            acknowledgement(DENIED, to=(255, 190)),
            acknowledgement(DENIED, component=AUTOPILOT),
            acknowledgement(DENIED, command=PAUSE_CONTINUE),
            text("Armed", component=AUTOPILOT),
        ]

    with Aircraft(answer, components=(AUTOPILOT, COMPANION)) as aircraft:
        done = ordered("hold", "--connect", aircraft.url)
    assert (done.status, done.out, done.err) == (0, "hold: ACCEPTED\n", "")


def test_no_answer_is_one_line(ordered):
    with Aircraft() as aircraft:
        done = ordered("hold", "--connect", aircraft.url, "--timeout", "2")
    assert (done.status, done.out) == (1, "")
    assert done.err == "moar-companion: hold: the companion has not answered for 2 s\n"


def test_without_a_companion_the_received_systems_are_named(ordered):
    with Aircraft(components=(AUTOPILOT,)) as aircraft:
        done = ordered("hold", "--connect", aircraft.url, "--timeout", "2")
    assert (done.status, done.out, aircraft.commands) == (1, "", [])
    assert done.err == (
        f"moar-companion: no companion (component 195) received on {aircraft.url} for 2 s: "
        "system 1 with components 1\n"
    )


def test_a_link_without_packets_is_reported(ordered):
    with Aircraft(components=()) as aircraft:
        done = ordered("status", "--connect", aircraft.url, "--timeout", "0.5")
    assert (done.status, done.out) == (1, "")
    assert done.err.endswith("for 0.5 s: nothing is received\n")


def test_status_shows_the_companions_own_reports(ordered, tmp_path):
    messages = [
        (COMPANION, mavlink.MAVLink_named_value_float_message(0, name.encode(), value))
        for name, value in [
            ("RISK_WIND", 0.25),
            ("RISK_COMM", 0.0),
            ("RISK_LOC", math.nan),
            ("K_SAFETY", 0.5),
            ("K_TIME", 0.125),
            ("K_ENERGY", 0.375),
        ]
    ]
    reply = [
        text("MOAR: flying inspection to splice-1"),
        text("MOAR: GNSS receiver has no 3D fix, holding"),
    ]
    with Aircraft(components=(AUTOPILOT, COMPANION), messages=[*messages, *reply]) as aircraft:
        done = ordered("status", "--connect", aircraft.url, "--json", str(tmp_path / "status.json"))
    assert (done.status, done.err, aircraft.commands) == (0, "", [])
    assert json.loads((tmp_path / "status.json").read_text()) == {
        "system_id": 1,
        "companion": "flying, streams setpoints",
        "autopilot": "px4, armed, OFFBOARD",
        "risk": {"wind": 0.25, "communication": 0.0, "localization": None, "battery": None},
        "weights": {"safety": 0.5, "time": 0.125, "energy": 0.375},
        "texts": [
            "MOAR: flying inspection to splice-1",
            "MOAR: GNSS receiver has no 3D fix, holding",
        ],
    }
    assert done.out.splitlines() == [
        "companion  system 1, component 195: flying, streams setpoints",
        "autopilot  px4, armed, OFFBOARD",
        "risks      wind 0.25, communication 0.00, localization unknown, battery not received",
        "weights    safety 0.50, time 0.12, energy 0.38",
        "texts      MOAR: flying inspection to splice-1",
        "texts      MOAR: GNSS receiver has no 3D fix, holding",
    ]


def test_control_characters_of_a_text_do_not_reach_the_terminal(ordered):
    answer = always(text("MOAR \x1b[2Jready\n"), acknowledgement(ACCEPTED))
    with Aircraft(answer) as aircraft:
        done = ordered("inspection", "--connect", aircraft.url)
    assert done.out == "MOAR [2Jready\ninspection: ACCEPTED\n"


def test_an_interrupt_ends_the_command_without_output():
    answer = always(acknowledgement(IN_PROGRESS))
    with Aircraft(answer) as aircraft, started("exit", "--connect", aircraft.url) as process:
        assert process.stdout.readline() == "exit: IN_PROGRESS\n"
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=10)
    assert (process.returncode, out, err) == (1, "", "")


def test_a_port_in_use_is_one_line_and_status_1(ordered):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        done = ordered("hold", "--connect", f"udp:127.0.0.1:{port}")
    assert (done.status, done.out) == (1, "")
    assert done.err == (
        f"moar-companion: udpin:127.0.0.1:{port}: Bind error: Address already in use\n"
    )


def test_a_missing_device_is_one_line_and_status_1(ordered):
    done = ordered("hold", "--connect", "serial:/dev/no-such-device:57600")
    assert (done.status, done.out) == (1, "")
    assert done.err == (
        "moar-companion: serial:/dev/no-such-device:57600: "
        "Call open failed: No such file or directory\n"
    )


def test_a_tcp_peer_that_is_not_there_is_named(ordered):
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        url = f"tcp:127.0.0.1:{silent.getsockname()[1]}"
        done = ordered("hold", "--connect", url, "--timeout", "0.5")
    assert (done.status, done.out) == (1, "")
    assert url in done.err
    assert "Connection refused" in done.err


@pytest.mark.parametrize(
    ("url", "mavsdks"),
    [
        ("udp:127.0.0.1:14550", "udpin://127.0.0.1:14550"),
        ("udp::14550", "udpin://0.0.0.0:14550"),
        ("udpin://localhost:14550", "udpin://127.0.0.1:14550"),
        ("udpout:10.0.0.2:14540", "udpout://10.0.0.2:14540"),
        ("tcp:127.0.0.1:5760", "tcpout://127.0.0.1:5760"),
        ("serial:/dev/ttyTHS1:921600", "serial:///dev/ttyTHS1:921600"),
        ("serial:///dev/ttyTHS1:921600", "serial:///dev/ttyTHS1:921600"),
    ],
)
def test_a_url_is_converted_to_that_of_mavsdk(url, mavsdks):
    assert mavsdk_url(parse_url(url)) == mavsdks


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fly"], ["MISSION", "'fly'", "inspection", "status"]),
        (["inspection", "--target", "splice-inner"], ["--target", "'splice-inner'", "--site"]),
        (
            ["inspection", "--target", "x", "--site", SITE],
            ["--target", "'x'", "splice-outer, splice-inner"],
        ),
        (["inspection", "--target", "2", "--site", SITE], ["'2'", "splice-outer, splice-inner"]),
        (["exit", "--target", "splice-inner"], ["'splice-inner'", "index of a landing point"]),
        (["exit", "--target", "9", "--site", SITE], ["'9'", "one of 0"]),
        (["exit", "--target", "all"], ["'all'", "index of a landing point"]),
        (["exit", "--target", "-1"], ["'-1'", "index of a landing point"]),
        (["hold", "--target", "0"], ["'0'", "hold has no target"]),
        (["hold", "--json", "-"], ["--json", "it is of status"]),
        (["inspection", "--target", "x", "--site", "no.yaml"], ["no.yaml", "no such file"]),
        (["hold", "--timeout", "0"], ["--timeout", "'0'", "above 0"]),
        (["hold", "--timeout", "nan"], ["--timeout", "'nan'"]),
        (["hold", "--connect", "pigeon:home"], ["'pigeon:home'", "udp:HOST:PORT"]),
        ([], ["inspection|exit|evacuation"]),
    ],
)
def test_bad_input_is_one_line_that_names_it_and_status_2(arguments, words, capsys):
    connect = [] if "--connect" in arguments else ["--connect", "udp::14550"]
    assert cli.main(["command", *arguments, *connect]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert [word for word in words if word not in err] == []


def test_without_a_link_the_command_asks_for_one(capsys):
    assert cli.main(["command", "hold"]) == 2
    assert "--connect" in capsys.readouterr().err
