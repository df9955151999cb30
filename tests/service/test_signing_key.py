"""The key of the signed links: its place, its permissions, and the errors about a bad key."""

from __future__ import annotations

import os

import pytest

from moar_companion.errors import InputError
from moar_companion.service.signing_key import read_signing_key
from moar_companion.settings.config import CompanionConfig
from moar_companion.settings.link_config import KeySource, LinkConfig

from ..mavlink.signed import SECRET

FORMS = "must be 32 bytes or 64 hexadecimal digits"


def config(tmp_path, *, signed=True, **source):
    return CompanionConfig(
        vehicle=tmp_path,
        links=(LinkConfig(url="udp:127.0.0.1:1", signed=signed),),
        signing=KeySource(**source),
        file=tmp_path / "companion.yaml",
    )


def key_file(tmp_path, content=SECRET, mode=0o400):
    path = tmp_path / "signing.key"
    path.write_bytes(content)
    path.chmod(mode)
    return path


def refusal(config):
    with pytest.raises(InputError) as raised:
        read_signing_key(config)
    assert SECRET.hex() not in str(raised.value)
    assert str(raised.value).startswith(f"{config.file}: signing.")
    return raised.value.problem


@pytest.mark.parametrize(
    "content",
    [
        SECRET,
        SECRET.hex().encode(),
        SECRET.hex().upper().encode() + b"\n",
        b" " + SECRET.hex().encode() + b"\r\n",
    ],
    ids=["bytes", "digits", "digits of a shell", "digits of an editor"],
)
@pytest.mark.parametrize("mode", [0o400, 0o600])
def test_a_key_is_read(tmp_path, content, mode):
    key = read_signing_key(config(tmp_path, key_file=key_file(tmp_path, content, mode)))
    assert key.secret == SECRET


def test_without_a_signed_link_no_key_is_read(tmp_path):
    assert read_signing_key(config(tmp_path, signed=False, key_file=tmp_path / "none")) is None


@pytest.mark.parametrize("mode", [0o440, 0o404, 0o640, 0o644, 0o620, 0o601])
def test_a_key_file_that_other_users_can_read_is_refused(tmp_path, mode):
    path = key_file(tmp_path, mode=mode)
    problem = refusal(config(tmp_path, key_file=path))
    assert problem == f"is '{path}': is open to group or others (mode {mode:04o}), must be 0400"


def test_a_key_file_of_another_user_is_refused(tmp_path, monkeypatch):
    path = key_file(tmp_path)
    owner = path.stat().st_uid
    monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    if owner == 0:
        assert read_signing_key(config(tmp_path, key_file=path)).secret == SECRET
        return
    problem = refusal(config(tmp_path, key_file=path))
    assert f"belongs to user {owner}, must belong to root or user {owner + 1}" in problem


def test_a_key_file_of_another_user_is_refused_to_root(tmp_path, monkeypatch):
    path, real = key_file(tmp_path), os.fstat

    def fstat(descriptor):
        values = list(real(descriptor))
        values[4] = os.geteuid() + 7
        return os.stat_result(values)

    monkeypatch.setattr(os, "fstat", fstat)
    assert "must belong to root or user" in refusal(config(tmp_path, key_file=path))


@pytest.mark.parametrize(
    ("content", "reported"),
    [
        (b"", f"holds no key (0 bytes), {FORMS}"),
        (SECRET[:-1], f"holds no key (31 bytes), {FORMS}"),
        (SECRET + b"\n", f"holds no key (33 bytes), {FORMS}"),
        (SECRET.hex().encode()[:-1] + b"g", f"holds no key (64 bytes), {FORMS}"),
        (SECRET.hex().encode()[:-2], f"holds no key (62 bytes), {FORMS}"),
        (SECRET * 1000, f"holds no key (over 4096 bytes), {FORMS}"),
        (bytes(32), "holds a key of zeros, must be random"),
        (b"0" * 64, "holds a key of zeros, must be random"),
    ],
)
def test_an_invalid_key_is_reported_in_one_line_without_its_bytes(tmp_path, content, reported):
    path = key_file(tmp_path, content)
    assert refusal(config(tmp_path, key_file=path)) == f"is '{path}': {reported}"


def test_a_missing_key_file_or_a_path_that_is_no_file_is_reported(tmp_path):
    missing = tmp_path / "missing"
    problem = refusal(config(tmp_path, key_file=missing))
    assert problem == f"is '{missing}': No such file or directory"
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe, 0o600)
    assert refusal(config(tmp_path, key_file=pipe)) == f"is '{pipe}': is no file"
    assert refusal(config(tmp_path, key_file=tmp_path)) == f"is '{tmp_path}': Is a directory"


def test_a_credential_is_read_with_any_file_mode(tmp_path, monkeypatch):
    """systemd gives it to its user by an access list, which shows as the group's rights."""
    key_file(tmp_path, mode=0o440)
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path))
    asked = config(tmp_path, credential="signing.key", key_file=tmp_path / "other")
    assert read_signing_key(asked).secret == SECRET


def test_without_credentials_the_file_is_read(tmp_path, monkeypatch):
    monkeypatch.delenv("CREDENTIALS_DIRECTORY", raising=False)
    asked = config(tmp_path, credential="moar", key_file=key_file(tmp_path))
    assert read_signing_key(asked).secret == SECRET


def test_a_credential_that_is_not_passed_is_reported(tmp_path, monkeypatch):
    asked = config(tmp_path, credential="moar")
    monkeypatch.delenv("CREDENTIALS_DIRECTORY", raising=False)
    problem = refusal(asked)
    assert problem == "is 'moar', must be passed by systemd: CREDENTIALS_DIRECTORY is not set"
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path))
    assert refusal(asked) == f"is '{tmp_path / 'moar'}': No such file or directory"
