"""Many flights: rows are kept, missing ones flown, all of them reported."""

from __future__ import annotations

import contextlib
import fcntl
import json
from concurrent.futures import Future

import pytest

from moar_companion.errors import InputError

from .campaign import batch, command
from .campaign.batch import ROWS, TABLE, fly_all, timed_row, write_table
from .campaign.report import report, summary
from .campaign.rows import schema, table_row
from .perceive import command as perceive_command

pa = pytest.importorskip("pyarrow")


class Here:
    """An executor that flies at once, in this process. killed_after: flights until an interrupt."""

    def __init__(self, killed_after=None):
        self.killed_after = killed_after
        self.flown = []

    def submit(self, function, fly, seed):
        future = Future()
        if self.killed_after is not None and len(self.flown) >= self.killed_after:
            future.set_exception(KeyboardInterrupt())
        else:
            self.flown.append(seed)
            future.set_result(function(fly, seed))
        return future


@pytest.fixture
def pool(monkeypatch):
    """Replace the processes; returns the function that sets the executor."""

    def use(executor):
        @contextlib.contextmanager
        def task_pool(_workers, scheduler):
            executor.scheduler = scheduler
            yield executor

        monkeypatch.setattr(batch, "task_pool", task_pool)
        monkeypatch.setattr(batch, "as_completed", lambda flights: flights)
        return executor

    return use


def fly(seed):
    if seed == 13:
        raise ValueError("no such flight")
    return {"seed": seed, "verdict": "kept"}, {f"broken-{seed}.png": b"picture"}


def test_a_second_call_flies_only_the_missing_seeds(pool, tmp_path):
    first = pool(Here())
    fly_all(fly, range(3, 6), tmp_path)
    assert first.flown == [3, 4, 5]
    second = pool(Here())
    rows = fly_all(fly, range(1, 8), tmp_path)
    assert second.flown == [1, 2, 6, 7]
    assert [row["seed"] for row in rows] == list(range(1, 8))
    assert (tmp_path / "broken-7.png").read_bytes() == b"picture"


def test_an_interrupted_run_keeps_all_flights_that_have_ended(pool, tmp_path):
    pool(Here(killed_after=2))
    with pytest.raises(KeyboardInterrupt):
        fly_all(fly, range(1, 6), tmp_path)
    again = pool(Here())
    fly_all(fly, range(1, 6), tmp_path)
    assert again.flown == [3, 4, 5]


def test_a_row_that_was_cut_by_a_kill_is_flown_again(pool, tmp_path):
    pool(Here())
    fly_all(fly, range(1, 4), tmp_path)
    journal = tmp_path / ROWS
    journal.write_bytes(journal.read_bytes()[:-7])
    again = pool(Here())
    rows = fly_all(fly, range(1, 4), tmp_path)
    assert again.flown == [3]
    assert [json.loads(line)["seed"] for line in journal.read_text().splitlines()] == [1, 2, 3]
    assert len(rows) == 3


def test_rows_of_another_state_of_the_code_are_refused(pool, tmp_path):
    pool(Here())
    fly_all(fly, range(1, 2), tmp_path)
    journal = tmp_path / ROWS
    journal.write_text(journal.read_text().replace(batch.code(), "0123456789ab"))
    with pytest.raises(InputError, match="has flights of another state of the code"):
        fly_all(fly, range(1, 2), tmp_path)


def test_a_folder_in_which_another_run_writes_is_refused(pool, tmp_path):
    pool(Here())
    with (tmp_path / ROWS).open("ab") as journal:
        fcntl.flock(journal, fcntl.LOCK_EX)
        with pytest.raises(InputError, match="another run writes there"):
            fly_all(fly, range(1, 2), tmp_path)


def test_a_flight_that_fails_is_a_row(pool, tmp_path):
    pool(Here())
    (row,) = fly_all(fly, [13], tmp_path)
    assert (row["verdict"], row["error"]) == ("error", "ValueError: no such flight")
    assert row.keys() >= {"seed", "code", "cpu_s"}
    assert timed_row(fly, 13)[1] == {}


@pytest.mark.parametrize(
    ("scheduler", "named"),
    [("tcp://a:1", "--scheduler: is 'tcp://a:1', its scheduler and workers must run in a checkout"),
     (None, "--workers: is 1, and a process ended: OSError: killed")],
)  # fmt: skip
def test_a_cluster_or_process_that_fails_is_one_line(pool, tmp_path, scheduler, named):
    class Failing(Here):
        def submit(self, *_):
            future = Future()
            future.set_exception(OSError("killed\nsecond line"))
            return future

    pool(Failing())
    with pytest.raises(InputError) as error:
        fly_all(fly, range(1, 4), tmp_path, scheduler=scheduler)
    assert named in str(error.value)
    assert "second" not in str(error.value)


def test_the_scheduler_is_given_all_flights_at_once(pool, tmp_path, monkeypatch):
    monkeypatch.setattr(batch, "_FLIGHTS_OF_A_PROCESS", 1)
    cluster = pool(Here())
    fly_all(fly, range(1, 4), tmp_path, scheduler="tcp://a:1")
    assert (cluster.scheduler, cluster.flown) == ("tcp://a:1", [1, 2, 3])


