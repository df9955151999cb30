"""The service's configuration: defaults, paths, what may not be in it, and what is shipped."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import BaseModel

from moar_companion.errors import InputError
from moar_companion.planner.site import Site
from moar_companion.settings.config import (
    COMPANION_FILE,
    Authority,
    Commands,
    CompanionConfig,
    RecorderSettings,
    Replanning,
    State,
    Supervision,
    shipped_configs,
)
from moar_companion.settings.link_config import KeySource, LinkConfig, LinkRole
from moar_companion.settings.page_config import PAGE_LINK
from moar_companion.settings.vehicle import Vehicle
from moar_companion.settings.yaml_file import model_of


def load(text: str, folder: Path) -> CompanionConfig:
    path = folder / "companion.yaml"
    path.write_text(text)
    return CompanionConfig.load(path)


def refusal(text: str, folder: Path) -> str:
    with pytest.raises(InputError) as raised:
        load(text, folder)
    return str(raised.value).removeprefix(f"{folder / 'companion.yaml'}: ")


def test_every_key_but_the_vehicle_has_a_default(tmp_path: Path) -> None:
    config = load("vehicle: v.yaml\n", tmp_path)
    assert config == CompanionConfig(vehicle=tmp_path / "v.yaml")
    assert (config.system_id, config.component_id) == (1, 195)
    assert config.authority is Authority.STREAM
    assert config.site is None
    assert not config.resume


def test_every_key_is_read(tmp_path: Path) -> None:
    text = """\
vehicle: /etc/moar/vehicle.yaml
site: sites/span.yaml
links:
  - {url: "serial:/dev/ttyTHS1:921600"}
  - {url: "udpin:0.0.0.0:14551", role: operator, signed: true}
system_id: 7
component_id: 196
authority: engage
setpoint_rate_hz: 20
resume: true
commands: {systems: [255], components: [190, 191], links: ["udp:a:1"], signed_only: true}
replanning: {period_s: 5, risk_change: 0.2, min_interval_s: 5}
supervision: {position_timeout_s: 1, heartbeat_timeout_s: 5, plane_tolerance_m: 1.5}
recorder: {directory: flights}
state: {directory: state}
signing: {key_file: signing.key, credential: mavlink}
"""
    assert load(text, tmp_path) == CompanionConfig(
        vehicle=Path("/etc/moar/vehicle.yaml"),
        site=tmp_path / "sites" / "span.yaml",
        links=(
            LinkConfig(url="serial:/dev/ttyTHS1:921600"),
            LinkConfig(url="udpin:0.0.0.0:14551", role=LinkRole.OPERATOR, signed=True),
        ),
        signing=KeySource(key_file=tmp_path / "signing.key", credential="mavlink"),
        system_id=7,
        component_id=196,
        authority=Authority.ENGAGE,
        setpoint_rate_hz=20.0,
        resume=True,
        commands=Commands(
            systems=(255,), components=(190, 191), links=("udp:a:1",), signed_only=True
        ),
        replanning=Replanning(period_s=5.0, risk_change=0.2, min_interval_s=5.0),
        supervision=Supervision(
            position_timeout_s=1.0, heartbeat_timeout_s=5.0, plane_tolerance_m=1.5
        ),
        recorder=RecorderSettings(directory=tmp_path / "flights"),
        state=State(directory=tmp_path / "state"),
    )


def path_keys(schema: type[BaseModel], before: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    for name, field in schema.model_fields.items():
        nested = model_of(field)
        if nested is not None:
            yield from path_keys(nested, (*before, name))
        elif "pathlib" in repr(field.annotation):
            yield (*before, name)


def test_every_relative_path_is_relative_to_the_folder_of_the_file(tmp_path: Path) -> None:
    keys = list(path_keys(COMPANION_FILE.schema))
    assert len(keys) >= 12
    file: dict[str, Any] = {"mqtt": {"url": "mqtts://h", "vehicle": "v", "username": "u"}}
    for *sections, name in keys:
        section = file
        for key in sections:
            section = section.setdefault(key, {})
        section[name] = f"below/{name}"
    config = load(yaml.safe_dump(file), tmp_path)
    for key in keys:
        assert functools.reduce(getattr, key, config) == tmp_path / "below" / key[-1], key


@pytest.mark.parametrize("source", ["key_file: signing.key", "credential: mavlink"])
def test_a_signed_link_needs_a_key(source: str, tmp_path: Path) -> None:
    text = """\
