"""`moar-companion docs`: the reference page and the schemas that the code describes.

Written into a checkout: `configs/reference.md`, `configs/schemas/`, and the schemas of the MQTT
payloads. With `--check` nothing is written, and the exit status is 1 where a file differs.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import yaml

from ..errors import InputError
from ..settings.input_file import open_file, unreadable

_PAGE = """\
# Reference

Made by `moar-companion docs`, from the code: do not edit. Guides: [configurations](README.md).

The unit of a number is in the name of its key. A key that is not listed here, a number in quotes,
a NaN or a key given twice is an error, reported in one line: the file, the key, the value, what is
allowed. Numbers are within ±1,000,000 unless the range says otherwise. Where the default is *none*,
`key:` without a value means the same. Exceptions: `vehicle` is needed, here or on the command line,
and a target needs one of its two forms. Editors with a YAML language server check a file that
names its [schema](schemas) in its first line, as those here do.

## Service

`companion.yaml`. Relative paths are relative to the file. The command line overrides it.

Guides: `links`, `commands`, `signing` ([who may command](guides/commanding.md)), `authority`,
`resume`, `supervision` ([in flight](guides/flight.md)), `supervision.position_uncertainty_m`
([margins](guides/margin.md)), `recorder` ([recordings](guides/recordings.md)), `perception`
([a lidar](guides/lidar.md)), `mqtt` ([MQTT](MQTT.md)), `page` ([the page](guides/page.md)).

{service}

## Vehicle