def test_a_worker_with_other_code_ends_the_run(pool, tmp_path):
    class Older(Here):
        def submit(self, function, fly, seed):
            row, files = function(fly, seed)
            future = Future()
            future.set_result(({**row, "code": "0123456789ab"} if seed == 4 else row, files))
            return future

    pool(Older())
    with pytest.raises(InputError, match=r"^--scheduler: .* one has another state of the code$"):
        fly_all(fly, range(3, 6), tmp_path, scheduler="tcp://a:1")
    kept = (tmp_path / ROWS).read_text().splitlines()
    assert [json.loads(line)["seed"] for line in kept] == [3]


def test_a_flight_that_has_ended_in_an_error_is_flown_again(pool, tmp_path):
    pool(Here())
    fly_all(fly, range(12, 15), tmp_path)
    again = pool(Here())
    rows = fly_all(lambda seed: ({"seed": seed, "verdict": "kept"}, {}), range(12, 15), tmp_path)
    assert again.flown == [13]
    assert [(row["seed"], row["verdict"]) for row in rows] == [
        (12, "kept"), (13, "kept"), (14, "kept"),
    ]  # fmt: skip
    last = pool(Here())
    assert fly_all(fly, range(12, 15), tmp_path) == rows
    assert last.flown == []


@pytest.mark.parametrize("main", [command.main, perceive_command.main])
@pytest.mark.parametrize(
    "words", [["--seeds", "5:2"], ["--seeds", "x"], ["--seeds", "1:3", "--workers", "0"]]
)
def test_seeds_and_workers_out_of_bounds_are_one_line(main, words, tmp_path, capsys):
    assert main([*words, "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{words[-2]}: is {words[-1]!r}, must be" in line
    assert not (tmp_path / "out").exists()


def test_seeds_are_a_range_or_one():
    assert (batch.seeds_of("3:5"), batch.seeds_of("7")) == (range(3, 5), range(7, 8))


WHY = "holding: x 2 > 1, holding"


def row(seed, verdict="kept", **changes):
    return {
        "seed": seed, "verdict": verdict, "site": "s", "vehicle": "x500", "manner": "px4",
        "firmware": "", "authority": "stream", "lidar": False, "signed": False, "whole": True,
        "wind_mps": 2.0, "faults": [{"kind": "gps_no_fix", "at_s": 2.0, "lasts_s": None}],
        "reached": verdict == "kept", "why": "" if verdict == "kept" else WHY,
        "violations": [{
            "rule": "collision", "value": -0.1, "time_s": 9.0, "state": "flying",
            "outside": ["wind"], "times": 2,
        }] if verdict != "kept" else [],
        "least_clearance_m": 0.5, "least_keep_out_m": -0.1, "greatest_step_mps": None,
        "greatest_error": 1.0, "controlled_s": 5.0, "within_s": 5.0, "states": ["flying"],
        "code": "c", "cpu_s": 3.0, **changes,
    }  # fmt: skip


ROWS_OF_ALL = [
    row(1), row(2, "outside"), row(3, "broken"), row(4, site="generated 4", manner="ardupilot"),
    {"seed": 5, "verdict": "error", "error": "ValueError: x", "code": "c", "cpu_s": 1.0},
]  # fmt: skip


def test_the_table_has_a_row_for_each_flight_and_the_violations_as_values(tmp_path):
    from pyarrow import parquet

    write_table([table_row(each) for each in ROWS_OF_ALL], tmp_path, schema())
    table = parquet.read_table(tmp_path / TABLE)
    assert table.schema == schema()
    assert table["verdict"].to_pylist() == ["kept", "outside", "broken", "kept", "error"]
    assert table["kinds"].to_pylist()[0] == ["gps_no_fix"]
    assert table["violations"].to_pylist()[1][0]["outside"] == ["wind"]
    assert table["reached"].to_pylist() == [True, False, False, True, None]


def test_a_table_without_a_schema_has_the_columns_of_all_rows(tmp_path):
    from pyarrow import parquet

    write_table([{"seed": 1, "error": "x"}, {"seed": 2, "sights": [[0.02, 9.0]]}], tmp_path)
    table = parquet.read_table(tmp_path / TABLE)
    assert table.column_names == ["seed", "error", "sights"]
    assert table["sights"].to_pylist() == [None, [[0.02, 9.0]]]


def test_the_columns_are_those_of_a_flown_row():
    import inspect

    names = {name for name in schema().names if f'"{name}"' in inspect.getsource(command._row)}
    own = {"code", "cpu_s", "verdict", "error", "kinds", "violations", "greatest_error",
           "least_clearance_m", "least_keep_out_m", "greatest_step_mps", "controlled_s",
           "within_s"}  # fmt: skip
    assert names | own == set(schema().names)


def test_the_report_is_one_document_with_plots_and_the_pictures_of_broken_flights(tmp_path):
    (tmp_path / "broken-3.png").write_bytes(b"picture")
    text = report(ROWS_OF_ALL, tmp_path)
    for title in (
        "Verdicts by autopilot", "Verdicts by kind", "Reasons of unreached goals", "broken-3",
        "Least distance to a keep-out",
    ):  # fmt: skip
        assert f"<h3>{title}</h3><img" in text.replace("\n", "")
    assert "http" not in text
    assert "holding: x # &gt; #, holding" in text


def test_the_summary_counts_verdicts_goals_and_what_is_outside():
    text = summary(ROWS_OF_ALL)
    assert "5 flights: 1 broken, 1 error, 2 kept, 1 outside." in text
    assert "goal was reached in 2 of them" in text
    assert "| collision | wind | 4 | 2: 2 3 |" in text
    assert "- seed 5: ValueError: x" in text
