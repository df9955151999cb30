"""`moar-companion page`: what it serves of a file, and the input that it refuses."""

from __future__ import annotations

import http.client
import json
import os
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from moar_companion.commands import cli
from moar_companion.settings.config import shipped_configs

DATA = Path(__file__).parents[1] / "data"
SITE = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
MCAP = DATA / "recordings" / "px4-1.17.0.mcap"
FAILSAFES = DATA / "ardupilot_failsafes.tlog"
PATIENCE_S = 60.0


@pytest.fixture
def refused(capsys):
    """Run the command; the one line of its refusal."""

    def run(*words):
        status = cli.main(["page", *map(str, words)])
        out, err = capsys.readouterr()
        assert (status, out, err.count("\n")) == (2, "", 1)
        return err

    return run


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as free:
        return free.getsockname()[1]


@pytest.fixture
def opened():
    """Starts the command; its answer to a request. It ends by a signal, with status 0."""
    started = []

    def start(*words):
        port = free_port()
        command = [sys.executable, "-m", "moar_companion", "page", *map(str, words)]
        process = subprocess.Popen(
            [*command, "--port", str(port)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        line = process.stdout.readline()
        assert line == f"page on http://127.0.0.1:{port}/ (Ctrl-C ends it)\n"

        def ask(path, body=None):
            client = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
            client.request("GET" if body is None else "POST", path, body=body)
            content = client.getresponse().read()
            client.close()
            return json.loads(content)

        return ask

    yield start
    for process, number in zip(started, (signal.SIGINT, signal.SIGTERM), strict=False):
        os.kill(process.pid, number)
        assert process.communicate(timeout=PATIENCE_S) == ("", "")
        assert process.returncode == 0


@pytest.mark.real_time
@pytest.mark.slow
def test_the_page_of_a_site_plans_what_if(opened):
    ask = opened(SITE)
    assert (ask("/api/page")["kind"], ask("/api/page")["orders"]) == ("site", False)
    assert ask("/api/site")["maps"]["columns"] == 100
    assert ask("/api/what-if", '{"mission": "exit"}')["plan"]["status"] == "found"
    assert ask("/api/recordings") == {"recordings": []}


@pytest.mark.real_time
@pytest.mark.slow
def test_the_page_of_a_recording_plays_it_back(opened):
    ask = opened(MCAP)
    about = ask("/api/page")
    assert (about["kind"], about["recording"]) == ("recording", MCAP.name)
    assert about["vehicle"]["name"] == "X500"
    assert ask("/api/site")["site"]["name"] == "315 kV double circuit"
    assert ask(f"/api/playback/{MCAP.name}")["duration_s"] == pytest.approx(40.0, abs=0.1)
    ask = opened(FAILSAFES, "--site", SITE)
    assert ask("/api/site")["site"]["name"] == "315 kV double circuit"
    frames = ask(f"/api/playback/{FAILSAFES.name}/frames?from=10&to=12")["frames"]
    assert len(frames) == 5


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["no.yaml"], r"^moar-companion: no\.yaml: no such file"),
        (["no.mcap"], r"^moar-companion: no\.mcap: no such file"),
        ([SITE, "--port", "0"], r"--port: is '0', must be a port, 1 to 65535"),
        ([SITE, "--port", "x"], r"--port: is 'x', must be a port"),
        ([SITE, "--host", "drone"], r"--host: is 'drone', must be an address of this computer"),
        ([SITE, "--site", SITE], r"--site: is '.*', must be left out: the page is of a site"),
        ([MCAP, "--site", SITE], r"--site: is '.*', must be left out: an \.mcap has its own"),
        ([MCAP, "--vehicle", "x"], r"--vehicle: is 'x', must be left out"),
        ([SITE, "--vehicle", "no.yaml"], r"no\.yaml: no such file"),
        ([Path(__file__)], r"is no recording, must be a \.tlog"),
        ([], r"the following arguments are required: SITE\|RECORDING"),
    ],
)
def test_a_wrong_file_or_option_is_one_line(refused, words, line):
    assert re.search(line, refused(*words))


def test_a_site_file_that_is_no_text_is_one_line(refused, tmp_path):
    site = tmp_path / "site.yaml"
    site.write_bytes(b"\xff\xfe")
    assert re.search(r"site\.yaml: is not UTF-8 text \(byte 0\)", refused(site))


def test_a_port_in_use_is_one_line(capsys):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        assert cli.main(["page", str(SITE), "--port", str(port)]) == 1
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert re.search(rf"page on 127\.0\.0\.1:{port}: .*in use", err)
