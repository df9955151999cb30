"""`moar-companion report`: a flight's account, its page, match and copies of pictures."""

from __future__ import annotations

import html.parser
import json
from dataclasses import replace

import pytest
from mcap.writer import Writer
from PIL import ExifTags, Image

from moar_companion.analysis.inspection_report.flight_account import AccountBuilder
from moar_companion.analysis.inspection_report.picture_match import (
    PictureFile,
    exif_time_s,
    matched,
)
from moar_companion.analysis.inspection_report.report_page import Thumbnail, report_page
from moar_companion.commands import cli, picture_files
from moar_companion.planner.site import Polygon, Site
from moar_companion.service.recording.calls import START, Call, Start, call_encoded
from moar_companion.service.recording.schemas import CALLS
from moar_companion.settings.config import CompanionConfig, shipped_configs
from moar_companion.settings.vehicle import Vehicle
from tests.flights.cameras import with_views
from tests.one_line import one_line

CONFIGS = shipped_configs()
WIRES = Site.load(CONFIGS / "sites" / "315kv_double_circuit.yaml")
TOWER = Polygon(name="tower <leg>", vertices_m=((14.0, 0.0), (16.0, 0.0), (15.0, 3.0)))
VIEWED = with_views(replace(WIRES, obstacles=(*WIRES.obstacles, TOWER)))
SITE = replace(
    VIEWED, targets=(*VIEWED.targets, replace(WIRES.targets[0], name="in the open", look_at_m=None))
)
OUTER, INNER = "splice-outer/1", "splice-inner/1"
BEGAN_S = 1_795_000_000.0


def shot(seconds, number, stop=OUTER, *, count=1, marks=(), kind="picture", **more):
    """A row as the companion records it."""
    row = {
        "kind": kind,
        "time_s": BEGAN_S + seconds,
        "target": stop.partition("/")[0],
        "view": 1,
        "stop": stop,
        "marks": list(marks),
        "latitude_deg": -45.5,
        "longitude_deg": 71.25,
        "altitude_amsl_m": -3.5,
        "position_m": [26.5, 0.0, 11.0],
        "yaw_deg": 270.0,
        "camera_heading_deg": None,
        "camera_pitch_deg": -1.0,
        "aim_m": [22.68, 10.99],
        "aim_error_deg": 0.3,
        "distance_m": 4.0,
        "conductor_distance_m": 4.0,
        "risk": {"wind": 0.4, "battery": None},
        "wind_mps": None,
    }
    if kind == "picture":
        row |= {"number": number, "file": "", "camera_utc": None, "count": count}
    return row | more


SHOTS = [
    shot(10.0, 7, count=0, marks=["unsteady: 6 dps > 5"]),
    shot(13.0, 8),
    shot(16.0, 9, count=2),
    shot(18.0, None, kind="video", video_s=4.0),
]


def messages(shots=SHOTS):
    """A flight: the tour, one view captured, one left out, the exit."""

    def decision(seconds, kind, **data):
        time_s = BEGAN_S + seconds
        return "/decision", time_s, {"kind": kind, "time_s": time_s, "data": data}

    yield decision(0.0, "order", order="inspection")
    yield decision(1.0, "tour", stops=[OUTER, "in the open", INNER])
    yield decision(2.0, "text", text="MOAR: flying <fast>", reason="")
    for second in range(30):
        wall_s = BEGAN_S + second
        charge = {"0": {"remaining": 1.0 - 0.01 * second}, "1": {"remaining": None}}
        at = {8: OUTER, 9: OUTER, 20: "in the open", 23: "in the open"}.get(second)
        goal = {"state": "at_target" if at else "flying", "goal": at or 0}
        place_m = None if second == 3 else [27.0 - 0.1 * second, 0.0, 3.0]
        yield "/aircraft", wall_s, {"position_m": place_m}
        yield "/mission", wall_s, goal
        yield "/telemetry", wall_s, {"batteries": charge}
    for row in shots:
        time_s = row["time_s"]
        data = {key: value for key, value in row.items() if key not in ("kind", "time_s")}
        yield "/decision", time_s, {"kind": row["kind"], "time_s": time_s, "data": data}
    done = {"outcome": "done", "reason": "", "pictures": 2, "of": 2, "filmed": False}
    yield decision(28.0, "view", stop=OUTER, target="splice-outer", view=1, **done)
    yield decision(29.0, "left_out", stops=[INNER], reason="energy")


