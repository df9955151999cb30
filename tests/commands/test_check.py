"""`moar-companion check` as a user runs it: files, links, exit status."""

import argparse
import contextlib
import errno
import json
import os
import socket
from pathlib import Path

import pytest
import serial

from moar_companion.commands import cli
from moar_companion.commands.check import _summary as last_line
from moar_companion.commands.service import configured, merged
from moar_companion.companion.preflight.findings import Finding, Level
from moar_companion.settings.config import shipped_configs
from tests.processes import simulator

CONFIGS = shipped_configs()
SITE = CONFIGS / "sites" / "315kv_double_circuit.yaml"
X500 = CONFIGS / "vehicles" / "x500.yaml"


def check(*arguments):
    """With no link the files alone."""
    links = [] if "--connect" in arguments else ["--files"]
    return cli.main(["check", *map(str, arguments), *links])


def edited(tmp_path, source, *changes):
    """A copy of a file with some of its text replaced."""
    text = source.read_text()
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    path = tmp_path / source.name
    path.write_text(text)
    return path


def test_without_a_sensor_check_says_which_position_error_is_not_noticed(capsys):
    check("--config", CONFIGS / "companion.yaml")
    out, _ = capsys.readouterr()
    assert "no sensor sees the line: a position error above 1.4 m that is not reported" in out


def test_a_grave_warning_stands_in_the_last_line():
    closing = "where GPS is lost (exit from splice-inner) the autopilot may hit right-lower"
    grave = Finding(level=Level.WARNING, subject="failsafe", text="GPS loss …", closing=closing)
    fine = Finding(level=Level.OK, subject="margin", text="2.55 m")
    assert last_line([fine], files=False, seen=True) == "GO"
    assert last_line([fine, grave], files=False, seen=True) == f"GO: 1 warning, {closing}"


def test_the_shipped_configuration_is_a_go(capsys):
    assert check("--config", CONFIGS / "companion.yaml") == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "Site 315 kV double circuit\n" in out
    assert out.endswith("\nFILES OK: the aircraft was not checked\n")
    findings = [line for line in out.splitlines() if line.startswith("  ")]
    assert {line.split()[0] for line in findings} == {"ok", "note"}


def test_a_key_without_a_signed_link_is_a_warning_and_signed_links_are_named(capsys, tmp_path):
    key = tmp_path / "signing.key"
    key.write_bytes(bytes(range(32)))
    key.chmod(0o400)
    config = tmp_path / "companion.yaml"
    for signed in (False, True):
        link = f"{{url: 'udp:127.0.0.1:14540', signed: {str(signed).lower()}}}"
        config.write_text(f"vehicle: {X500}\nlinks: [{link}]\nsigning: {{key_file: signing.key}}\n")
        assert check("--config", config) == 0
        out = capsys.readouterr().out
        assert ("signing: a key is named, but no link is signed; set signed: true" in out) != signed
        assert ("udp:127.0.0.1:14540 (autopilot, signed)" in out) == signed


def test_a_serial_device_whose_number_may_change_is_a_warning_with_its_lasting_name(
    capsys, tmp_path, monkeypatch
):
    by_id, config = tmp_path / "by-id", tmp_path / "companion.yaml"
    monkeypatch.setattr("moar_companion.commands.service_check._BY_ID", by_id)

    def warnings(device):
        config.write_text(f"vehicle: {X500}\nlinks: [{{url: 'serial:{device}:57600'}}]\n")
        assert check("--config", config) == 0
        return [line for line in capsys.readouterr().out.splitlines() if "  warning" in line]

    for device in ("/dev/ttyUSB0", "/dev/ttyACM12"):
        (line,) = warnings(device)
        assert f"  warning  links: {device} may have another number after" in line
        assert line.endswith(f"; use a name of `ls -l {by_id}`")
    for device in ("/dev/ttyTHS1", "/dev/ttyAMA0", "/dev/serial/by-id/usb-FTDI-if00-port0"):
        assert warnings(device) == []
    by_id.mkdir()
    (by_id / "usb-FTDI_FT232R_A10KZP4M-if00-port0").symlink_to("/dev/ttyUSB0")
    (by_id / "usb-Silicon_Labs_CP2102_0001-if00-port0").symlink_to("/dev/ttyUSB1")
    assert warnings("/dev/ttyUSB1")[0].endswith(
        f"; use serial:{by_id}/usb-Silicon_Labs_CP2102_0001-if00-port0:57600"
    )


