"""Files for ground stations: every order of a site as a button or a word. No I/O.

In: a site, the companion's component id. Out: texts by file name. The scripts are the files of
`order_scripts`, into which the orders are written: those run in other programs, not here.

Each order is one COMMAND_LONG (`mavlink/commands`). Param2 of an order without a place is -1: all
targets in turn, any landing point.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ..mavlink.commands import ORDER_MEANINGS, ORDERS
from ..planner.site import Site
from ..texts.text_format import coordinate
from ..types import Mission

_ANY = -1
_PLACEHOLDER = 'SITE, COMPONENT, ORDERS = "", 195, ()\n'
"""Line of each script that becomes the site's orders."""
_SCRIPTS = ("mavproxy_moar.py", "mission_planner_moar.py", "mavsdk_moar.py")


@dataclass(frozen=True, slots=True, kw_only=True)
class SiteOrder:
    """An order of a site: a word of `ORDERS`, and the place it leads to."""

    word: str
    meaning: str
    """One line for the operator."""
    place: str = ""
    """Name of the target, or index of the landing point; empty: all targets, any point, none."""
    index: int = _ANY
    """Param2: index of that place, 0-based."""

    @property
    def label(self) -> str:
        """Text of a button: unique on a site, and no name of a ground station's own action."""
        return f"MOAR {self.word}: {self.place}" if self.place else f"MOAR {self.word}"

    @property
    def command(self) -> int:
        """MAV_CMD."""
        return ORDERS[self.word][0]

    @property
    def params(self) -> tuple[float, float]:
        """Param1 and param2; the others are 0."""
        return ORDERS[self.word][1], float(self.index)


def orders_of(site: Site) -> tuple[SiteOrder, ...]:
    """Orders of a site, in the order of the buttons: those that stop first, the release last."""
    return (_order("hold"), _order("continue"), *_mission_orders(site), _order("release"))


def _order(word: str) -> SiteOrder:
    """An order without a place."""
    return SiteOrder(word=word, meaning=ORDER_MEANINGS[word])


def _mission_orders(site: Site) -> Iterator[SiteOrder]:
    for mission in Mission:
        word = mission.value
        if mission.visits_targets:
            places = {name: f"Inspect {name}, and hold" for name in site.target_names}
            every = "Inspect every target in turn, and hold at the last"
        else:
            places = {
                str(index): f"Fly to landing point {index}, {_place(point_m)}"
                for index, point_m in enumerate(site.landing_m.get(mission, ()))
            }
            every = "Fly to the landing point that costs least"
        if places:
            yield SiteOrder(word=word, meaning=every)
        for index, (place, meaning) in enumerate(places.items()):
            yield SiteOrder(word=word, place=place, index=index, meaning=meaning)


def _place(point_m: tuple[float, float]) -> str:
    return f"x {coordinate(point_m[0])} m, z {coordinate(point_m[1])} m"


def order_files(site: Site, component_id: int) -> dict[str, str]:
    """Texts by file name: QGroundControl's actions, and a script for each other ground station."""
    orders = orders_of(site)
    return {
        "qgroundcontrol.json": _qgroundcontrol(orders, component_id),
        **{name: _script(name, site.name, orders, component_id) for name in _SCRIPTS},
    }


def _qgroundcontrol(orders: tuple[SiteOrder, ...], component_id: int) -> str:
    """QGroundControl's custom actions, version 1.

    Keys as `MavlinkActionManager` of QGroundControl 5 reads them; without compId an action goes to
    the autopilot.
    """
    actions = [
        {
            "label": order.label,
            "description": order.meaning,
            "mavCmd": order.command,
            "compId": component_id,
            **{f"param{at}": value for at, value in enumerate(order.params, start=1)},
        }
        for order in orders
    ]
    document = {"version": 1, "fileType": "MavlinkActions", "actions": actions}
    return json.dumps(document, ensure_ascii=False, indent=4) + "\n"


def _script(name: str, site: str, orders: tuple[SiteOrder, ...], component_id: int) -> str:
    """A file of `order_scripts` with the orders in place of its placeholder."""
    text = (Path(__file__).parent / "order_scripts" / name).read_text(encoding="utf-8")
    rows = "".join(
        f"    ({', '.join(map(_literal, (each.label, each.word, each.place)))}, "
        f"{each.command}, {', '.join(map(repr, each.params))}),\n"
        for each in orders
    )
    table = (
        f"SITE = {_literal(site)}\n"
        f"COMPONENT = {component_id}\n"
        "ORDERS = (  # label, word, place, command, param1, param2\n"
        f"{rows})\n"
    )
    assert text.count(_PLACEHOLDER) == 1
    return text.replace(_PLACEHOLDER, table)


def _literal(text: str) -> str:
    """Python source of a text, ASCII alone: IronPython 2 reads names beyond it with a `u`."""
    return ascii(text) if text.isascii() else f"u{text!a}"
