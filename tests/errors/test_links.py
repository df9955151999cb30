"""Links that cannot be opened and aircraft that are absent: the errors for the user."""

from __future__ import annotations

import contextlib
import errno
import itertools
import json
import os
import pty
import socket
import threading

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.commands import cli
from moar_companion.settings.config import shipped_configs
from tests.one_line import one_line
from tests.processes import companion

_PATIENCE_S = 60.0
VEHICLE = shipped_configs() / "vehicles" / "x500.yaml"


@contextlib.contextmanager
def taken(kind=socket.SOCK_DGRAM):
    """A port on which another socket listens."""
    with socket.socket(socket.AF_INET, kind) as item:
        item.bind(("127.0.0.1", 0))
        yield item.getsockname()[1]


@contextlib.contextmanager
def service(*arguments):
    with companion(*arguments) as running:
        # Whoever waits for a line that never comes reads the end instead.
        patience = threading.Timer(_PATIENCE_S, running.kill)
        patience.start()
        try:
            yield running
        finally:
            patience.cancel()


def configured(folder, **keys):
    """The service's arguments for a configuration with some keys."""
    path = folder / "companion.yaml"
    path.write_text(json.dumps({"vehicle": str(VEHICLE), **keys}))
    return "--config", path


UNHAD = {
    "a serial device that is not there": (
        "serial:/dev/no-such-device:57600",
        "serial:/dev/no-such-device:57600: no such file or directory",
    ),
    "a device that is no serial port": (
        "serial:/dev/null:57600",
        "serial:/dev/null:57600: is no serial port",
    ),
    "a file that is no serial port": (
        f"serial:{VEHICLE}:57600",
        f"serial:{VEHICLE}:57600: is no serial port",
    ),
    "a directory for a serial port": ("serial:/:57600", "serial:/:57600: is a directory"),
    "a host that nobody knows": (
        "udpout:no-such-host.invalid:14550",
        "udpout:no-such-host.invalid:14550: the name is not found",
    ),
    "a TCP host that nobody knows": (
        "tcp:no-such-host.invalid:5760",
        "tcp:no-such-host.invalid:5760: the name is not found",
    ),
    "an address of another computer": (
        "udp:192.0.2.1:14550",
        "udpin:192.0.2.1:14550: is no address of this computer",
    ),
}


@pytest.fixture
def name_server(monkeypatch):
    """Knows no name ending in `.invalid`, also where there is no name server."""
    find = socket.getaddrinfo

    def answer(host, *arguments, **options):
        if str(host).endswith(".invalid"):
            raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")
        return find(host, *arguments, **options)

    monkeypatch.setattr(socket, "getaddrinfo", answer)


@pytest.mark.usefixtures("name_server")
@pytest.mark.parametrize("command", [[], ["check"]], ids=["the service", "check"])
@pytest.mark.parametrize(("url", "line"), UNHAD.values(), ids=UNHAD)
def test_a_link_that_cannot_be_opened_is_named_with_status_1(command, url, line, capsys):
    argv = [*command, "--connect", url]
    if not command:
        assert one_line(argv, 1, capsys) == line
    else:
        assert cli.main(argv) == 1
        out, err = capsys.readouterr()
        assert err == ""
        assert f"  no-go    link: {line}" in out


UNUSABLE = {
    "no port": ("udp:127.0.0.1", "has no port"),
    "a port without end": ("udp:127.0.0.1:" + "9" * 5000, "has no port"),
    "a port that does not fit": ("tcp:127.0.0.1:65536", "not in 1 to 65535"),
    "a baud rate that does not fit": ("serial:/dev/ttyS0:99999999", "not in 1 to 20000000"),
    "a host with an empty label": ("udpout:a..b:1", "neither a name nor an address"),
    "a host with a long label": (f"udpout:{'a' * 64}:1", "neither a name nor an address"),
    "a host with a blank": ("udp:my host:1", "neither a name nor an address"),
    "digits of another script": ("udp:127.0.0.1:١٤٥٥٠", "has no port"),
}


@pytest.mark.parametrize(("url", "problem"), UNUSABLE.values(), ids=UNUSABLE)
def test_an_invalid_url_is_named_as_option_and_as_key(url, problem, tmp_path, capsys):
    line = one_line(["--connect", url], 2, capsys)
    assert line.startswith(f"--connect: {url!r} ")
    assert problem in line
    arguments = configured(tmp_path, links=[{"url": "udp::14550"}, {"url": url[:90]}])
    line = one_line(arguments, 2, capsys)
    assert line.startswith(f"{arguments[1]}: links[1].url: {url[:90]!r} ")
    assert "allowed: udp:HOST:PORT" in line


LINKS = {
    "none": ([], "links: has none to an autopilot, must have one, or --connect be given"),
    "none to an autopilot": (
        [{"url": "udp::14550", "role": "operator"}],
        "links: has none to an autopilot, must have one, or --connect be given",
    ),
    "one twice in two spellings": (
        [{"url": "udp::14550"}, {"url": "udpin://0.0.0.0:14550"}],
        "links[1].url: 'udpin://0.0.0.0:14550' is given twice ('udp::14550'), must be given once",
    ),
}