@pytest.mark.parametrize(
    ("link", "rate_hz", "warned"),
    [
        ("url: 'serial:/dev/ttyTHS1:57600'", 50, None),
        ("url: 'serial:/dev/ttyTHS1:57600'", 100, "5760 B/s: setpoints take 6500, all else up"),
        ("url: 'serial:/dev/ttyTHS1:38400'", 50, "3840 B/s: setpoints take 3250, all else up"),
        ("url: 'serial:/dev/ttyS1:38400', role: operator}, {url: 'udp::14540'", 50, None),
        ("url: 'serial:/dev/ttyTHS1:921600'", 100, None),
        ("url: 'udp:127.0.0.1:14540'", 100, None),
    ],
)
def test_a_line_too_slow_for_the_setpoints_is_a_warning(capsys, tmp_path, link, rate_hz, warned):
    config = tmp_path / "companion.yaml"
    config.write_text(f"vehicle: {X500}\nsetpoint_rate_hz: {rate_hz}\nlinks: [{{{link}}}]\n")
    assert check("--config", config) == 0
    warnings = [line for line in capsys.readouterr().out.splitlines() if "  warning" in line]
    assert len(warnings) == (warned is not None)
    assert all(f"links: /dev/ttyTHS1 carries {warned}" in line for line in warnings)


def test_the_links_of_the_configuration_are_looked_at(capsys, tmp_path, unused_udp_port):
    link = f"udp:127.0.0.1:{unused_udp_port}"
    config = tmp_path / "companion.yaml"
    config.write_text(f"vehicle: {X500}\nlinks: [{{url: '{link}'}}]\n")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as service:  # it runs, and owns the link
        service.bind(("127.0.0.1", unused_udp_port))
        assert cli.main(["check", "--config", str(config)]) == 1
    out, err = capsys.readouterr()
    assert err == ""
    assert f"\nAircraft on {link}\n" in out
    reported = [line for line in out.splitlines() if line.startswith("  no-go")]
    (line,) = reported
    assert line == (
        f"  no-go    link: udpin:127.0.0.1:{unused_udp_port}: in use by another program; "
        "stop the service: systemctl stop moar-companion, or what else uses it"
    )
    assert out.endswith("\nNO-GO: 1 finding, 0 warnings, no aircraft was checked\n")


def test_a_configuration_whose_links_receive_no_packet_is_a_no_go(
    capsys, tmp_path, unused_udp_port, monkeypatch
):
    monkeypatch.setattr("moar_companion.companion.preflight.aircraft_check.WAIT_S", 0.1)
    config = tmp_path / "companion.yaml"
    config.write_text(f"vehicle: {X500}\nlinks: [{{url: 'udp:127.0.0.1:{unused_udp_port}'}}]\n")
    assert cli.main(["check", "--config", str(config)]) == 1
    out = capsys.readouterr().out
    assert "  no-go    autopilot: none received on " in out
    assert out.endswith("\nNO-GO: 1 finding, 0 warnings, no aircraft was checked\n")


@pytest.mark.parametrize("load", [merged, configured], ids=["check", "the service"])
def test_check_and_service_find_the_installed_configuration(tmp_path, monkeypatch, load):
    installed = tmp_path / "companion.yaml"
    monkeypatch.setattr("moar_companion.commands.service.INSTALLED_CONFIG", installed)
    arguments = argparse.Namespace(config=None, vehicle=None, site=None, connect=[])
    assert load(arguments).file is None
    installed.write_text(f"vehicle: {X500}\nlinks: [{{url: 'udp:127.0.0.1:14999'}}]\n")
    found = load(arguments)
    assert (found.file, found.links[0].url) == (installed, "udp:127.0.0.1:14999")
    arguments.connect = ["udp:127.0.0.1:15000"]  # the command line goes before it
    assert [link.url for link in load(arguments).links] == arguments.connect
    arguments.config = str(CONFIGS / "companion.yaml")
    assert load(arguments).file == CONFIGS / "companion.yaml"