`vehicles/*.yaml`: [your vehicle](guides/vehicle.md), [the autopilot's limits](guides/autopilot.md).
Thresholds of the section `risk` are ranges `[low, high]`: the risk is 0 at the first and 1 at the
second, which may be the smaller one.

{vehicle}

## Site

`sites/*.yaml`: [your first site](guides/site.md). Positions are in the site's vertical plane:
`x_m` along the azimuth, `z_m` up.

{site}

## Orders

Commands to component 195: [guide](guides/flight.md#orders). param2 of MAV_CMD_USER_1:
{index}.

{orders}

## Messages of the companion

What component 195 publishes, and sends on MAV_CMD_REQUEST_MESSAGE. MAV_CMD_SET_MESSAGE_INTERVAL
sets an interval on the sender's link until the service ends. In brackets the interval on a serial
line below 160,000 baud. A message that takes a serial line over 20 ms is not sent there.

{published}

Values to plot; one that is unknown is not sent.

{values}

## Messages of the autopilot

Rates in Hz that the companion requests where they are not received; in brackets on a link that is
no serial port.

{messages}

## Parameters of the autopilot

Those on which a flight depends, by their names in each release, with the factor to the newest
one's unit. While one is not reported, its most cautious value counts, where there is one. Where
the last column says *no*, no inspection begins:
[guide](guides/autopilot.md#parameters-that-are-not-reported).

{parameters}

## Parameters of the companion

{count} settings of the service and the vehicle that may be set in flight, as parameters of
component 195, by a sender that may command; unit, default and range are those of the key. A value
that the file may not have, alone or beside the others, changes nothing. Weights, limits and
thresholds count at once; sizes, distances, speeds and guidance when maps for them are made, and
meanwhile the flight goes on. Values that were set stand above the files, also after a restart, and
below a vehicle file that the command line names. All are REAL32, but INT32 where the last column
has words; *none*: the number is not given.

{flight_parameters}

## MQTT topics

`moar/VEHICLE/TOPIC`: [guide](MQTT.md).

{topics}

## Channels of a recording

`flight.mcap`: [guide](guides/recordings.md).

{channels}

## Conditions

What may be flown, and what happens else: [guide](guides/flight.md#what-may-be-flown).

{conditions}

## Texts of conditions

With examples of numbers and names.

{condition_texts}

## Other texts

{texts}
"""
_PACKAGE = "moar_companion"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options."""
    parser.add_argument("checkout", nargs="?", default=".", metavar="DIR", help="the checkout")
    parser.add_argument("--check", action="store_true", help="write nothing; 1 if a file differs")


def run(arguments: argparse.Namespace) -> int:
    """Writes or checks all files; the exit status."""
    checkout = Path(arguments.checkout)
    if not (checkout / "configs" / "companion.yaml").is_file():
        raise InputError(arguments.checkout, "", "is no checkout of this program")
    differing = {path: text for path, text in _files(checkout) if not _has(path, text)}
    for path, text in differing.items():
        if not arguments.check:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        sys.stdout.write(f"{path}: {'differs from the code' if arguments.check else 'written'}\n")
    return 1 if arguments.check and differing else 0


def _files(checkout: Path) -> Iterator[tuple[Path, str]]:
    """Each file with its text."""
    from ..planner.site import SiteFile  # noqa: PLC0415
    from ..service.mqtt import schemas as mqtt  # noqa: PLC0415
    from ..settings.config import COMPANION_FILE  # noqa: PLC0415
    from ..settings.file_reference import json_schema, table  # noqa: PLC0415
    from ..settings.vehicle import VehicleFile  # noqa: PLC0415

    configs = checkout / "configs"
    service = COMPANION_FILE.schema
    tables = {"service": table(service), "vehicle": table(VehicleFile), "site": table(SiteFile)}
    tables |= {**_orders(), "messages": _messages(), "topics": _topics()}
    tables |= {"parameters": _parameters(), **_flight_parameters()}
    tables |= {"published": _published(), "values": _values()}
    tables |= {"channels": _channels(), "texts": _texts(), **_conditions()}
    yield configs / "reference.md", _PAGE.format(**tables)
    for name, model, example in (
        ("companion", service, "companion.yaml"),
        ("vehicle", VehicleFile, "vehicles/x500.yaml"),
        ("site", SiteFile, "sites/315kv_double_circuit.yaml"),
    ):
        schema = json_schema(model, name, _content(configs / example))
        yield configs / "schemas" / f"{name}.json", _json(schema)
    for file, text in mqtt.schemas().items():
        yield checkout / _PACKAGE / "service" / "mqtt" / "schemas" / file, text


def _content(path: Path) -> Any:
    """The content of a shipped file, an example."""
    try:
        with open_file(path) as file:
            return yaml.safe_load(file)
    except yaml.YAMLError:
        raise InputError(str(path), "", "is not YAML") from None
    except (OSError, ValueError) as error:
        raise InputError(str(path), "", unreadable(error)) from None


def _json(schema: dict[str, Any]) -> str:
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def _has(path: Path, text: str) -> bool:
    return path.is_file() and path.read_bytes() == text.encode()


def _table(head: str, rows: Iterable[str]) -> str:
    """A table in Markdown. head, rows: cells with bars between them."""
    return "\n".join([f"| {head} |", "|---" * (head.count("|") + 1) + "|", *rows])


def _orders() -> dict[str, str]:
    from ..mavlink.commands import INDEX_MEANING, ORDER_MEANINGS, ORDERS  # noqa: PLC0415
    from ..mavlink.dialect import mavlink  # noqa: PLC0415

    names = {number: item.name for number, item in mavlink.enums["MAV_CMD"].items()}
    orders = _table(
        "order | command | param1 | meaning",
        (
            f"| {word} | {names[command]} ({command}) | {param1:g} | {ORDER_MEANINGS[word]} |"
            for word, (command, param1) in ORDERS.items()
        ),
    )
    return {"orders": orders, "index": INDEX_MEANING}


def _published() -> str:
    from ..mavlink.component.published import PUBLISHED  # noqa: PLC0415

    def shown(period_s: float | None, slow_s: float | None) -> str:
        bracket = "" if slow_s is None else f" ({slow_s:g} s)"
        return "on request" if period_s is None else f"{period_s:g} s{bracket}"

    return _table(
        "message | content | interval",
        (
            f"| `{row.name}` | {row.about} | {shown(row.period_s, row.slow_period_s)} |"
            for row in PUBLISHED.values()
        ),
    )


def _values() -> str:
    from ..companion.mission_states import MissionState  # noqa: PLC0415
    from ..mavlink.component.named_values import NAMED_VALUES  # noqa: PLC0415

    states = ", ".join(f"{state.number} {state.words}" for state in MissionState)
    abouts = {name: row.about for name, row in NAMED_VALUES.items()}
    abouts["M_STATE"] += f": {states}"

    def message(whole: bool) -> str:
        return "NAMED_VALUE_INT" if whole else "NAMED_VALUE_FLOAT"

    return _table(
        "name | unit | meaning | message",
        (
            f"| `{row.name}` | {row.unit} | {abouts[row.name]} | {message(row.whole)} |"
            for row in NAMED_VALUES.values()
        ),
    )


def _messages() -> str:
    from ..mavlink.dialect import mavlink  # noqa: PLC0415
    from ..mavlink.message_rates import on_network, wanted_rates_hz  # noqa: PLC0415
    from ..types import AUTOPILOTS  # noqa: PLC0415

    serial = [wanted_rates_hz(kind) for kind in AUTOPILOTS]
    network = [on_network(rates) for rates in serial]

    def shown(number: int) -> Iterator[str]:
        for rates_hz, faster_hz in zip(serial, network, strict=True):
            rate, other = rates_hz.get(number), faster_hz.get(number)
            bracket = "" if other == rate else f" ({other:g})"
            yield "" if rate is None else f"{rate:g}{bracket}"

    names = {number: mavlink.mavlink_map[number].msgname for rates in serial for number in rates}
    return _table(
        f"message | {' | '.join(AUTOPILOTS)}",
        (f"| {name} | {' | '.join(shown(number))} |" for number, name in sorted(names.items())),
    )


def _parameters() -> str:
    from ..mavlink.autopilots import profile  # noqa: PLC0415
    from ..mavlink.autopilots.parameter_names import Name  # noqa: PLC0415
    from ..types import AUTOPILOTS  # noqa: PLC0415

    def shown(name: Name) -> str:
        since = "" if name.since == (0, 0, 0) else f" from {'.'.join(map(str, name.since))}"
        return f"`{name.name}`{since}{'' if name.scale == 1.0 else f' x {name.scale:g}'}"

    def rows() -> Iterator[str]:
        for kind in AUTOPILOTS:
            known = profile(kind)
            for row in map(known.parameters.row, known.flight_parameters):
                names = ", ".join(map(shown, row.all_names))
                counts = "" if row.cautious is None else f"{row.cautious:g}"
                yield f"| {kind} | {names} | {counts} | {'no' if row.denies else 'yes'} |"

    return _table("autopilot | parameter | counts as | an inspection begins", rows())


def _flight_parameters() -> dict[str, str]:
    """The table of the companion's own parameters, and their number."""
    from ..settings.flight_parameters import flight_parameters  # noqa: PLC0415

    rows = flight_parameters().values()
    table = _table(
        "parameter | key | meaning | values",
        (
            f"| `{row.name}` | `{row.key}` | {row.short_description} | {row.special_values} |"
            for row in rows
        ),
    )
    return {"flight_parameters": table, "count": str(len(rows))}


def _topics() -> str:
    from ..service.mqtt.payloads import Online, OrderPayload, Reply  # noqa: PLC0415
    from ..service.mqtt.topics import ONLINE, ORDER, REPLY, TOPICS  # noqa: PLC0415

    def row(name: str, kind: type, when: str, qos: int, *, retain: bool) -> str:
        about = " ".join((kind.__doc__ or "").partition("\n\n")[0].split())
        return f"| `{name}` | {about} | {when} | {qos} | {'yes' if retain else 'no'} |"

    rows = [row(ONLINE, Online, "connection, its end", 1, retain=True)]
    for item in TOPICS:
        when = "change" if item.period_s is None else f"{item.period_s:g} s"
        rows.append(row(item.name, item.payload, when, item.qos, retain=item.retain))
    rows.append(row(ORDER, OrderPayload, "order", 1, retain=False))
    rows.append(row(REPLY, Reply, "answer", 1, retain=False))
    return _table("topic | content | when | QoS | retained", rows)


def _channels() -> str:
    from ..service.recording.schemas import ABOUT  # noqa: PLC0415

    return _table(
        "channel | schema | content",
        (f"| `{name}` | `{schema}` | {about} |" for name, (schema, about) in ABOUT.items()),
    )


def _conditions() -> dict[str, str]:
    """The table of conditions, and that of their texts."""
    from ..companion.safety.condition_types import Action  # noqa: PLC0415
    from ..companion.safety.conditions import CONDITIONS  # noqa: PLC0415

    rows = ["| number | condition | starts when | action | acts after | clears | overridden by |"]
    rows.append("|---|---|---|---|---|---|---|")
    texts = ["| condition | text |", "|---|---|"]
    for number, row in enumerate(CONDITIONS, start=1):
        clears = "by a new order" if row.latched else _seconds("over for", row.over_s, "at once")
        if row.action is Action.RELEASE:
            clears = f"{row.rest.value} until a new order{' or `continue`' if row.passing else ''}"
        after = _seconds("", row.after_s, "at once")
        action = row.action.name.lower()
        rows.append(
            f"| {number} | `{row.name}` | {row.starts} | {action} | {after} | {clears} "
            f"| {row.override.value} |"
        )
        texts += [f"| `{row.name}` | `{text}` |" for text in row.examples]
    return {"conditions": "\n".join(rows), "condition_texts": "\n".join(texts)}


def _texts() -> str:
    from ..texts.pilot_texts import TEXTS  # noqa: PLC0415

    rows = ["| text | meaning | what can be done |", "|---|---|---|"]
    rows += [f"| `{text.example}` | {text.meaning} | {text.remedy} |" for text in TEXTS.values()]
    return "\n".join(rows)


def _seconds(word: str, seconds: float, none: str) -> str:
    return f"{word} {seconds:g} s".strip() if seconds else none
