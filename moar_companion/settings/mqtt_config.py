"""The section `mqtt` of the configuration: the broker, and this vehicle's name there.

Secrets are in files, which `service/mqtt_settings` reads.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field

from .yaml_file import HEXADECIMAL_KEY, FileFinding, shown

_PORTS = {"mqtt": 1883, "mqtts": 8883}
_URL = re.compile(r"(mqtts?)://(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+)(?::([0-9]{1,5}))?/?")
URL_FORMS = "mqtt://HOST[:PORT], or mqtts://HOST[:PORT] with TLS"
ORDER_LINK = "mqtt"
"""Name of the companion's link on which orders over MQTT come; no URL has this form."""
VEHICLE_NAME = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$"
"""One level of a topic: `/`, `+`, `#` and `$` have a meaning there."""


def _level(text: str) -> str:
    if not re.match(VEHICLE_NAME, text):
        raise ValueError("must be letters, digits, _ and -, 64 at most")
    return text


@dataclass(frozen=True, slots=True, kw_only=True)
class MqttCommands:
    """Orders over MQTT; the key is in a file or a credential, never here."""

    accept: bool = False
    """Signed orders are accepted over MQTT. Not by default: distant senders can reach a broker."""
    key_file: Path | None = None
    """The key of the orders, as `signing.key_file`."""
    credential: str | None = None
    """The same in a credential of systemd, as `signing.credential`."""
    window_s: Annotated[float, Field(ge=1.0, le=300.0)] = 10.0
    """Greatest difference between an order's time and this computer's clock."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mqtt:
    """Broker to which the companion publishes."""

    url: str | None = None
    """`mqtt://HOST[:PORT]` (1883), or `mqtts://HOST[:PORT]` (8883) with TLS; none: nothing is
    published."""
    vehicle: Annotated[str | None, AfterValidator(_level)] = None
    """Name in the topics `moar/<vehicle>/…`: letters, digits, `_`, `-`, 64 at most. Required with a
    URL, and another for each vehicle of a broker."""
    ca_file: Path | None = None
    """Certificates (PEM) to which the broker's must lead; none: those of the system."""
    certificate_file: Path | None = None
    """Our certificate, where the broker requires one."""
    key_file: Path | None = None
    """Its key, in a file of root or of the service's user that no other user can read."""
    username: str | None = None
    """User at the broker."""
    password_file: Path | None = None
    """The user's password, one line, in a file that no other user can read."""
    password_credential: str | None = None
    """The same in a credential of systemd (`LoadCredential=`): where systemd passes some it is
    taken in place of the file."""
    commands: MqttCommands = field(default_factory=MqttCommands)

    @property
    def takes_orders(self) -> bool:
        """True if orders come over MQTT."""
        return self.url is not None and self.commands.accept


@dataclass(frozen=True, slots=True)
class BrokerAddress:
    """Host and port of a broker."""

    host: str
    port: int
    tls: bool

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"mqtt{'s' if self.tls else ''}://{host}:{self.port}"


def broker_address(url: str) -> BrokerAddress | None:
    """The address in a URL; None if the URL has another form."""
    match = _URL.fullmatch(url)
    if match is None:
        return None
    scheme, host, port = match.groups()
    number = _PORTS[scheme] if port is None else int(port)
    if not 1 <= number <= 65_535:
        return None
    return BrokerAddress(host=host.strip("[]"), port=number, tls=scheme == "mqtts")


def mqtt_findings(section: Mqtt) -> Iterator[FileFinding]:
    """Errors across the keys of the section."""
    for keys, problem in _problems(section):
        yield FileFinding(("mqtt", *keys), problem)


def _problems(section: Mqtt) -> Iterator[tuple[tuple[str, ...], str]]:
    commands = section.commands
    if section.url is not None:
        address = broker_address(section.url)
        if address is None:
            # A password in the URL must not reach a log.
            what = "has another form" if "@" in section.url else f"is {section.url!r}"
            yield ("url",), f"{what}, must be {URL_FORMS}"
            return
        if section.vehicle is None:
            yield ("vehicle",), "is missing"
        for name in ("ca_file", "certificate_file", "key_file"):
            if getattr(section, name) is not None and not address.tls:
                yield (name,), f"is of TLS, which {section.url!r} is without: must be mqtts://"
    if (section.certificate_file is None) != (section.key_file is None):
        missing = "key_file" if section.key_file is None else "certificate_file"
        yield (missing,), "is missing"
    has_password = section.password_file is not None or section.password_credential is not None
    if has_password and section.username is None:
        yield ("username",), "is missing"
    if commands.accept and commands.key_file is None and commands.credential is None:
        must = "must have a key: mqtt.commands.key_file or .credential"
        yield ("commands", "accept"), f"is true, {must}"
    for keys, value in (
        (("password_credential",), section.password_credential),
        (("commands", "credential"), commands.credential),
        (("commands", "key_file"), commands.key_file),
    ):
        if value is None:
            continue
        if HEXADECIMAL_KEY.fullmatch(Path(value).name):
            yield keys, f"is {shown(str(value))}, must be the name of what has the key"
        elif keys[-1].endswith("credential") and Path(value).name != value:
            problem = f"is {value!r}, must be the name of a credential, without a folder"
            yield keys, problem