def test_the_check_reports_which_configuration_it_has_found(capsys, tmp_path, monkeypatch):
    installed = tmp_path / "companion.yaml"
    for module in ("service", "service_check"):
        monkeypatch.setattr(f"moar_companion.commands.{module}.INSTALLED_CONFIG", installed)
    assert check() == 0
    assert f"  ok       configuration: none, nor {installed}" in capsys.readouterr().out
    installed.write_text(f"vehicle: {X500}\n")
    assert check() == 0
    assert f"  ok       configuration: {installed}\n" in capsys.readouterr().out


def test_files_alone_and_a_link_exclude_each_other(capsys):
    assert cli.main(["check", "--files", "--connect", "udp::14540"]) == 2
    assert capsys.readouterr().err == (
        "moar-companion: --files: opens no link, must be given without --connect\n"
    )


def test_what_was_set_in_flight_is_named_a_line_each(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    stored = {"LIM_WIND": 9.0, "SAFE_D_MAX": 4.0, "SAFE_D_MIN": 99.0}
    file = tmp_path / "parameters.json"
    file.write_text(json.dumps({"version": 1, "vehicles": {"LineDrone, as flown": stored}}))
    assert check("--site", SITE) == 0
    out, _ = capsys.readouterr()
    assert "parameter: LIM_WIND 9, above the file's 15\n" in out
    assert "parameter: SAFE_D_MAX 4, above the file's 3\n" in out
    assert f"{file}: SAFE_D_MIN is 99, must be < SAFE_D_MAX (4), dropped" in out
    check("--site", SITE, "--vehicle", CONFIGS / "vehicles" / "linedrone_flight.yaml")
    out, _ = capsys.readouterr()
    assert "SAFE_D_MAX 4 does not count: --vehicle is given" in out


def test_without_any_option_the_check_reports_that_no_mission_is_flown(capsys):
    assert check() == 0
    assert "none: telemetry and risk only" in capsys.readouterr().out


def test_all_errors_of_all_files_are_reported_at_once(capsys, tmp_path):
    site = edited(
        tmp_path,
        SITE,
        ("resolution_m: 0.3", "resolution_m: -1"),
        ("azimuth_deg: 90", "azimuth_deg: 500"),
    )
    vehicle = edited(tmp_path, X500, ("radius_m: 0.38", "radius_m: big"))
    config = tmp_path / "companion.yaml"
    config.write_text(
        f"vehicle: {vehicle}\nsite: {site}\n"
        "links: [{url: 'smoke:signals'}, {url: 'udp:127.0.0.1:99999'}]\n"
    )
    assert check("--config", config) == 2
    out, err = capsys.readouterr()
    reported = [line for line in out.splitlines() if line.startswith("  no-go")]
    assert len(reported) == 5
    for words in (
        f"{config}: links[0].url: 'smoke:signals'",
        f"{config}: links[1].url: 'udp:127.0.0.1:99999'",
        f"{vehicle}: geometry.radius_m: is 'big'",
        f"{site}: frame.azimuth_deg: is 500",
        f"{site}: workspace.resolution_m: is -1",
    ):
        assert [line for line in reported if words in line], words
    assert "NO-GO: 5 findings\n" in out
    assert err.count("\n") == 1
    assert "(and 4 more)" in err


def test_files_of_the_command_line_are_read_even_when_the_configuration_cannot_be(capsys, tmp_path):
    arguments = ("--config", tmp_path / "none.yaml", "--site", tmp_path / "nowhere.yaml")
    assert check(*arguments) == 2
    out = capsys.readouterr().out
    assert "none.yaml: no such file" in out
    assert "nowhere.yaml: no such file" in out


def test_a_site_that_cannot_be_flown_is_a_no_go_with_status_1(capsys, tmp_path):
    site = edited(
        tmp_path, SITE, ("side: right", "side: left"), ("standoff_m: 4.0", "standoff_m: 1.0")
    )
    assert check("--site", site) == 1
    out, err = capsys.readouterr()
    assert err == ""
    assert "  no-go    target splice-outer: " in out
    assert "NO-GO: 2 findings" in out


@pytest.mark.parametrize("subject", ["recorder", "state"])
@pytest.mark.parametrize(
    ("directory", "status", "line"),
    [
        ("flights/new", 0, "  ok       {}: "),
        ("/dev/null/flights", 1, "  no-go    {}: /dev/null/flights cannot be written: "),
        ("/dev/null/flights", 1, "correct {}.directory, or the rights there"),
    ],
)
def test_a_folder_that_the_service_could_not_write_is_reported(
    capsys, tmp_path, subject, directory, status, line
):
    config = tmp_path / "companion.yaml"
    config.write_text(f"vehicle: {X500}\n{subject}: {{directory: {directory}}}\n")
    assert check("--config", config) == status
    assert line.format(subject) in capsys.readouterr().out


def test_a_folder_of_systemd_that_cannot_be_written_is_a_no_go(capsys, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", "/dev/null/state")
    assert check() == 1
    out = capsys.readouterr().out
    assert "  no-go    state: /dev/null/state cannot be written: " in out
    assert "correct STATE_DIRECTORY, or the rights there" in out


@pytest.mark.parametrize(
    ("name", "status", "line"),
    [
        ("view.sock", 0, "  ok       view: view.sock\n"),
        ("none/view.sock", 1, "cannot be made: {}/none is no folder that can be written; "),
        ("vehicle.yaml", 1, "cannot be made: something else is there; correct view.socket"),
        (f"{'x' * 200}", 1, "cannot be made: a socket's path has no more than 107 bytes"),
    ],
    ids=["free", "no folder", "a file", "too long"],
)
def test_a_view_socket_that_the_service_could_not_make_is_reported(
    capsys, tmp_path, monkeypatch, name, status, line
):
    # A socket's path may not be long, and pytest's are.
    monkeypatch.chdir(tmp_path)
    (tmp_path / "vehicle.yaml").write_text(X500.read_text())
    (tmp_path / "companion.yaml").write_text(f"vehicle: vehicle.yaml\nview: {{socket: {name}}}\n")
    assert check("--config", "companion.yaml") == status
    assert line.format(tmp_path) in capsys.readouterr().out
    assert not (tmp_path / "view.sock").exists()


def test_a_socket_file_that_exists_already_is_no_finding(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    with socket.socket(socket.AF_UNIX) as leftover:
        leftover.bind(str(tmp_path / "view.sock"))
    assert check() == 0
    assert "  ok       view: " in capsys.readouterr().out


def test_a_folder_of_another_user_is_a_no_go(capsys, tmp_path, monkeypatch):
    config = tmp_path / "companion.yaml"
    config.write_text(f"vehicle: {X500}\nrecorder: {{directory: flights}}\n")
    monkeypatch.setattr("os.access", lambda *_: False)
    assert check("--config", config) == 1
    assert f"{tmp_path} belongs to another user" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("key", "name", "reason"),
    [
        ("recorder: {{directory: {}}}", "x" * 300, "cannot be written: File name too long; "),
        ("state: {{directory: {}}}", "x" * 300, "cannot be written: File name too long; "),
        ("view: {{socket: {}}}", "x" * 300, "cannot be made: a socket's path has no more than"),
    ],
    ids=["recorder", "state", "view"],
)
def test_a_name_that_no_file_can_have_is_a_no_go(capsys, tmp_path, key, name, reason):
    config = tmp_path / "companion.yaml"
    config.write_text(f"vehicle: {X500}\n{key.format(name)}\n")
    assert check("--config", config) == 1
    out, err = capsys.readouterr()
    assert (reason in out, err) == (True, "")
    assert "else the service does not start" in out


def test_folders_without_permission_to_read_are_a_no_go(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = tmp_path / "companion.yaml"
    text = "recorder: {directory: locked/rec}\nview: {socket: locked/s}\n"
    config.write_text(f"vehicle: {X500}\n{text}")
    looked_at = Path.stat

    def stat(path, **options):
        if "locked" in path.parent.parts:  # as for another user than root
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return looked_at(path, **options)

    monkeypatch.setattr(Path, "stat", stat)
    assert check("--config", "companion.yaml") == 1
    out, err = capsys.readouterr()
    assert err == ""
    assert "locked/rec cannot be written: Permission denied; correct recorder.directory" in out
    assert "locked/s cannot be made: Permission denied; correct view.socket" in out


def test_an_authority_that_never_streams_is_reported(capsys, tmp_path):
    config = tmp_path / "companion.yaml"
    config.write_text(f"vehicle: {X500}\nauthority: observe\n")
    assert check("--config", config) == 0
    assert "  note     authority: observe: nothing is ever streamed" in capsys.readouterr().out


def test_a_terminal_gets_columns(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "60")
    assert check("--site", SITE) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) < 100
    assert any("\x1b[" in line for line in lines)


@pytest.mark.slow
def test_an_aircraft_on_real_sockets_is_reported_with_remedies_and_status_1(
    capsys, unused_udp_port
):
    home = "45.3781,-71.92915,210,90"
    at_the_port = f"companion=udpout:127.0.0.1:{unused_udp_port}"
    with simulator("--link", at_the_port, "--home", home):
        link = f"udp:127.0.0.1:{unused_udp_port}"
        status = check("--site", SITE, "--vehicle", X500, "--connect", link)
    out, err = capsys.readouterr()
    assert (status, err) == (1, "")
    assert f"Aircraft on {link}\n" in out
    assert "  ok       firmware: PX4 1.17.0\n" in out
    assert "  warning  COM_OBL_RC_ACT: 0 (position mode" in out
    assert "set 5 (hold)" in out
    assert "PX4 would hit " in out
    assert "it would return on offboard loss" in " ".join(out.split())
    assert "\nNO-GO: " in out


def test_a_port_in_use_is_a_no_go_that_names_the_program_to_stop(capsys, unused_udp_port):
    link = f"udp:127.0.0.1:{unused_udp_port}"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", unused_udp_port))
        assert check("--connect", link) == 1
    out, err = capsys.readouterr()
    assert err == ""
    assert "in use by another program; stop the service: systemctl stop moar-companion" in out
    assert out.endswith("\nNO-GO: 1 finding, 0 warnings, no aircraft was checked\n")


@pytest.mark.parametrize(
    ("link", "words"),
    [
        ("serial:/dev/ttyNIX:921600", "no such file or directory; is it plugged in?"),
        (
            "serial:/dev/null:57600",
            "is no serial port; correct --connect, or the configuration's links",
        ),
        ("udp:192.0.2.1:14540", "is no address of this computer; correct --connect"),
    ],
)
def test_a_link_that_cannot_be_opened_is_a_no_go(capsys, link, words):
    assert check("--connect", link) == 1
    out, err = capsys.readouterr()
    assert err == ""
    assert "  no-go    link: " in out
    assert words in out
    assert out.endswith("\nNO-GO: 1 finding, 0 warnings, no aircraft was checked\n")


@contextlib.contextmanager
def serial_port():
    """The device of a pseudo terminal."""
    ours, theirs = os.openpty()
    try:
        yield os.ttyname(theirs)
    finally:
        os.close(ours)
        os.close(theirs)


def test_a_serial_port_in_use_is_a_no_go_that_names_the_program_to_stop(capsys):
    with serial_port() as device, serial.Serial(device, exclusive=True):
        assert check("--connect", f"serial:{device}:57600") == 1
    assert "; stop the service: systemctl stop moar-companion" in capsys.readouterr().out


def sensing(tmp_path, port, **keys):
    """A configuration with a lidar."""
    config = tmp_path / "companion.yaml"
    listed = "".join(f", {name}: {value}" for name, value in keys.items())
    config.write_text(
        f"vehicle: {X500}\nsite: {SITE}\nlinks: [{{url: 'udp:127.0.0.1:14540'}}]\n"
        f"perception: {{sensor: velodyne, address: 127.0.0.1, port: {port}{listed}}}\n"
    )
    return config


def test_a_sensor_is_reported_with_the_speed_that_its_range_permits(capsys, tmp_path):
    assert check("--config", sensing(tmp_path, 2368)) == 0
    out = capsys.readouterr().out
    assert "ok       perception: velodyne on 127.0.0.1:2368, sight 8 m: at most" in out


def test_a_sensor_range_too_short_for_the_slowest_flight_is_a_no_go(capsys, tmp_path):
    assert check("--config", sensing(tmp_path, 2368, sight_m=2.0)) == 1
    out = capsys.readouterr().out
    assert "perception: velodyne on 127.0.0.1:2368, sight 2 m: at v_MIN of" in out


def test_a_description_of_an_ouster_that_is_missing_is_no_go(capsys, tmp_path):
    config = sensing(tmp_path, 7502)
    text = config.read_text().replace("velodyne", "ouster, metadata: lidar.json")
    config.write_text(text)
    assert check("--config", config) == 1
    line = (
        "lidar.json: no such file; perception.metadata must be the sensor's own description, a JSON"
    )
    out = capsys.readouterr().out
    assert line in out
    assert f"perception: {tmp_path / 'lidar.json'}: " in out


@pytest.mark.parametrize(
    ("page", "status", "words"),
    [
        ("{enabled: false}", 0, "note     page: none (page.enabled)"),
        ("{enabled: true, port: PORT}", 0, "ok       page: http://127.0.0.1:PORT\n"),
        ("{enabled: true, port: PORT, token_file: token}", 0, ":PORT, takes orders\n"),
        (
            "{enabled: true, port: PORT, token_file: token, host: 0.0.0.0}",
            0,
            "has no TLS, the network can read the token; use 127.0.0.1 and an SSH tunnel",
        ),
        ("{enabled: true, token_file: none}", 1, "page.token_file: is "),
    ],
)
def test_the_page_is_reported(capsys, tmp_path, unused_udp_port, page, status, words):
    token = tmp_path / "token"
    token.touch(mode=0o600)
    token.write_text("a-token-of-the-page")
    port = str(unused_udp_port)
    config = tmp_path / "companion.yaml"
    config.write_text(f"vehicle: {X500}\npage: {page.replace('PORT', port)}\n")
    assert check("--config", config) == status
    out = capsys.readouterr().out
    assert words.replace("PORT", port) in out
    assert "a-token-of-the-page" not in out


@pytest.mark.parametrize("place", ["a file", "stdout"])
def test_verdict_and_findings_are_written_as_json(capsys, tmp_path, place):
    report = "-" if place == "stdout" else tmp_path / "report.json"
    assert check("--vehicle", X500, "--json", report) == 0
    out, err = capsys.readouterr()
    document = json.loads(out if place == "stdout" else report.read_text())
    text = err if place == "stdout" else out
    assert document["verdict"] == "FILES OK"
    assert f"{document['summary']}\n" in text
    levels = {each["level"] for each in document["findings"]}
    assert levels <= {"ok", "note", "warning", "no-go"}
    assert all(f"{each['subject']}: {each['text']}" in text for each in document["findings"])


def test_an_unusable_file_is_in_the_json_too(capsys, tmp_path):
    assert check("--vehicle", "no.yaml", "--json", tmp_path / "report.json") == 2
    document = json.loads((tmp_path / "report.json").read_text())
    assert document["verdict"] == "NO-GO"
    assert document["findings"][0]["subject"] == "no.yaml"
    assert "no such file" in document["findings"][0]["text"]