def account(rows=None, sent=None):
    builder = AccountBuilder()
    for message in messages() if sent is None else sent:
        builder.take(*message)
    return builder.account("flight", SITE, "X500", rows)


def flight(folder, *, site=SITE, sent=None):
    """A recording with these messages, and the call that has the site."""
    vehicle = Vehicle.load(CONFIGS / "vehicles" / "x500.yaml")
    start = Start(config=CompanionConfig(vehicle=CONFIGS), vehicle=vehicle, site=None)
    calls = [call_encoded(Call(method=START, arguments=(start,)))]
    if site is not None:
        ground = Call(method="take_ground", arguments=(site,))
        calls.append(call_encoded(ground))
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "flight.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(library="test")
        known = {}
        first = [(CALLS, BEGAN_S, {"time_s": 0.0, "calls": [call]}) for call in calls]
        for topic, wall_s, content in [*first, *(messages() if sent is None else sent)]:
            if topic not in known:
                schema = writer.register_schema(topic, "jsonschema", b"{}")
                known[topic] = writer.register_channel(topic, "json", schema)
            time_ns = round(wall_s * 1e9)
            writer.add_message(known[topic], time_ns, json.dumps(content).encode(), time_ns)
        writer.finish()
    return folder


# The account and its page


def test_the_account_tells_what_became_of_each_place_in_the_order_of_the_tour():
    visits = account().visits
    assert [(visit.target.name, visit.outcome, visit.reason) for visit in visits] == [
        (OUTER, "captured", ""),
        ("in the open", "visited", ""),
        (INNER, "left out", "energy"),
    ]
    assert [len(visit.shots) for visit in visits] == [4, 0, 0]
    assert [visit.held_s for visit in visits] == [1.0, 0.0, 0.0]
    assert [visit.done for visit in visits] == [True, True, False]


def test_a_place_that_is_ordered_again_is_not_left_out():
    again = {"state": "at_target", "goal": INNER}
    view = {"stop": INNER, "outcome": "done", "reason": ""}
    row = {"kind": "view", "time_s": 0, "data": view}
    sent = [*messages(), ("/mission", BEGAN_S + 40.0, again), ("/decision", BEGAN_S + 45.0, row)]
    assert account(sent=sent).visits[-1].outcome == "captured"


def test_a_view_that_failed_is_incomplete_with_its_reason():
    failed = {"kind": "view", "stop": INNER, "outcome": "failed", "reason": "card full"}
    sent = [item for item in messages() if item[2].get("kind") != "left_out"]
    sent.append(
        ("/decision", BEGAN_S + 30.0, {**failed, "kind": "view", "time_s": 0, "data": failed})
    )
    assert [visit.outcome for visit in account(sent=sent).visits][-1] == "incomplete"
    assert account(sent=sent).visits[-1].reason == "card full"
    assert account(sent=sent[:3]).visits[-1].outcome == "not visited"


def test_path_battery_and_texts_of_the_flight():
    flown = account()
    assert len(flown.path) == 29
    assert flown.battery[0] == (BEGAN_S, 1.0)
    assert len(flown.battery) == 15
    assert [text for _, _, text in flown.events] == ["order: inspection", "flying <fast>"]


def test_the_record_beside_the_recording_has_precedence():
    assert len(account(rows=[SHOTS[1]]).shots) == 1
    assert account(rows=[SHOTS[1]]).visits[0].outcome == "not visited"


