"""The broker of the configuration, with its certificates and its password read from their files."""

from __future__ import annotations

import ssl
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import InputError
from ..settings.mqtt_config import URL_FORMS, BrokerAddress, Mqtt, broker_address
from .secret_file import LONGEST_BYTES, SecretPlace, UnusableSecretError, secret_place
from .signing_key import read_key


@dataclass(frozen=True, slots=True, kw_only=True)
class Broker:
    """Address and identity of the connection. tls: None without TLS."""

    address: BrokerAddress
    tls: ssl.SSLContext | None = None
    username: str | None = None
    password: str | None = field(default=None, repr=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingNames:
    """Names of settings in errors: of a file's section, or of options."""

    source: str
    section: str = ""

    def refused(self, key: str, problem: str) -> InputError:
        """Returns the error of a setting."""
        if self.section:
            return InputError(self.source, f"{self.section}{key}", problem)
        option = "mqtt" if key == "url" else key.replace("_", "-")
        return InputError(f"--{option}", "", problem)


def read_broker(settings: Mqtt, names: SettingNames) -> Broker | None:
    """Returns the broker; None if the settings name none.

    Raises InputError for a certificate, key or password that cannot be used.
    """
    if settings.url is None:
        return None
    address = broker_address(settings.url)
    if address is None:
        raise names.refused("url", f"must be {URL_FORMS}")
    return Broker(
        address=address,
        tls=_context(settings, names) if address.tls else None,
        username=settings.username,
        password=_password(settings, names),
    )


def read_order_key(settings: Mqtt, source: str) -> bytes | None:
    """Returns the key of signed orders; None if no orders are taken. Raises InputError."""
    commands = settings.commands
    if not commands.accept:
        return None
    return read_key(
        secret_place(
            source,
            "mqtt.commands.",
            ("key_file", commands.key_file),
            ("credential", commands.credential),
        )
    )


def _context(settings: Mqtt, names: SettingNames) -> ssl.SSLContext:
    context = ssl.create_default_context()
    if settings.ca_file is not None:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        try:
            context.load_verify_locations(settings.ca_file)
        except (OSError, ssl.SSLError) as error:
            raise names.refused("ca_file", _unusable(settings.ca_file, error)) from error
    if settings.certificate_file is not None and settings.key_file is not None:
        place = SecretPlace(path=settings.key_file, source=names.source, key="")
        try:
            place.content()
        except (OSError, UnusableSecretError) as error:
            problem = place.refused(error).problem
            raise names.refused("key_file", problem) from error
        try:
            # An empty password keeps OpenSSL from asking for one on the terminal.
            context.load_cert_chain(settings.certificate_file, settings.key_file, password="")
        except (OSError, ssl.SSLError, ValueError) as error:
            problem = _unusable(settings.certificate_file, error)
            raise names.refused("certificate_file", problem) from error
    return context


def _unusable(path: Path, error: Exception) -> str:
    if isinstance(error, OSError) and not isinstance(error, ssl.SSLError):
        return f"is {str(path)!r}: {error.strerror}"
    reason = getattr(error, "reason", None) or "no certificate"
    words = str(reason).lower().replace("_", " ")
    return f"is {str(path)!r}, must be certificates in PEM with their key: {words}"


def _password(settings: Mqtt, names: SettingNames) -> str | None:
    if settings.password_file is None and settings.password_credential is None:
        return None
    place = secret_place(
        names.source,
        names.section,
        ("password_file", settings.password_file),
        ("password_credential", settings.password_credential),
    )
    try:
        return _password_in(place.content())
    except (OSError, UnusableSecretError) as error:
        refused = place.refused(error)
        if not names.section:
            refused = names.refused("password_file", refused.problem)
        raise refused from error


def _password_in(content: bytes) -> str:
    try:
        password = content.decode().removesuffix("\n").removesuffix("\r")
    except UnicodeDecodeError:
        raise UnusableSecretError("holds no text in UTF-8") from None
    if not password or "\n" in password or len(content) > LONGEST_BYTES:
        raise UnusableSecretError("holds no password, must be one line")
    return password
