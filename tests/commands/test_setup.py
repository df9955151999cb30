"""`moar-companion setup` as a user runs it: questions, files, fake autopilots on real sockets."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import sys
import termios
import threading
import tty
from pathlib import Path

import pytest
import yaml
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.commands import cli, link_search, outputs
from moar_companion.commands import setup as module
from moar_companion.commands.questions import Questions
from moar_companion.errors import InputError
from moar_companion.settings.config import Authority, CompanionConfig, shipped_configs
from moar_companion.settings.link_config import LinkConfig, LinkRole
from moar_companion.settings.vehicle import Vehicle
from moar_companion.settings.yaml_edit import with_values
from tests.one_line import one_line
from tests.processes import simulator

SITE = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
OFFLINE = ("--offline", "--connect", "udp:127.0.0.1:14540", "--autopilot", "px4")


def setup(folder, *arguments):
    return cli.main(["setup", "--out", str(folder), *map(str, arguments)])


def config_of(folder):
    return CompanionConfig.load(folder / "companion.yaml")


@pytest.fixture
def person(monkeypatch):
    """A person at the terminal: answers by a part of the question; the questions asked."""
    answers, asked = {}, []

    def typed(prompt):
        asked.append(prompt)
        answer = next((text for part, text in answers.items() if part in prompt), "")
        if isinstance(answer, list):
            answer = answer.pop(0)
        if isinstance(answer, BaseException):
            raise answer
        return answer

    monkeypatch.setattr("builtins.input", typed)
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
    return answers, asked


def test_without_an_aircraft_files_are_written_by_options_and_defaults(tmp_path, capsys):
    assert setup(tmp_path, *OFFLINE, "--yes", "--radius", "0.5") == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "FILES OK" in out
    config, vehicle = config_of(tmp_path), Vehicle.load(tmp_path / "vehicle.yaml")
    assert (config.vehicle, config.site) == (tmp_path / "vehicle.yaml", None)
    assert config.links == (LinkConfig(url="udp:127.0.0.1:14540"),)
    assert (vehicle.radius_m, vehicle.autopilot, vehicle.risk.cells) == (0.5, "px4", None)
    assert vehicle.speed.horizontal_mps == 2.0
    assert {path.name for path in tmp_path.iterdir()} == {"companion.yaml", "vehicle.yaml"}


def test_all_that_setup_does_not_ask_stays_in_an_old_configuration(tmp_path):
    (tmp_path / "signing.key").write_bytes(bytes(range(32)))
    (tmp_path / "signing.key").chmod(0o400)
    old = (
        "vehicle: old.yaml\n# mine\nlinks:\n- {url: 'udp::1', signed: true}  # to PX4\n"
        "- {url: 'udp::2', role: operator}\nsetpoint_rate_hz: 40.0   # slow line\n"
        "signing: {key_file: signing.key}\n"
    )
    (tmp_path / "companion.yaml").write_text(old)
    (tmp_path / "companion.yaml").chmod(0o640)
    assert setup(tmp_path, *OFFLINE, "--yes", "--authority", "engage") == 0
    text, config = (tmp_path / "companion.yaml").read_text(), config_of(tmp_path)
    assert "# mine\n" in text
    assert "setpoint_rate_hz: 40.0   # slow line\n" in text
    assert config.links == (
        LinkConfig(url="udp:127.0.0.1:14540", signed=True),
        LinkConfig(url="udp::2", role=LinkRole.OPERATOR),
    )
    assert config.authority is Authority.ENGAGE
    assert (tmp_path / "companion.yaml").stat().st_mode & 0o777 == 0o640


@pytest.mark.slow
def test_a_second_setup_keeps_vehicle_site_and_authority_unless_told_otherwise(tmp_path):
    vehicle = ("--radius", "0.6", "--name", "mine")
    chosen = ("--site", SITE, "--authority", "observe")
    assert setup(tmp_path, *OFFLINE, "--yes", *vehicle, *chosen) == 0
    measured = tmp_path / "vehicle.yaml"
    measured.write_text(measured.read_text() + "# measured\n")
    assert setup(tmp_path, *OFFLINE, "--yes") == 0
    config = config_of(tmp_path)
    assert (config.site, config.authority) == (SITE.resolve(), Authority.OBSERVE)
    assert measured.read_text().endswith("# measured\n")
    # Told otherwise: no site, and a new vehicle file, with the old one beside it.
    assert setup(tmp_path, *OFFLINE, "--yes", "--site", "none", "--radius", "0.7") == 0
    assert config_of(tmp_path).site is None
    assert Vehicle.load(measured).radius_m == 0.7
    assert (tmp_path / "vehicle.yaml.old").read_text().endswith("# measured\n")


@pytest.mark.slow
def test_a_vehicle_of_another_autopilot_is_not_kept(tmp_path):
    assert setup(tmp_path, *OFFLINE, "--yes") == 0
    assert setup(tmp_path, *OFFLINE[:-1], "ardupilot", "--yes") == 0
    assert Vehicle.load(tmp_path / "vehicle.yaml").autopilot == "ardupilot"
    assert Vehicle.load(tmp_path / "vehicle.yaml.old").autopilot == "px4"


def test_the_example_of_the_package_has_no_answers(tmp_path):
    shutil.copy(shipped_configs() / "companion.yaml", tmp_path)
    assert setup(tmp_path, *OFFLINE, "--yes") == 0
    config = config_of(tmp_path)
    assert (config.vehicle, config.site) == (tmp_path / "vehicle.yaml", None)


def test_a_file_that_the_installed_service_cannot_read_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(module, "INSTALLED_CONFIG", tmp_path / "etc/companion.yaml")
    monkeypatch.setattr(module, "_UNREADABLE", (str(tmp_path / "home"),))
    for name in ("etc", "home"):
        (tmp_path / name).mkdir()
    site = shutil.copy(SITE, tmp_path / "home")
    arguments = ["setup", *OFFLINE, "--yes", "--site", str(site)]
    line = one_line(arguments, 2, capsys)
    assert "where the service may not read: copy it to" in line
    assert list((tmp_path / "etc").iterdir()) == []
    assert setup(tmp_path / "home", *OFFLINE, "--yes", "--site", site) == 0


def test_a_person_is_asked_again_after_a_wrong_answer(tmp_path, person, capsys):
    answers, asked = person
    answers |= {"--radius": ["broad", "0.7"], "--speeds": "3,1,0.8", "--name": "Line drone"}
    assert setup(tmp_path, *OFFLINE) == 0
    vehicle = Vehicle.load(tmp_path / "vehicle.yaml")
    assert (vehicle.name, vehicle.radius_m, vehicle.speed.down_mps) == ("Line drone", 0.7, 0.8)
    assert "--radius: is 'broad', must be a number of metres" in capsys.readouterr().out
    assert [prompt for prompt in asked if "--radius" in prompt and "[0.38]" in prompt]


@pytest.mark.parametrize("moment", ["a question", "the writing"])
def test_an_interrupted_setup_leaves_the_old_files(tmp_path, person, monkeypatch, moment):
    answers, _ = person
    old = {"companion.yaml": "vehicle: vehicle.yaml\n", "vehicle.yaml": "old\n"}
    for name, text in old.items():
        (tmp_path / name).write_text(text)
    if moment == "a question":
        answers["--authority"] = KeyboardInterrupt()
    else:
        monkeypatch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(KeyboardInterrupt))
    assert setup(tmp_path, *OFFLINE) == 1
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == old


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--out", "nowhere"], ["--out", "'nowhere'", "is no folder"]),
        (["--offline", "--yes"], ["--autopilot", "px4, ardupilot"]),
        (["--offline", "--autopilot", "px4"], ["--connect", "searches no link"]),
        ([*OFFLINE, "--apply"], ["--apply", "without --offline"]),
        ([*OFFLINE, "--yes", "--site", "no.yaml"], ["no.yaml", "no such file"]),
        ([*OFFLINE, "--yes", "--vehicle", "no.yaml"], ["no.yaml", "no such file"]),
        (["--connect", "pigeon"], ["'pigeon'", "is not a link"]),
        (["--radius", "0"], ["--radius", "'0'", "0.05 to 5"]),
        (["--speeds", "1,2"], ["--speeds", "LEVEL,UP,DOWN"]),
        (["--speeds", "1,2,99"], ["--speeds", "0.5 to 30"]),
        (["--cells", "four"], ["--cells", "'four'"]),
        (["--authority", "all"], ["--authority", "observe, stream, engage"]),
        (["--parameters", "a.txt"], ["--parameters", ".params or .param"]),
        (["--autopilot", "other"], ["--autopilot", "px4, ardupilot"]),
        (["--name", ""], ["--name", "printable"]),
    ],
)
def test_a_wrong_option_is_one_line_and_writes_nothing(
    tmp_path, monkeypatch, capsys, arguments, words
):
    monkeypatch.chdir(tmp_path)
    line = one_line(["setup", *arguments], 2, capsys)
    assert [word for word in words if word not in line] == []
    assert list(tmp_path.iterdir()) == []


def test_a_question_without_default_or_person_names_its_option():
    with pytest.raises(InputError, match="--connect: is missing: which link"):
        Questions(yes=True).ask("--connect", "which link", None, str)
    assert not Questions(yes=True).confirmed("set them?", given=False)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a: 1\n", {"a": 2, "b": 3}),
        ("a:\nb: 1", {"a": 2, "b": 3}),
        ("a:\n  - x\n  - y\nb:\n- z\nc: 4\n", {"a": 2, "b": 3, "c": 4}),
        ("b: {x: 1,\n  y: 2}\n# end", {"a": 2, "b": 3}),
        ("a:   # why: so\n  x: 1\n", {"a": 2, "b": 3}),
    ],
)
def test_values_are_replaced_in_any_form_of_yaml(text, expected):
    edited = with_values(text, "file", {"a": "2", "b": "3"})
    assert yaml.safe_load(edited) == expected
    assert ("# end" in text) == ("# end" in edited)


def test_a_file_of_which_another_value_would_change_is_refused():
    values_in_blocks = ("b: |\n  x\na: 1\n", "b: &x 1\nc: *x\na: 1\n", "---\na: 1\n...\n")
    for text in ("{a: 1}", "- a", "a: [", "", *values_in_blocks):
        with pytest.raises(InputError, match="cannot be edited"):
            with_values(text, "file", {"a": "2", "b": "3"})


def test_files_that_belong_together_are_replaced_together(tmp_path, monkeypatch):
    paths = [tmp_path / name for name in ("a", "b")]
    outputs.replace_together(dict.fromkeys(paths, "new"))
    assert [path.read_text() for path in paths] == ["new", "new"]
    with pytest.raises(OSError, match="No such file"):
        outputs.replace_together({paths[0]: "newer", tmp_path / "none" / "c": "newer"})
    assert [path.read_text() for path in tmp_path.iterdir()] == ["new", "new"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_while_files_are_replaced_ends_nothing_in_between(tmp_path, monkeypatch, number):
    def end(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", lambda _: os.kill(os.getpid(), number))
    before = signal.signal(number, end)
    try:
        with pytest.raises(KeyboardInterrupt):
            outputs.replace_together(dict.fromkeys((tmp_path / "a", tmp_path / "b"), "new"))
    finally:
        signal.signal(number, before)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["new", "new"]


@pytest.mark.slow
@pytest.mark.real_time
@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
def test_a_fake_autopilot_is_found_read_and_set_on_real_sockets(
    tmp_path, monkeypatch, capsys, unused_udp_port, kind
):
    url = f"udp:127.0.0.1:{unused_udp_port}"
    monkeypatch.setattr(link_search, "UDP_LINKS", (url,))
    monkeypatch.setattr(link_search, "serial_ports", list)
    link = f"companion=udpout:127.0.0.1:{unused_udp_port}"
    wanted = ("--parameters", tmp_path / "set.params", "--json", tmp_path / "report.json")
    with simulator("--autopilot", kind, "--link", link):
        assert setup(tmp_path, "--yes", *wanted, "--apply") == 0
        out = capsys.readouterr().out
        assert setup(tmp_path, "--yes", "--connect", url, "--site", SITE) == 0
        again = capsys.readouterr().out
    report = json.loads((tmp_path / "report.json").read_text())
    assert (report["link"], report["autopilot"]) == (url, kind)
    assert {each["status"] for each in report["set"]} == {"set"}
    assert len(report["set"]) == len(report["parameters"]) > 0
    rows = (tmp_path / "set.params").read_text().splitlines()
    assert sum(not row.startswith("#") for row in rows) == len(report["set"])
    assert config_of(tmp_path).site == SITE.resolve()
    assert f"found {kind}, system 1: {url}\n" in out
    assert "the autopilot's parameters: none has to be set\n" in again
    vehicle = Vehicle.load(tmp_path / "vehicle.yaml")
    speeds = {"px4": (5.0, 3.0, 1.5), "ardupilot": (10.0, 2.5, 1.5)}[kind]
    speed = vehicle.speed
    assert (speed.horizontal_mps, speed.up_mps, speed.down_mps) == speeds
    assert vehicle.autopilot == kind
    assert vehicle.risk.cells == {"px4": 4, "ardupilot": None}[kind] or kind == "ardupilot"


@contextlib.contextmanager
def autopilot_at(baud):
    """A pseudo terminal that is a serial port, whose other end sends heartbeats at one rate."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    codec = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    beat = mavlink.MAVLink_heartbeat_message(2, 12, 81, 0, 3, 3)
    ended = threading.Event()

    def send():
        while not ended.wait(0.2):
            if termios.tcgetattr(theirs)[5] == getattr(termios, f"B{baud}"):
                os.write(ours, beat.pack(codec))
                codec.seq = (codec.seq + 1) % 256

    thread = threading.Thread(target=send)
    thread.start()
    try:
        yield os.ttyname(theirs)
    finally:
        ended.set()
        thread.join()
        os.close(ours)
        os.close(theirs)