class Checker(html.parser.HTMLParser):
    """Notes what a page loads, and tags that are not closed."""

    def __init__(self, page):
        super().__init__()
        self.open, self.sources, self.ids, self.links = [], [], set(), set()
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.sources += [given[key] for key in ("src", "srcset", "data") if key in given]
        self.ids |= {given["id"]} if "id" in given else set()
        self.links |= {given["href"]} if "href" in given else set()
        if tag not in {"meta", "img", "br"}:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_page_is_sound_and_loads_nothing():
    thumbnail = Thumbnail(jpeg_base64="AAAA", file="a<b>.jpg", copy="copies/a.jpg")
    page = report_page(account(), {1: thumbnail}, ["a note"])
    checked = Checker(page)
    assert checked.open == []
    assert checked.sources == ["data:image/jpeg;base64,AAAA"]
    assert {link.removeprefix("#") for link in checked.links if link[0] == "#"} <= checked.ids
    assert "copies/a.jpg" in checked.links
    assert "<script" not in page
    assert "url(" not in page
    assert "http" not in page.replace("http-equiv", "")
    for words in ("tower &lt;leg&gt;", "flying &lt;fast&gt;", "a&lt;b&gt;.jpg", "unsteady"):
        assert words in page
    for words in ("2 of 3", "2 of 4", "left out", "energy", "4 s of video", "wind 0.40"):
        assert words in page


def test_a_page_without_a_battery_or_a_flight_is_sound():
    page = report_page(account(sent=[]), {}, [])
    assert Checker(page).open == []
    assert "0 of 3" in page


def test_a_picture_of_a_place_that_the_site_has_no_more_is_shown():
    page = report_page(account(rows=[shot(1.0, 1, "old/1")]), {}, [])
    assert "Other pictures" in page


# Matching of pictures


def files(*names, times=None):
    taken = [None] * len(names) if times is None else times
    return [PictureFile(name=name, taken_s=at) for name, at in zip(names, taken, strict=True)]


def names_of(rows, given):
    return {index: file.name for index, file in matched(rows, given).items()}


def test_pictures_are_matched_by_their_names():
    rows = [shot(1.0, 1, file="/DCIM/IMG_2.JPG"), shot(2.0, 2, file="img_1.jpg")]
    assert names_of(rows, files("IMG_1.JPG", "sub/IMG_2.JPG")) == {
        1: "IMG_1.JPG",
        0: "sub/IMG_2.JPG",
    }


def test_pictures_are_matched_by_numbers_that_begin_anywhere():
    rows = [shot(float(number), number) for number in (0, 1, 2, 4)]
    given = files("DSC00117.JPG", "DSC00118.JPG", "DSC00119.JPG", "DSC00120.JPG", "DSC00122.JPG")
    found = names_of(rows, given)
    assert set(found) == {0, 1, 2, 3}
    offsets = {int(name[3:8]) - rows[index]["number"] for index, name in found.items()}
    assert len(offsets) == 1


@pytest.mark.parametrize("clock_s", [0.0, 3600.4, -7201.0])
def test_pictures_are_matched_by_time_whatever_the_cameras_clock(clock_s):
    rows = [shot(seconds, None) for seconds in (0.0, 7.0, 31.0)]
    times = [BEGAN_S + seconds + clock_s for seconds in (31.4, 0.2, 7.3, 500.0)]
    found = names_of(rows, files("c.jpg", "a.jpg", "b.jpg", "other.jpg", times=times))
    assert found == {0: "a.jpg", 1: "b.jpg", 2: "c.jpg"}


def test_pictures_without_name_number_or_time_are_not_matched():
    rows = [shot(0.0, None), shot(5.0, None)]
    assert names_of(rows, files("a.jpg", "b.jpg")) == {}
    assert names_of(rows, files("a.jpg", times=[BEGAN_S + 9e5])) in ({}, {0: "a.jpg"}, {1: "a.jpg"})
    assert names_of([], files("a.jpg")) == {}


def test_the_time_of_a_picture_is_read_from_exif():
    at_s = exif_time_s("2026:11:18 11:06:40", "25")
    assert at_s == 1_794_999_999.0 + 1.25
    assert exif_time_s("2026:11:18 11:06:40\0", "x") == 1_795_000_000.0
    assert exif_time_s("0000:00:00 00:00:00") is None
    assert exif_time_s("") is None


# The command


def jpeg(path, colour="red"):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (640, 480), colour).save(path)
    return path


