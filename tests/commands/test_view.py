"""`moar-companion view`, beside a real service and beside what is none."""

import contextlib
import json
import os
import pty
import select
import signal
import socket
import threading
import time

import pytest

from moar_companion.commands import cli
from moar_companion.settings.config import shipped_configs
from tests.processes import companion

PATIENCE_S = 60.0


@pytest.fixture
def folder(tmp_path_factory, monkeypatch):
    """The present folder; its path is short, as that of a socket has to be."""
    folder = tmp_path_factory.mktemp("here")
    monkeypatch.chdir(folder)
    return folder


@contextlib.contextmanager
def service(folder, *arguments, environment=None):
    """A service that has opened its links, and so its view."""
    notify_path = folder / "notify.sock"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(notify_path))
        manager.settimeout(PATIENCE_S)
        environment = {"NOTIFY_SOCKET": str(notify_path), **(environment or {})}
        with companion(
            *("--connect", "udpout:127.0.0.1:9"), *arguments, environment=environment
        ) as running:
            assert manager.recv(64) == b"READY=1"
            notify_path.unlink()
            yield running


def configured(folder, view_socket="view.sock"):
    """A configuration with a view."""
    vehicle = shipped_configs() / "vehicles" / "x500.yaml"
    configuration = folder / "companion.yaml"
    configuration.write_text(f"vehicle: {vehicle}\nview: {{socket: {view_socket}}}\n")
    return "--config", str(configuration)


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """The view socket of a service."""
    folder = tmp_path_factory.mktemp("view")
    with service(folder, *configured(folder)):
        yield str(folder / "view.sock")


@contextlib.contextmanager
def other_program(sent=b"", *, stays=True):
    """A program that is no companion on `view.sock`; it sends some data, then leaves or stays."""
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind("view.sock")
        listener.listen()
        done = threading.Event()

        def serve():
            caller, _ = listener.accept()
            with caller, contextlib.suppress(OSError):
                caller.sendall(sent)
                if stays:
                    done.wait(PATIENCE_S)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()


@pytest.fixture
def view(capfd):
    """Run the command in this process. Return its status and its output."""

    def run(*arguments):
        return cli.main(["view", *arguments]), *capfd.readouterr()

    return run


def test_once_prints_one_page_of_plain_text(view, served):
    status, page, errors = view(served, "--once")
    assert (status, errors) == (0, "")
    assert "\x1b" not in page
    assert page.startswith("moar-companion   no autopilot is received")
    assert "idle" in page


@pytest.mark.slow
def test_json_prints_statuses_until_the_service_ends(folder):
    with (
        service(folder, *configured(folder)) as serving,
        companion("view", "view.sock", "--json") as viewing,
    ):
        statuses = [json.loads(viewing.stdout.readline()) for _ in range(3)]
        assert {status["mission"]["state"] for status in statuses} == {"idle"}
        times_s = [status["time_s"] for status in statuses]
        assert times_s == sorted(set(times_s))
        serving.terminate()
        _, errors = viewing.communicate(timeout=PATIENCE_S)
        assert viewing.returncode == 1
        assert errors == "moar-companion: view.sock: the service has ended\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_into_a_pipe_the_view_prints_lines_until_it_is_interrupted(served, number):
    with companion("view", served) as viewing:
        assert "idle" in viewing.stdout.readline()
        viewing.send_signal(number)
        _, errors = viewing.communicate(timeout=PATIENCE_S)
        assert (viewing.returncode, errors) == (0, "")


@pytest.mark.slow
def test_into_a_pipe_a_service_that_hangs_is_distinguished_from_one_that_flies(folder):
    with (
        service(folder, *configured(folder)) as serving,
        companion("view", "view.sock") as viewing,
    ):
        assert "idle" in viewing.stdout.readline()
        serving.send_signal(signal.SIGSTOP)
        reported = next(line for line in viewing.stdout if "idle" not in line)
        assert reported.startswith("no data from the service for ")
        assert "no data from the service" in viewing.stdout.readline()
        serving.send_signal(signal.SIGCONT)
        assert "idle" in next(line for line in viewing.stdout if "no word" not in line)


