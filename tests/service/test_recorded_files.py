"""Recordings that are deleted for new ones."""

import shutil
from pathlib import Path

from moar_companion.service.recorded_files import make_room, part_name


def recorded(directory, day, *names, size=100):
    folder = directory / f"flight_202611{day:02}T101112.000000Z"
    folder.mkdir(exist_ok=True)
    for name in names:
        (folder / name).write_bytes(bytes(size))
    return folder


def left(directory):
    return sorted(str(path.relative_to(directory)) for path in directory.glob("*/*"))


def test_parts_are_numbered_from_the_second_on():
    assert part_name("flight.mcap", 1) == "flight.mcap"
    assert part_name("decisions.jsonl", 12) == "decisions-12.jsonl"


def test_the_oldest_flights_go_first_then_the_oldest_parts_of_this_one(tmp_path):
    old = recorded(tmp_path, 1, "flight.tlog", "flight.mcap")
    now = recorded(tmp_path, 2, "flight.mcap", "flight-2.mcap", "flight-10.mcap")
    kept = [now / "flight-10.mcap"]
    make_room(tmp_path, kept, 350.0, 0.0)
    assert not old.exists()
    assert len(left(tmp_path)) == 3
    make_room(tmp_path, kept, 250.0, 0.0)
    assert [path.name for path in sorted(now.iterdir())] == ["flight-10.mcap", "flight-2.mcap"]
    make_room(tmp_path, kept, 0.0, 1e9)
    assert [path.name for path in now.iterdir()] == ["flight-10.mcap"]


def test_with_a_clock_that_is_behind_other_flights_go_before_parts_of_this_one(tmp_path):
    now = recorded(tmp_path, 1, "flight.mcap", "flight-2.mcap", "flight-3.mcap")
    other = recorded(tmp_path, 2, "flight.mcap", "flight-2.mcap")
    kept = [now / "flight-3.mcap"]
    make_room(tmp_path, kept, 350.0, 0.0)
    assert not other.exists()
    assert len(left(tmp_path)) == 3
    make_room(tmp_path, kept, 250.0, 0.0)
    assert [path.name for path in sorted(now.iterdir())] == ["flight-2.mcap", "flight-3.mcap"]


def test_as_much_goes_as_the_disk_is_short_of(tmp_path):
    recorded(tmp_path, 1, "flight.tlog", size=100)
    recorded(tmp_path, 2, "flight.tlog", size=100)
    recorded(tmp_path, 3, "flight.tlog", size=100)
    make_room(tmp_path, [], float("inf"), 150.0)
    assert [path.split("/")[0][:15] for path in left(tmp_path)] == ["flight_20261103"]


def test_a_flight_that_a_person_removes_meanwhile_does_not_count(tmp_path, monkeypatch):
    old = recorded(tmp_path, 1, "flight.tlog")
    recorded(tmp_path, 2, "flight.tlog")
    listed = Path.iterdir

    def removed_first(folder):
        if folder == old:
            shutil.rmtree(old)
        return listed(folder)

    monkeypatch.setattr(Path, "iterdir", removed_first)
    make_room(tmp_path, [], 50.0, 0.0)
    assert left(tmp_path) == []


def test_files_of_other_programs_stay(tmp_path):
    folder = recorded(tmp_path, 1, "flight.tlog", "notes.txt", "flight.png")
    (tmp_path / "flight_plan").mkdir()
    (tmp_path / "flight_plan" / "flight.tlog").write_bytes(bytes(100))
    (tmp_path / "flight_20261101T101112.000000Z.mcap").write_bytes(bytes(100))
    make_room(tmp_path, [], 0.0, 1e9)
    assert sorted(path.name for path in folder.iterdir()) == ["flight.png", "notes.txt"]
    assert (tmp_path / "flight_plan" / "flight.tlog").exists()
    assert (tmp_path / "flight_20261101T101112.000000Z.mcap").exists()
