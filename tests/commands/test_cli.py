"""The command line as such: dispatch, errors as one line, exit status, the service's options."""

import subprocess
import sys
import types
from pathlib import Path

import pytest

from moar_companion.commands import cli
from moar_companion.errors import InputError, LinkError
from moar_companion.settings.config import CompanionConfig, shipped_configs
from moar_companion.settings.link_config import LinkConfig
from tests.one_line import one_line

SITE = str(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
PLAN = ["plan", SITE, "--mission", "inspection"]


def run(*arguments, **options):
    return subprocess.run(
        [sys.executable, "-m", "moar_companion", *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        **options,
    )


@pytest.fixture
def configs(monkeypatch):
    """The configurations that a service in place of the real one was run with."""
    seen = []

    def run_service(config, *, vehicle_named):
        seen.append(config)
        return 0

    module = types.ModuleType("moar_companion.service.app")
    module.run_service = run_service
    monkeypatch.setitem(sys.modules, "moar_companion.service.app", module)
    return seen


def raising(error):
    def command(_argv):
        raise error

    return command


@pytest.mark.slow
def test_plan_runs_as_a_program():
    result = run(*PLAN)
    assert result.returncode == 0
    assert result.stderr == ""
    assert "315 kV double circuit: inspection of splice-outer: found" in result.stdout


def test_an_error_of_the_program_is_one_line():
    result = run("plan", "no/such/site.yaml", "--mission", "inspection")
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr == "moar-companion: no/such/site.yaml: no such file\n"


@pytest.mark.parametrize("argv", [["--version"], ["--help"], ["plan", "--help"]])
def test_help_and_version_go_to_stdout(argv, capsys):
    assert cli.main(argv) == 0
    out, err = capsys.readouterr()
    assert "moar-companion" in out
    assert err == ""


def test_the_version_names_the_libraries_of_a_flight_and_no_others(capsys):
    cli.main(["--version"])
    names = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert names[:3] == ["moar-companion", "python", "linux"]
    assert {"numba", "numpy", "pymavlink", "scipy"} <= set(names)
    assert not {"pytest", "matplotlib", "ruff"} & set(names)


def test_help_names_every_command_and_shows_examples(capsys):
    cli.main(["--help"])
    out = capsys.readouterr().out
    assert "examples:" in out
    words = " ".join(out.split())
    assert all(f" {name} {item.summary}" in words for name, item in cli.COMMANDS.items())


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["fly"], ["fly", "is not a command", "plan"]),
        (["--sight", "x"], ["--sight", "x", "--help"]),
        (["--config"], ["--config", "expected one argument"]),
        (["--vehicle", ""], ["--vehicle", "''", "name of a file"]),
        (["--site", "a", "--site=b"], ["--site", "given twice"]),
        ([*PLAN, "--start", "1,1", "--start", "-2,2"], ["--start", "given twice"]),
        (["--connect", " "], ["--connect", "' '", "is not a link"]),
        (
            ["--connect", "udp:h:1", "--connect=udp:h:1"],
            ["--connect", "'udp:h:1'", "given twice"],
        ),
        (["--config", "nowhere.yaml"], ["nowhere.yaml", "no such file"]),
        (["--conf", "x"], ["--conf"]),
        (["plan"], ["plan", "SITE", "--mission", "required"]),
        ([*PLAN, "extra\nline"], ["extra line"]),
    ],
)
def test_wrong_usage_is_one_line_and_status_2(argv, words, capsys, configs):
    line = one_line(argv, 2, capsys)
    assert [word for word in words if word not in line] == []
    assert configs == []


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (InputError("file", "key", "is wrong"), 2, "file: key: is wrong"),
        (LinkError("udp:1: cannot be opened"), 1, "udp:1: cannot be opened"),
        (KeyboardInterrupt(), 1, None),
        (BrokenPipeError(), 1, None),
        (PermissionError(13, "Permission denied", "there"), 1, "there: Permission denied"),
        (MemoryError(), 1, cli._NO_MEMORY),
        (RuntimeError("can't start new thread"), 1, cli._NO_MEMORY),
        (RuntimeError("other"), 1, "unexpected error: RuntimeError: other"),
        (ZeroDivisionError("so\nwhat"), 1, "unexpected error: ZeroDivisionError: so what"),
    ],
)
def test_no_error_of_a_command_prints_a_traceback(error, status, line, monkeypatch, capsys):
    monkeypatch.setattr(cli, "_run", raising(error))
    assert cli.main([]) == status
    assert capsys.readouterr().err == (f"moar-companion: {line}\n" if line else "")


def test_a_lack_of_memory_behind_another_error_is_named(monkeypatch, capsys):
    error = RuntimeError("the last that went wrong")
    error.__context__ = MemoryError()
    monkeypatch.setattr(cli, "_run", raising(error))
    assert cli.main([]) == 1
    assert capsys.readouterr().err == f"moar-companion: {cli._NO_MEMORY}\n"


def test_an_interrupt_inside_compiled_code_is_an_interrupt(monkeypatch, capsys):
    error = SystemError("returned a result with an exception set")
    error.__cause__ = KeyboardInterrupt()
    monkeypatch.setattr(cli, "_run", raising(error))
    assert cli.main([]) == 1
    assert capsys.readouterr().err == ""


def test_the_service_without_options_has_the_shipped_vehicle_as_flown(configs):
    assert cli.main([]) == 0
    assert configs == [
        CompanionConfig(vehicle=shipped_configs() / "vehicles" / "linedrone_flight.yaml")
    ]


def test_the_command_line_overrides_the_file(configs, tmp_path):
    file = tmp_path / "companion.yaml"
    file.write_text(
        "vehicle: a.yaml\nsite: b.yaml\nlinks: [{url: 'udp:h:1'}]\nsetpoint_rate_hz: 20.0\n"
    )
    assert cli.main(["--config", str(file)]) == 0
    laid_over = ["--vehicle=v.yaml", "--site", "s.yaml", "--connect", "udp:h:2"]
    laid_over.append("--connect=serial:/dev/ttyTHS1:921600")
    assert cli.main([f"--config={file}", *laid_over]) == 0
    plain, over = configs
    assert (plain.vehicle, plain.site) == (tmp_path / "a.yaml", tmp_path / "b.yaml")
    assert (over.vehicle, over.site) == (Path("v.yaml"), Path("s.yaml"))
    assert over.links == (LinkConfig(url="udp:h:2"), LinkConfig(url="serial:/dev/ttyTHS1:921600"))
    assert over.setpoint_rate_hz == plain.setpoint_rate_hz == 20.0


def test_the_status_of_the_service_is_the_status_of_the_program(configs, monkeypatch):
    monkeypatch.setattr(sys.modules["moar_companion.service.app"], "run_service", lambda _: 1)
    assert cli.main([]) == 1


def test_a_negative_value_is_joined_to_its_option_only():
    assert cli._joined(["--start", "-1,2", "--velocity", "-.5,0"]) == [
        "--start=-1,2",
        "--velocity=-.5,0",
    ]
    untouched = ["--json", "-", "--start=1,2", "-1", "x", "--", "--start", "-1,2"]
    assert cli._joined(untouched) == untouched