def test_on_a_terminal_the_view_draws_pages_until_q_and_then_restores_the_terminal(served):
    ours, theirs = pty.openpty()
    with companion(
        "view", served, stdin=theirs, stdout=theirs, environment={"TERM": "xterm"}
    ) as viewing:
        shown = b""
        deadline_s = time.monotonic() + PATIENCE_S
        while b"q: end" not in shown and time.monotonic() < deadline_s:
            if select.select([ours], [], [], 0.1)[0]:
                shown += os.read(ours, 65_536)
        assert b"no autopilot is received" in shown
        os.write(ours, b"q")
        viewing.wait(PATIENCE_S)
        assert viewing.returncode == 0
        while select.select([ours], [], [], 0)[0]:
            shown += os.read(ours, 65_536)
    os.close(ours)
    os.close(theirs)
    entered, left = b"\x1b[?1049h", b"\x1b[?1049l"
    assert shown.rindex(left) > shown.index(entered)


@pytest.mark.slow
def test_under_systemd_the_view_is_in_its_runtime_directory(view, folder):
    (folder / "run").mkdir()
    with service(folder, environment={"RUNTIME_DIRECTORY": "run"}) as running:
        status, _, errors = view("run/view.sock", "--once")
        assert (status, errors) == (0, "")
        running.terminate()
        running.wait(PATIENCE_S)
    assert list((folder / "run").iterdir()) == []


def test_without_systemd_and_configuration_there_is_no_view(folder):
    with service(folder):
        names = {path.name for path in folder.iterdir()}
        assert "view.sock" not in names


@pytest.mark.slow
def test_a_second_service_leaves_the_view_to_the_first(view, served, folder):
    with service(folder, *configured(folder, served)) as second:
        second.terminate()
        _, errors = second.communicate(timeout=PATIENCE_S)
        assert f"WARNING no view: another program serves {served}\n" in errors
    assert view(served, "--once")[0] == 0


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("path", "reason"),
    [
        ("missing.sock", "no such socket: is the service running, and has it a view.socket?"),
        (".", "no service answers: is it running?"),
        ("x" * 200, "AF_UNIX path too long"),
    ],
)
def test_a_view_without_a_service_is_one_line(view, path, reason):
    status, output, errors = view(path)
    assert (status, output, errors) == (1, "", f"moar-companion: {path}: {reason}\n")


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    "sent",
    [
        b"hello\n",
        b"[]\n",
        b"\xff\xfe\n",
        b"x" * 2_000_000,
        b"[" * 200_000 + b"\n",
        b'{"mission": null}\n',
        b'{"mission": {"state": 3}, "risk": 3}\n',
    ],
    ids=["text", "a list", "no text", "no end", "deep", "null", "other keys"],
)
def test_another_program_on_the_socket_is_distinguished_from_a_service(view, sent):
    with other_program(sent):
        status, output, errors = view("view.sock")
    assert (status, output) == (1, "")
    assert errors == "moar-companion: view.sock: is served by another program\n"


@pytest.mark.usefixtures("folder")
def test_a_service_that_ends_before_its_first_status_is_reported(view):
    with other_program(b'{"mission"', stays=False):
        status, _, errors = view("view.sock", "--once")
    assert (status, errors) == (1, "moar-companion: view.sock: the service has ended\n")


@pytest.mark.parametrize(
    "arguments",
    [
        ("--once", "--json"),
        ("",),
        ("a.sock", "b.sock"),
        pytest.param(("--twice",), marks=pytest.mark.slow),
    ],
)
def test_a_wrong_command_line_is_one_line_and_status_2(view, arguments):
    status, output, errors = view(*arguments)
    assert (status, output) == (2, "")
    assert len(errors.splitlines()) == 1