@pytest.mark.slow
@pytest.mark.real_time
def test_serial_ports_are_searched_by_their_lasting_names_at_the_usual_rates(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(link_search, "UDP_LINKS", ())
    monkeypatch.setattr(link_search, "_DEV", tmp_path)
    monkeypatch.setattr(link_search, "_BY_ID", tmp_path / "by-id")
    (tmp_path / "by-id").mkdir()
    with autopilot_at(57_600) as device, autopilot_at(110) as silent:
        lasting = tmp_path / "by-id" / "usb-FTDI_A10K-if00-port0"
        lasting.symlink_to(device)
        (tmp_path / "ttyTHS1").symlink_to(silent)
        assert link_search.serial_ports() == [str(lasting), str(tmp_path / "ttyTHS1")]
        monkeypatch.setattr(link_search, "BAUD_RATES", (921_600, 57_600))
        assert setup(tmp_path, "--yes") == 0
    assert f"found px4, system 7: serial:{lasting}:57600\n" in capsys.readouterr().out
    assert config_of(tmp_path).links[0].url == f"serial:{lasting}:57600"


@pytest.mark.slow
@pytest.mark.real_time
def test_without_an_autopilot_each_link_is_named_with_what_was_received(
    tmp_path, monkeypatch, capsys, unused_udp_port
):
    monkeypatch.setattr(link_search, "UDP_LINKS", (f"udp:127.0.0.1:{unused_udp_port}",))
    monkeypatch.setattr(link_search, "serial_ports", lambda: ["/dev/absent"])
    assert setup(tmp_path, "--yes") == 1
    err = capsys.readouterr().err
    assert "no autopilot was found: is it powered" in err
    assert f"udp:127.0.0.1:{unused_udp_port}: nothing is received" in err
    assert "/dev/absent" in err
    assert list(Path(tmp_path).iterdir()) == []