vehicle: v.yaml
links:
  - {url: "udp:127.0.0.1:14540"}
  - {url: "udp:127.0.0.1:14550", role: operator, signed: true}
"""
    assert refusal(text, tmp_path) == (
        "links[1].signed: is true, must have a key: signing.key_file or signing.credential"
    )
    assert load(f"{text}signing: {{{source}}}\n", tmp_path).links[1].signed


@pytest.mark.parametrize("name", ["../key", "/etc/key", "a/b"])
def test_a_credential_is_a_name_without_a_folder(name: str, tmp_path: Path) -> None:
    text = f"vehicle: v.yaml\nsigning: {{credential: {name}}}\n"
    assert refusal(text, tmp_path) == (
        f"signing.credential: is '{name}', must be the name of a credential, without a folder"
    )


DIGITS = "0a1B" * 16


@pytest.mark.parametrize("key", ["key_file", "credential"])
@pytest.mark.parametrize("folder", ["", "keys/", "/etc/"])
def test_a_key_in_place_of_the_name_of_its_file_is_refused_without_being_shown(
    key: str, folder: str, tmp_path: Path
) -> None:
    assert refusal(f"vehicle: v.yaml\nsigning: {{{key}: {folder}{DIGITS}}}\n", tmp_path) == (
        f"signing.{key}: is 64 hexadecimal digits (not shown), must be the name of what has the key"
    )


@pytest.mark.parametrize(
    "signing", ["{}", "{{key_file: ' {}'}}", "{{key: {}}}", "{{{}: 1}}", "{{credential: [{}]}}"]
)
def test_no_error_shows_a_text_that_may_be_a_key(signing: str, tmp_path: Path) -> None:
    problem = refusal(f"vehicle: v.yaml\nsigning: {signing.format(DIGITS)}\n", tmp_path)
    assert DIGITS[:8] not in problem


def test_a_configuration_without_links_takes_those_of_the_command_line(tmp_path: Path) -> None:
    assert load("vehicle: v.yaml\nlinks: []\n", tmp_path).links == ()


def test_the_vehicle_of_the_command_line_replaces_that_of_the_file(tmp_path: Path) -> None:
    for text in ("authority: observe\n", "authority: observe\nvehicle: other.yaml\n"):
        (tmp_path / "companion.yaml").write_text(text)
        config = CompanionConfig.load(tmp_path / "companion.yaml", vehicle="here.yaml")
        assert config.vehicle == Path("here.yaml")
        assert config.authority is Authority.OBSERVE


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        ("system_id: 0", "system_id: is 0, must be at least 1"),
        ("system_id: 256", "system_id: is 256, must be at most 255"),
        ("component_id: 1.0", "component_id: is 1.0, must be a whole number"),
        ("authority: fly", "authority: is 'fly', must be 'observe', 'stream' or 'engage'"),
        ("setpoint_rate_hz: 10", "setpoint_rate_hz: is 10, must be at least 20"),
        ("setpoint_rate_hz: 101", "setpoint_rate_hz: is 101, must be at most 100"),
        ("resume: 1", "resume: is 1, must be true or false"),
        ("links: [udp]", "links[0]: is 'udp', must be a mapping"),
        ("links: [{url: a, role: pilot}]", "links[0].role: is 'pilot', must be 'autopilot' or"),
        ("links: [{url: a}, {url: a}]", "links[1].url: is 'a', the same as links[0]: must be"),
        ("replanning: {min_interval_s: 3}", "replanning.min_interval_s: is 3, must be at most"),
        ("replanning: {risk_change: 0}", "replanning.risk_change: is 0, must be at least 0.001"),
        ("commands: {systems: [256]}", "commands.systems[0]: is 256, must be at most 255"),
        ("commands: {systems: []}", "commands.systems: has a length of 0, must be at least 1"),
        ("commands: {signed_only: 1}", "commands.signed_only: is 1, must be true or false"),
        ("commands: {system: 1}", "commands.system: is not a known key, did you mean systems?"),
        ("recorder: {folder: a}", "recorder.folder: is not a known key, must be one of enabled, "),
        ("recorder: {part_mb: 0}", "recorder.part_mb: is 0, must be at least 1"),
        ("supervison: {}", "supervison: is not a known key, did you mean supervision?"),
        ("vehicle: other.yaml", "vehicle: is given twice (lines 1 and 2), must be once"),
    ],
)
def test_what_the_configuration_may_not_hold(line: str, problem: str, tmp_path: Path) -> None:
    assert refusal(f"vehicle: v.yaml\n{line}\n", tmp_path).startswith(problem)


def test_the_vehicle_is_required(tmp_path: Path) -> None:
    assert refusal("authority: observe\n", tmp_path) == "vehicle: is missing"


def test_the_shipped_configuration_works_and_documents_the_defaults() -> None:
    config = CompanionConfig.load(shipped_configs() / "companion.yaml")
    assert config == CompanionConfig(vehicle=config.vehicle, site=config.site)
    assert Vehicle.load(config.vehicle).name == "LineDrone, as flown"
    assert config.site is not None
    assert Site.load(config.site).name == "315 kV double circuit"


def test_the_package_carries_the_configurations_of_the_checkout() -> None:
    checkout = Path(__file__).resolve().parents[2] / "configs"
    assert shipped_configs().resolve() == checkout
    assert sorted(path.name for path in checkout.iterdir()) == [
        "MQTT.md",
        "README.md",
        "SECURITY.md",
        "companion.yaml",
        "guides",
        "reference.md",
        "schemas",
        "sites",
        "vehicles",
    ]


def missing_keys(schema: type[BaseModel], written: object, where: str = "") -> Iterator[str]:
    """Keys of the schema that a file does not have; of a list, every item needs all keys."""
    if isinstance(written, list):
        for item in written:
            yield from missing_keys(schema, item, where)
        return
    assert isinstance(written, dict)
    for name, field in schema.model_fields.items():
        if name not in written:
            yield f"{where}{name}"
            continue
        inner = model_of(field)
        if inner:
            yield from missing_keys(inner, written[name], f"{where}{name}.")


def test_the_shipped_configuration_has_every_key() -> None:
    written = yaml.safe_load((shipped_configs() / "companion.yaml").read_text())
    assert list(missing_keys(COMPANION_FILE.schema, written)) == []
    del written["supervision"]["wind_limit_mps"], written["links"][0]["signed"], written["view"]
    assert set(missing_keys(COMPANION_FILE.schema, written)) == {
        "supervision.wind_limit_mps",
        "links.signed",
        "view",
    }


@pytest.mark.parametrize(
    ("page", "reason"),
    [
        ("{host: drone-1}", "page.host: is 'drone-1', must be an address of this computer"),
        ("{port: 0}", "page.port: is 0, must be at least 1"),
        ("{allowed_hosts: ['http://a']}", "page.allowed_hosts[0]: is 'http://a', must be the name"),
        ("{tile_url: 'https://a/b.png'}", "page.tile_url: is 'https://a/b.png', must be http"),
        ('{tile_url: "https://a/{z}/{x}/{y}\'; x"}', "page.tile_url: is "),
        ("{token_credential: a/b}", "page.token_credential: is 'a/b', must be the name of a"),
    ],
)
def test_a_wrong_key_of_the_page_is_named(page: str, reason: str, tmp_path: Path) -> None:
    assert refusal(f"vehicle: v.yaml\npage: {page}\n", tmp_path).startswith(reason)


def test_orders_of_the_page_have_a_link_where_it_has_a_token(tmp_path: Path) -> None:
    for section, takes in (
        ("{enabled: true, token_file: t}", True),
        ("{enabled: true, token_credential: t}", True),
        ("{enabled: true}", False),
        ("{token_file: t}", False),
    ):
        config = load(f"vehicle: v.yaml\npage: {section}\n", tmp_path)
        assert (PAGE_LINK in config.session_links) == takes
