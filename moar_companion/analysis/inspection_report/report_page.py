"""The report of a flight as one HTML page: no script, no font and no picture from elsewhere. Pure.

Inputs: the flight's account, thumbnails by the index of their shot. Output: the page as text, for
light and dark screens and for paper.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from html import escape

from .flight_account import FlightAccount, Row, Visit
from .site_drawing import chart, place_drawing, site_drawing

_UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class Thumbnail:
    """A small picture. file: name of the original; copy: link to the copy with its place."""

    jpeg_base64: str
    file: str
    copy: str


def report_page(
    account: FlightAccount, thumbnails: Mapping[int, Thumbnail], notes: Iterable[str]
) -> str:
    """The page. thumbnails: by the index of the shot in `account.shots`. notes: on the pictures."""
    body = [
        _head(account),
        _tiles(account),
        _drawn_site(account),
        _targets(account),
        _places(account, thumbnails),
        _others(account, thumbnails),
        _missing(account),
        _flight(account),
        _notes(notes),
    ]
    title = escape(f"Inspection of {account.site.name}, {_day(account.began_s)}")
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark">'
        f"<style>{_STYLE}</style></head><body><main>{''.join(body)}</main></body></html>\n"
    )


def _head(account: FlightAccount) -> str:
    began = datetime.fromtimestamp(account.began_s, tz=timezone.utc)
    return (
        f"<header><h1>{escape(account.site.name)}</h1><p>Inspection flight of "
        f"{began:%Y-%m-%d, %H:%M} UTC, {_minutes(account.ended_s - account.began_s)}, with "
        f"{escape(account.vehicle)} <span class=quiet>({escape(account.name)})</span></p></header>"
    )


def _tiles(account: FlightAccount) -> str:
    visits = account.visits
    pictures = [row for row in account.shots if row["kind"] == "picture"]
    counted = sum(1 for row in pictures if row.get("count"))
    wanted = sum(visit.target.view.pictures for visit in visits if visit.target.view)
    done = sum(visit.done for visit in visits)
    marked = sum(bool(row.get("marks")) for row in account.shots)
    tiles = [
        (f"{done} of {len(visits)}", "places done", done == len(visits)),
        (f"{counted} of {wanted}", "pictures", counted >= wanted),
        (str(marked), "with a remark", marked == 0),
    ]
    if account.battery:
        first, last = account.battery[0][1], account.battery[-1][1]
        tiles.append((f"{first:.0%} → {last:.0%}", "battery", True))
    cells = "".join(
        f'<div class="tile {"good" if good else "bad"}"><b>{value}</b><span>{name}</span></div>'
        for value, name, good in tiles
    )
    return f'<div class="tiles">{cells}</div>'


def _drawn_site(account: FlightAccount) -> str:
    legend = (
        "Path as flown; numbers are the places below, in the order of the visits. Ring: distance "
        "that is kept from a conductor. Dashed: aim."
    )
    return (
        f'<section><h2>Site and flight</h2><figure class="site">{site_drawing(account)}'
        f"<figcaption>{legend}</figcaption></figure></section>"
    )


def _targets(account: FlightAccount) -> str:
    rows = "".join(
        f'<tr class="{"good" if visit.done else "bad"}"><td class=n><a href="#place-{number}">'
        f"{number}</a></td><td>{escape(visit.target.name)}</td><td>{_wanted(visit)}</td>"
        f"<td>{_captured(visit)}</td><td><b>{visit.outcome}</b>{_because(visit)}</td>"
        f"<td class=n>{visit.held_s:.0f} s</td></tr>"
        for number, visit in enumerate(account.visits, start=1)
    )
    return (
        "<section><h2>Targets</h2><div class=wide><table><thead><tr><th>#</th><th>place</th>"
        "<th>wanted</th><th>captured</th><th>result</th><th>stay</th></tr></thead>"
        f"<tbody>{rows}</tbody></table></div></section>"
    )


def _wanted(visit: Visit) -> str:
    view = visit.target.view
    if view is None:
        return f"stay of {visit.target.dwell_s:g} s"
    pictures = f"{view.pictures} picture{'s' if view.pictures != 1 else ''}"
    video = f"{view.video_s:g} s of video"
    return ", ".join(([pictures] if view.pictures else []) + ([video] if view.video_s else []))


def _captured(visit: Visit) -> str:
    pictures = [row for row in visit.shots if row["kind"] == "picture"]
    counted = sum(1 for row in pictures if row.get("count"))
    videos_s = sum(row.get("video_s", 0.0) for row in visit.shots if row["kind"] == "video")
    words = [f"{counted} picture{'s' if counted != 1 else ''}"] if pictures else []
    if len(pictures) > counted:
        words.append(f"{len(pictures) - counted} taken again")
    words += [f"{videos_s:.0f} s of video"] if videos_s else []
    return ", ".join(words) or "none"


def _because(visit: Visit) -> str:
    return f": {escape(visit.reason)}" if visit.reason else ""


def _places(account: FlightAccount, thumbnails: Mapping[int, Thumbnail]) -> str:
    """Each place with shots: its drawing, and beside it the pictures."""
    parts = []
    for number, visit in enumerate(account.visits, start=1):
        cards = "".join(
            _card(index, row, thumbnails.get(index))
            for index, row in enumerate(account.shots)
            if row["stop"] == visit.target.name
        )
        what = f"<h3>{number}. {escape(visit.target.name)}</h3>"
        empty = f"<p class=quiet>{visit.outcome}{_because(visit)}</p>"
        parts.append(
            f'<article id="place-{number}">{what}<div class="place"><figure class="detail">'
            f'{place_drawing(account, visit, number)}</figure><div class="cards">'
            f"{cards or empty}</div></div></article>"
        )
    return f"<section><h2>Pictures by place</h2>{''.join(parts)}</section>"


def _others(account: FlightAccount, thumbnails: Mapping[int, Thumbnail]) -> str:
    """Shots of places that the site does not have, as after a change of the file."""
    known = {visit.target.name for visit in account.visits}
    cards = "".join(
        _card(index, row, thumbnails.get(index))
        for index, row in enumerate(account.shots)
        if row["stop"] not in known
    )
    return (
        f"<section><h2>Other pictures</h2><div class=cards>{cards}</div></section>" if cards else ""
    )


def _card(index: int, row: Row, thumbnail: Thumbnail | None) -> str:
    """A shot: its picture, if there is one, and what was known of it."""
    number = row.get("number")
    name = f"Picture {number}" if row["kind"] == "picture" else "Video"
    picture = '<div class="none">no file</div>'
    if thumbnail is not None:
        source = f"data:image/jpeg;base64,{thumbnail.jpeg_base64}"
        picture = (
            f'<a href="{escape(thumbnail.copy)}"><img src="{source}" '
            f'alt="{escape(name)} of {escape(row["target"])}"></a>'
        )
        name += f", {thumbnail.file}"
    facts = [
        ("time", _clock(row["time_s"])),
        ("distance", _metres(row.get("distance_m"))),
        ("off the aim", _degrees(row.get("aim_error_deg"))),
        ("camera heading", _degrees(row.get("camera_heading_deg"))),
        ("camera elevation", _degrees(row.get("camera_pitch_deg"))),
        ("to the conductor", _metres(row.get("conductor_distance_m"))),
        ("wind", _speed(row.get("wind_mps"))),
        ("highest risk", _risk(row.get("risk") or {})),
    ]
    if row["kind"] == "video":
        facts.insert(1, ("length", f"{row.get('video_s', 0.0):.0f} s"))
    listed = "".join(f"<dt>{key}</dt><dd>{value}</dd>" for key, value in facts)
    marks = [*row.get("marks", ()), *([] if row.get("count", 1) else ["taken again"])]
    remark = f"<p class=mark>{escape(', '.join(marks))}</p>" if marks else ""
    caption = f"<figcaption><b>{escape(name)}</b>{remark}<dl>{listed}</dl></figcaption>"
    return f'<figure class="card" id="shot-{index}">{picture}{caption}</figure>'


def _missing(account: FlightAccount) -> str:
    """What was left out, and why."""
    items = "".join(
        f"<li><b>{escape(visit.target.name)}</b>: {visit.outcome}{_because(visit)}</li>"
        for visit in account.visits
        if not visit.done
    )
    content = f"<ul>{items}</ul>" if items else "<p>Nothing.</p>"
    return f"<section><h2>Left out</h2>{content}</section>"


def _flight(account: FlightAccount) -> str:
    """Battery, and texts and orders of the flight."""
    events = "".join(
        f"<tr class={kind}><td class=n>{_after(time_s - account.began_s)}</td>"
        f"<td>{escape(text)}</td></tr>"
        for time_s, kind, text in account.events
    )
    battery = ""
    if account.battery:
        drawing = chart(account.battery, account.began_s, "Charge of the battery over the flight")
        battery = f'<figure class="chart"><figcaption>Battery</figcaption>{drawing}</figure>'
    return (
        f"<section><h2>Flight</h2>{battery}<h3>Texts and orders</h3>"
        f"<table class=events><tbody>{events}</tbody></table></section>"
    )


def _notes(notes: Iterable[str]) -> str:
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return f"<footer><ul>{items}</ul></footer>" if items else ""


def _day(wall_s: float) -> str:
    return f"{datetime.fromtimestamp(wall_s, tz=timezone.utc):%Y-%m-%d}"


def _clock(wall_s: float) -> str:
    return f"{datetime.fromtimestamp(wall_s, tz=timezone.utc):%H:%M:%S} UTC"


def _minutes(duration_s: float) -> str:
    return f"{duration_s / 60.0:.1f} min"


def _after(duration_s: float) -> str:
    return f"{int(duration_s // 60)}:{int(duration_s % 60):02d}"


def _metres(value: float | None) -> str:
    return _UNKNOWN if value is None else f"{value:.1f} m"


def _degrees(value: float | None) -> str:
    return _UNKNOWN if value is None else f"{value:.1f}°"


def _speed(value: float | None) -> str:
    return _UNKNOWN if value is None else f"{value:.1f} m/s"


def _risk(risk: Mapping[str, float | None]) -> str:
    known = {name: value for name, value in risk.items() if value is not None}
    if not known:
        return _UNKNOWN
    name = max(known, key=lambda item: known[item])
    return f"{name} {known[name]:.2f}"


_STYLE = """
:root { --page: #f6f7f8; --card: #ffffff; --ink: #1b1d21; --quiet: #666b73; --line: #d9dce1;
  --good: #0a7f50; --bad: #b3261e; --path: #0b6fb8; --keep: #f4b183; --wire: #1b1d21;
  --solid: #7c828c; --space: #eef1f4; --aim: #9a5b00; }
@media (prefers-color-scheme: dark) { :root { --page: #14161a; --card: #1e2127; --ink: #e8eaee;
  --quiet: #9aa1ab; --line: #343943; --good: #4cc38a; --bad: #ff8a80; --path: #6cb6f5;
  --keep: #8a5a33; --wire: #f2f4f7; --solid: #6b7280; --space: #191c21; --aim: #e0a458; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink);
  font: 15px/1.45 system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
main { max-width: 1060px; margin: 0 auto; padding: 24px 20px 48px; }
h1 { font-size: 26px; margin: 0; } h2 { font-size: 19px; margin: 36px 0 10px; }
h3 { font-size: 16px; margin: 20px 0 8px; } header p { margin: 4px 0 0; }
.quiet, figcaption { color: var(--quiet); } a { color: inherit; }
.tiles { display: flex; flex-wrap: wrap; gap: 12px; margin-top: 18px; }
.tile { background: var(--card); border: 1px solid var(--line); border-radius: 8px;
  padding: 10px 16px; min-width: 130px; }
.tile b { display: block; font-size: 21px; } .tile span { color: var(--quiet); font-size: 13px; }
.tile.bad b { color: var(--bad); } .tile.good b { color: var(--good); }
figure { margin: 0; } figcaption { font-size: 13px; margin-top: 6px; }
.site, .detail, .card, .chart, table { background: var(--card); border: 1px solid var(--line);
  border-radius: 8px; }
.site, .chart { padding: 10px; } .chart { max-width: 460px; }
svg { display: block; width: 100%; height: auto; }
.wide { overflow-x: auto; }
table { border-collapse: separate; border-spacing: 0; width: 100%; font-size: 14px; }
th, td { text-align: left; padding: 6px 12px; border-bottom: 1px solid var(--line);
  vertical-align: top; }
tr:last-child td { border-bottom: 0; } th { color: var(--quiet); font-weight: 600; }
td.n { font-variant-numeric: tabular-nums; white-space: nowrap; }
tr.bad td b { color: var(--bad); } tr.good td b { color: var(--good); }
table.events td { padding: 3px 12px; } tr.order td { font-weight: 600; }
.place { display: flex; gap: 14px; align-items: flex-start; flex-wrap: wrap; }
.detail { flex: 0 0 230px; padding: 6px; } .cards { flex: 1 1 420px; display: grid; gap: 14px;
  grid-template-columns: repeat(auto-fill, minmax(230px, 1fr)); }
.card { overflow: hidden; } .card img { display: block; width: 100%; height: auto; }
.card .none { padding: 28px 0; text-align: center; color: var(--quiet);
  background: var(--space); }
.card figcaption { padding: 0 12px 12px; color: var(--ink); overflow-wrap: anywhere; }
dl { display: grid; grid-template-columns: auto 1fr; gap: 0 12px; margin: 6px 0 0; }
dt { color: var(--quiet); } dd { margin: 0; font-variant-numeric: tabular-nums; }
p.mark { color: var(--bad); margin: 4px 0 0; }
footer { margin-top: 32px; color: var(--quiet); font-size: 13px; } footer ul { padding-left: 18px; }
.space { fill: var(--space); stroke: var(--line); } .keep { fill: var(--keep); opacity: .45; }
.wire { fill: var(--wire); } .solid { fill: var(--solid); opacity: .8; }
.landing { fill: var(--good); } .path { fill: none; stroke: var(--path); stroke-width: 2.2; }
.aim { fill: none; stroke: var(--aim); stroke-width: 1.4; stroke-dasharray: 5 4; }
.shot { fill: var(--aim); } .mark { stroke: var(--card); stroke-width: 1.5; }
circle.done { fill: var(--good); } circle.open { fill: var(--bad); }
.number { fill: var(--card); font-size: 13px; font-weight: 700; text-anchor: middle; }
.grid { stroke: var(--line); } .line { fill: none; stroke: var(--path); stroke-width: 2; }
.name { fill: var(--quiet); font-size: 12px; text-anchor: middle; }
.tick { fill: var(--quiet); font-size: 11px; }
@media print {
  :root { --page: #fff; --card: #fff; --ink: #000; --quiet: #444; --line: #bbb; --good: #0a7f50;
    --bad: #b3261e; --path: #0b6fb8; --keep: #f4b183; --wire: #000; --solid: #7c828c;
    --space: #f4f5f7; --aim: #9a5b00; }
  body { font-size: 11pt; -webkit-print-color-adjust: exact; print-color-adjust: exact; }
  main { max-width: none; padding: 0; } article, .card, .site, tr { break-inside: avoid; }
  h2, h3 { break-after: avoid; } .detail { flex-basis: 190px; }
  .cards { grid-template-columns: repeat(2, 1fr); }
}
"""