def test_a_report_shows_the_pictures_and_copies_them_with_their_place(tmp_path, capsys):
    folder = flight(tmp_path / "flight")
    original = jpeg(tmp_path / "card" / "DCIM" / "DSC00008.JPG")
    before = original.read_bytes()
    jpeg(tmp_path / "card" / "DSC00009.JPG")
    jpeg(tmp_path / "card" / "DSC09000.png")
    (tmp_path / "card" / "DSC00007.JPG").write_bytes(b"cut")
    assert cli.main(["report", str(folder), "--pictures", str(tmp_path / "card")]) == 0
    out = capsys.readouterr().out
    assert "2 of 3 places done" in out
    assert "splice-inner/1: left out, energy" in out
    assert "2 of 3 pictures of the record have their file" in out
    assert "No sound pictures: DSC00007.JPG" in out
    page = (folder / "report.html").read_text()
    assert page.count("data:image/jpeg;base64,") == 2
    assert original.read_bytes() == before
    (copy,) = (folder / "report-pictures").glob("*DSC00008.JPG")
    with Image.open(copy) as picture:
        exif = picture.getexif()
    place, gps = exif.get_ifd(ExifTags.IFD.GPSInfo), ExifTags.GPS
    assert place[gps.GPSLatitude] == (45.0, 30.0, 0.0)
    assert (place[gps.GPSLatitudeRef], place[gps.GPSLongitudeRef]) == ("S", "E")
    assert place[gps.GPSAltitude] == 3.5
    assert place[gps.GPSAltitudeRef] == b"\x01"
    assert place[gps.GPSImgDirection] == 270.0
    taken = exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.DateTimeOriginal]
    assert taken == "2026:11:18 11:06:53"
    assert exif[ExifTags.Base.ImageDescription] == "splice-outer, view 1"


def test_a_copy_keeps_the_picture_of_each_kind_of_jpeg(tmp_path):
    noise = Image.effect_noise((320, 240), 80.0).convert("RGB")
    for name, options in (("JPEG", {}), ("MPO", {"save_all": True, "append_images": [noise]})):
        original, copy = tmp_path / f"{name}.jpg", tmp_path / f"{name}-copy.jpg"
        noise.save(original, name, quality=95, **options)
        assert picture_files.write_copy(original, copy, SHOTS[0])
        with Image.open(original) as before, Image.open(copy) as after:
            assert before.quantization == after.quantization


def test_odd_exif_of_a_camera_is_left_out(tmp_path):
    exif = Image.Exif()
    exif[ExifTags.Base.Make] = "camera"
    exif.get_ifd(ExifTags.IFD.GPSInfo)[1] = "N"
    original, copy = tmp_path / "a.jpg", tmp_path / "b.jpg"
    Image.new("RGB", (8, 8)).save(original, exif=exif)
    make, width = b"\x01\x0f\x00\x02", b"\x01\x00\x00\x02"
    original.write_bytes(original.read_bytes().replace(make, width))
    assert picture_files.thumbnail_base64(original)
    assert picture_files.write_copy(original, copy, SHOTS[0])
    with Image.open(copy) as picture:
        assert picture.getexif().get_ifd(ExifTags.IFD.GPSInfo)[2] == (45.0, 30.0, 0.0)


def test_a_report_takes_the_record_beside_the_recording(tmp_path, capsys):
    folder = flight(tmp_path)
    lines = [json.dumps(SHOTS[1]), '{"kind": "pict']
    (folder / "inspection.jsonl").write_text("\n".join(lines))
    out = tmp_path / "page.html"
    assert cli.main(["report", str(folder / "flight.mcap"), "--out", str(out)]) == 0
    assert f"wrote {out}" in capsys.readouterr().out
    assert "1 of 4" in out.read_text()


@pytest.mark.parametrize("case", ["folder", "record", "site", "pictures", "mcap"])
def test_bad_input_of_a_report_is_one_line(case, tmp_path, capsys):
    folder = flight(tmp_path / "flight", site=None if case == "site" else SITE)
    words, problem = ["report", folder], ""
    if case == "folder":
        words, problem = ["report", tmp_path], f"{tmp_path}: has no flight.mcap, must be a flight"
    elif case == "record":
        (folder / "inspection.jsonl").write_text("no\n{}\n")
        problem = f"{folder / 'inspection.jsonl'}: line 1: is no JSON"
    elif case == "site":
        problem = "has no site: nothing was inspected"
    elif case == "pictures":
        words += ["--pictures", tmp_path / "none"]
        problem = "must be a folder"
    else:
        (folder / "flight.mcap").write_bytes(b"no mcap")
        problem = "is no sound .mcap"
    assert problem in one_line(words, 2, capsys)
    assert not (folder / "report.html").exists()
