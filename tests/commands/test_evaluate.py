"""`moar-companion evaluate`: what it refuses, and that its files do not depend on the workers."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import Future
from functools import partial

import pytest

from moar_companion.analysis.evaluation import experiments, sensitivity
from moar_companion.analysis.evaluation.scenes import SWEPT
from moar_companion.commands import cli, evaluate
from moar_companion.commands.task_pool import run_tasks, task_pool


@pytest.fixture
def refused(capsys):
    """Run the command; the one line of its refusal."""

    def run(*words):
        status = cli.main(["evaluate", *map(str, words)])
        out, err = capsys.readouterr()
        assert (status, out, err.count("\n")) == (2, "", 1)
        return err

    return run


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["everything"], "experiment: is 'everything', must be one of maps, sensitivity"),
        (["maps", "--workers", "0"], "--workers: is '0', must be a whole number from 1"),
        (["maps", "--workers", "two"], "--workers: is 'two'"),
        (["campaign", "--seeds", "5"], "--seeds: is '5', must be A:B"),
        (["campaign", "--seeds", "9:5"], "--seeds: is '9:5', must be A:B"),
        (["maps", "--seeds", "1:5"], "--seeds: is '1:5', must be given with campaign alone"),
        (["campaign", "--scheduler", "tcp://a:1", "--workers", "2"], "--workers: is '2', must not"),
        (
            [],
            "the following arguments are required: maps|sensitivity|adaptability|tests|flight|all",
        ),
    ],
)
def test_a_wrong_argument_is_one_line(refused, words, named):
    assert named in refused(*words)


def test_without_the_extra_one_line_names_it_before_anything_is_written(tmp_path):
    missing = """\
import sys
sys.modules["pyarrow"] = None
from moar_companion.commands.cli import main
sys.exit(main())
"""
    done = subprocess.run(
        [sys.executable, "-c", missing, "evaluate", "maps", "--out", str(tmp_path / "out")],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stdout) == (2, "")
    install = f'{sys.executable} -m pip install "moar-companion[evaluation]"'
    assert done.stderr == f"moar-companion: evaluate: needs pyarrow: {install}\n"
    assert not (tmp_path / "out").exists()


def test_outside_a_checkout_the_flight_is_refused(refused, monkeypatch):
    pytest.importorskip("pyarrow")
    monkeypatch.setattr(evaluate, "_FLIGHT", "tests.flights.no_such_program")
    assert "evaluate: flight, all and campaign need a checkout" in refused("flight")


def test_outside_a_checkout_the_campaign_is_refused(refused, monkeypatch):
    pytest.importorskip("pyarrow")
    monkeypatch.setattr(evaluate, "_CAMPAIGN_PROGRAM", "tests.flights.no_such_program")
    assert "evaluate: flight, all and campaign need a checkout" in refused("campaign")


def test_the_campaign_is_flown_by_the_checkout_and_its_status_returned(monkeypatch, tmp_path):
    pytest.importorskip("pyarrow")
    calls = []

    def run(command, *, cwd, check):
        calls.append((command, cwd))
        return subprocess.CompletedProcess(command, 1)

    monkeypatch.setattr(evaluate.subprocess, "run", run)
    out = str(tmp_path / "flown")
    words = ["evaluate", "campaign", "--out", out, "--seeds", "7:9", "--scheduler", "tcp://a:1"]
    assert cli.main(words) == 1
    ((command, cwd),) = calls
    assert command[1:] == [
        "-m", "tests.flights.campaign", "--seeds", "7:9", "--out", out, "--scheduler", "tcp://a:1",
    ]  # fmt: skip
    assert (cwd / "tests" / "flights" / "campaign" / "__main__.py").exists()


def test_a_folder_that_cannot_be_made_is_refused(refused, tmp_path):
    pytest.importorskip("pyarrow")
    (tmp_path / "file").write_text("")
    assert "--out: is" in refused("maps", "--out", tmp_path / "file" / "folder")


@pytest.mark.slow
def test_a_scheduler_that_does_not_answer_is_refused(refused, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("moar_companion.commands.task_pool._CONNECT_S", 0.3)
    line = refused("maps", "--scheduler", "tcp://127.0.0.1:9", "--out", tmp_path / "out")
    assert "--scheduler: is 'tcp://127.0.0.1:9', no Dask scheduler" in line


class Backwards:
    """An executor that finishes the last task first."""

    def __init__(self):
        self.waiting = []

    def submit(self, function, *arguments):
        future = Future()
        self.waiting.append((future, partial(function, *arguments)))
        if len(self.waiting) == 3:
            for each, work in reversed(self.waiting):
                each.set_result(work())
        return future


def test_results_are_in_the_order_of_the_tasks_in_any_order_of_finishing():
    assert run_tasks("", [(divmod, (n, 2)) for n in range(3)], Backwards()) == [
        (0, 0), (0, 1), (1, 0),
    ]  # fmt: skip


def test_an_error_of_a_task_is_raised():
    with task_pool(1, None) as pool, pytest.raises(ZeroDivisionError):
        run_tasks("", [(divmod, (1, 0))], pool)


@pytest.mark.slow
def test_files_have_the_same_bytes_with_one_worker_and_with_two(tmp_path):
    pytest.importorskip("pyarrow")
    calls = [(sensitivity.sweep, (scene, 3)) for scene in SWEPT[:3]]
    written = []
    for workers in (1, 2):
        with task_pool(workers, None) as pool:
            results = experiments.Results(sensitivity=run_tasks("", calls, pool))
        files = {}
        for name, columns in experiments.columns(results).items():
            with (tmp_path / name).open("wb") as stream:
                evaluate._write_parquet(columns, stream)
            files[name] = (tmp_path / name).read_bytes()
        written.append(files)
    assert written[0] == written[1]
    assert len(written[0]) == 3


@pytest.mark.slow
def test_the_maps_are_drawn_into_a_folder_that_did_not_exist(tmp_path, capsys):
    pytest.importorskip("pyarrow")
    folder = tmp_path / "a" / "b"
    assert cli.main(["evaluate", "maps", "--out", str(folder), "--workers", "1"]) == 0
    assert capsys.readouterr().out == f"report: {folder / 'report.html'}\n"
    names = {f"fig2to5_env{n}.{kind}" for n in (1, 2, 3) for kind in ("png", "svg")}
    assert {file.name for file in folder.iterdir()} == {*names, "report.html"}
