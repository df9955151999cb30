"""The broker of the configuration: certificates, secrets, their permissions, and bad values."""

from __future__ import annotations

import pytest

from moar_companion.errors import InputError
from moar_companion.service.mqtt_settings import SettingNames, read_broker, read_order_key
from moar_companion.settings.config import CompanionConfig
from moar_companion.settings.mqtt_config import Mqtt, MqttCommands, broker_address

from ..mqtt.brokers import CERTIFICATES, private

NAMES = SettingNames(source="companion.yaml", section="mqtt.")
PASSWORD = "correct horse"


def broker(url="mqtt://10.0.0.2", **settings):
    return read_broker(Mqtt(url=url, vehicle="a1", **settings), NAMES)


def refusal(**settings):
    with pytest.raises(InputError) as raised:
        broker(**settings)
    assert PASSWORD not in str(raised.value)
    return str(raised.value)


def password_file(tmp_path, content=PASSWORD, mode=0o400):
    path = tmp_path / "password"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    path.chmod(mode)
    return path


@pytest.mark.parametrize(
    ("url", "address"),
    [
        ("mqtt://10.0.0.2", ("10.0.0.2", 1883, False)),
        ("mqtts://broker.example", ("broker.example", 8883, True)),
        ("mqtts://broker.example:443/", ("broker.example", 443, True)),
        ("mqtt://[::1]:1884", ("::1", 1884, False)),
    ],
)
def test_a_url_names_host_port_and_tls(url, address):
    found = broker_address(url)
    assert (found.host, found.port, found.tls) == address


@pytest.mark.parametrize(
    "url",
    [
        "10.0.0.2",
        "http://a",
        "mqtt://",
        "mqtt://a:0",
        "mqtt://a:70000",
        "mqtt://u:p@a",
        "mqtt://a/b",
    ],
)
def test_anything_else_is_no_url(url):
    assert broker_address(url) is None


def test_without_a_url_there_is_no_broker():
    assert read_broker(Mqtt(), NAMES) is None


@pytest.mark.parametrize("content", [PASSWORD, f"{PASSWORD}\n", f"{PASSWORD}\r\n"])
def test_a_password_is_read_and_shown_nowhere(tmp_path, content):
    found = broker(username="a1", password_file=password_file(tmp_path, content))
    assert found.password == PASSWORD
    assert PASSWORD not in repr(found)


@pytest.mark.parametrize("mode", [0o440, 0o404, 0o644, 0o602])
def test_a_password_file_that_other_users_can_read_is_refused(tmp_path, mode):
    path = password_file(tmp_path, mode=mode)
    assert refusal(username="a1", password_file=path) == (
        f"companion.yaml: mqtt.password_file: is '{path}': is open to group or others "
        f"(mode {mode:04o}), must be 0400"
    )


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("", "holds no password, must be one line"),
        (f"{PASSWORD}\n{PASSWORD}", "holds no password, must be one line"),
        (b"\xff\xfe", "holds no text in UTF-8"),
        ("x" * 5000, "holds no password, must be one line"),
    ],
)
def test_a_file_without_a_password_is_refused(tmp_path, content, reason):
    path = password_file(tmp_path, content)
    assert refusal(username="a1", password_file=path).endswith(f"is '{path}': {reason}")


def test_a_credential_of_systemd_comes_before_the_file(tmp_path, monkeypatch):
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path))
    (tmp_path / "mqtt-password").write_text("of systemd")
    found = broker(
        username="a1", password_credential="mqtt-password", password_file=tmp_path / "none"
    )
    assert found.password == "of systemd"


def test_tls_uses_the_authority_and_the_companions_certificate(tmp_path):
    found = broker(
        "mqtts://10.0.0.2",
        ca_file=CERTIFICATES / "authority.pem",
        certificate_file=CERTIFICATES / "vehicle.pem",
        key_file=private(tmp_path, "vehicle.key"),
    )
    assert found.tls.check_hostname
    assert [item["subject"] for item in found.tls.get_ca_certs()] == [
        ((("commonName", "authority"),),)
    ]


def test_certificates_that_cannot_be_used_are_named(tmp_path):
    key = private(tmp_path, "vehicle.key")
    assert refusal(url="mqtts://a", ca_file=tmp_path / "none").startswith(
        f"companion.yaml: mqtt.ca_file: is '{tmp_path / 'none'}': No such file"
    )
    assert "mqtt.ca_file" in refusal(url="mqtts://a", ca_file=key)
    assert "mqtt.certificate_file" in refusal(
        url="mqtts://a", certificate_file=CERTIFICATES / "intruder.pem", key_file=key
    )
    key.chmod(0o644)
    assert "mqtt.key_file" in refusal(
        url="mqtts://a", certificate_file=CERTIFICATES / "vehicle.pem", key_file=key
    )


def test_the_key_of_orders_is_read_only_where_orders_are_taken(tmp_path):
    key = tmp_path / "orders.key"
    key.write_bytes(b"k" * 32)
    commands = {"key_file": key}
    assert read_order_key(Mqtt(commands=MqttCommands(**commands)), "c") is None
    with pytest.raises(InputError, match=r"c: mqtt\.commands\.key_file: .* is open to group"):
        read_order_key(Mqtt(commands=MqttCommands(accept=True, **commands)), "c")
    key.chmod(0o400)
    assert read_order_key(Mqtt(commands=MqttCommands(accept=True, **commands)), "c") == b"k" * 32


@pytest.mark.parametrize(
    ("section", "reported"),
    [
        ("url: mqtt://a", "mqtt.vehicle: is missing"),
        ("{url: 'http://a', vehicle: a1}", "mqtt.url: is 'http://a', must be mqtt://HOST[:PORT]"),
        ("{url: 'mqtt://u:secret@a', vehicle: a1}", "mqtt.url: has another form, must be mqtt:"),
        ("{url: 'mqtt://a', vehicle: a/b}", "mqtt.vehicle: is 'a/b', must"),
        ("{url: 'mqtt://a', vehicle: a1, ca_file: c}", "mqtt.ca_file: is of TLS, which 'mqtt://a'"),
        ("{certificate_file: c}", "mqtt.key_file: is missing"),
        ("{key_file: c}", "mqtt.certificate_file: is missing"),
        ("{password_file: p}", "mqtt.username: is missing"),
        ("{commands: {accept: true}}", "mqtt.commands.accept: is true, must have a key"),
        ("{commands: {credential: a/b}}", "mqtt.commands.credential: is 'a/b', must be the name"),
    ],
)
def test_keys_that_exclude_each_other_are_reported(tmp_path, section, reported):
    path = tmp_path / "companion.yaml"
    body = f"mqtt: {section}" if section.startswith("{") else f"mqtt:\n  {section}"
    path.write_text(f"vehicle: v.yaml\n{body}\n")
    with pytest.raises(InputError) as raised:
        CompanionConfig.load(path)
    assert str(raised.value).startswith(f"{path}: {reported}")
    assert "secret" not in str(raised.value)