@pytest.mark.parametrize(("links", "problem"), LINKS.values(), ids=LINKS)
def test_links_that_exclude_each_other_are_refused(links, problem, tmp_path, capsys):
    arguments = configured(tmp_path, links=links)
    assert one_line(arguments, 2, capsys) == f"{arguments[1]}: {problem}"


@pytest.mark.parametrize("named", ["udp::14551", "udp:127.0.0.1:14540"])
def test_a_link_with_authority_that_is_not_configured_is_named(named, tmp_path, capsys):
    links, commands = [{"url": "udp::14550"}], {"links": ["udp::14550", named]}
    arguments = configured(tmp_path, links=links, commands=commands)
    problem = f"commands.links[1]: is {named!r}, must be one of the links (udp::14550)"
    assert one_line(arguments, 2, capsys) == f"{arguments[1]}: {problem}"


def test_a_serial_port_in_use_by_another_program_is_named(capsys):
    first, second = pty.openpty()
    url = f"serial:{os.ttyname(second)}:57600"
    try:
        with service("--connect", url) as running:
            assert f"autopilot link on {url}" in running.stderr.readline()
            line = one_line(["--connect", url], 1, capsys)
    finally:
        os.close(first)
        os.close(second)
    assert line == f"{url}: in use by another program"


def test_an_absent_tcp_peer_is_reported_once_and_the_service_waits_for_it():
    with (
        taken(socket.SOCK_STREAM) as port,
        service("--connect", f"tcp:127.0.0.1:{port}") as running,
    ):
        assert running.stderr.readline() == f"WARNING tcp:127.0.0.1:{port}: connection refused\n"
        assert running.stderr.readline().startswith("INFO autopilot link on ")
        assert running.poll() is None


def test_a_missing_autopilot_is_reported_once_and_the_service_waits_for_it():
    with taken() as port:
        pass
    url = f"udp:127.0.0.1:{port}"
    with service("--connect", url) as running:
        assert running.stderr.readline().startswith("INFO autopilot link on ")
        assert running.stderr.readline() == (
            f"WARNING no autopilot received on {url} for 5 s; is it on, and does it send there?\n"
        )
        assert running.poll() is None
        running.terminate()
        assert running.communicate() == ("", "")
        assert running.returncode == 0


@pytest.mark.slow
def test_two_autopilots_are_both_named_in_the_log():
    with taken() as port:
        pass
    systems = itertools.cycle(
        mavlink.MAVLink(None, srcSystem=system, srcComponent=1) for system in (1, 2)
    )
    beat = mavlink.MAVLink_heartbeat_message(2, 12, 209, 0x00060000, 4, 3)
    url = f"udp:127.0.0.1:{port}"
    with (
        service("--connect", url) as running,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as aircraft,
    ):
        assert running.stderr.readline().startswith("INFO autopilot link on ")
        for codec in itertools.islice(systems, 4):
            aircraft.sendto(beat.pack(codec), ("127.0.0.1", port))
        reported = next((line for line in running.stderr if "two autopilots" in line), "")
    assert reported == "INFO MOAR: two autopilots, ids 1 and 2, no control\n"


@pytest.mark.parametrize("key", ["recorder", "state"])
def test_a_folder_that_cannot_be_written_is_named(tmp_path, capsys, key):
    (tmp_path / "file").touch()
    for folder, why in (("file/inside", errno.ENOTDIR), ("/proc/flights", errno.ENOENT)):
        arguments = configured(tmp_path, **{key: {"directory": folder}})
        assert one_line(arguments, 2, capsys) == (
            f"{arguments[-1]}: {key}.directory: is {str(tmp_path / folder)!r}, must be a folder "
            f"that can be written: {os.strerror(why)}"
        )


MUST_BE_FREE = "must be a free name in a folder that can be written"


def test_a_view_socket_that_cannot_be_made_is_named(tmp_path, capsys):
    (tmp_path / "file").touch()
    cases = {"file": "something else is there", "no/view.sock": os.strerror(errno.ENOENT)}
    for name, why in cases.items():
        arguments = configured(tmp_path, view={"socket": name})
        assert one_line(arguments, 2, capsys) == (
            f"{arguments[-1]}: view.socket: is {str(tmp_path / name)!r}, {MUST_BE_FREE}: {why}"
        )


def test_a_missing_socket_folder_of_systemd_is_named(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("RUNTIME_DIRECTORY", f"{tmp_path / 'no'}:{tmp_path}")
    assert one_line(configured(tmp_path), 2, capsys) == (
        f"RUNTIME_DIRECTORY: is {str(tmp_path / 'no' / 'view.sock')!r}, {MUST_BE_FREE}: "
        f"{os.strerror(errno.ENOENT)}"
    )


def test_a_folder_of_systemd_that_cannot_be_written_is_named(tmp_path, capsys, monkeypatch):
    (tmp_path / "file").touch()
    folder = tmp_path / "file" / "state"
    monkeypatch.setenv("STATE_DIRECTORY", f"{folder}:{tmp_path}")
    assert one_line(configured(tmp_path), 2, capsys) == (
        f"STATE_DIRECTORY: is {str(folder)!r}, must be a folder that can be written: "
        f"{os.strerror(errno.ENOTDIR)}"
    )
