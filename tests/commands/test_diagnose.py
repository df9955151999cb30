"""`moar-companion diagnose`: an archive with what there is, without passwords and keys."""

from __future__ import annotations

import shutil
import tarfile
from pathlib import Path

import pytest

from moar_companion.commands import diagnose
from moar_companion.commands.cli import main
from moar_companion.commands.diagnose import blanked

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.fixture
def state(tmp_path, monkeypatch):
    """The state folder of a computer on which no other program can be run."""
    monkeypatch.setattr(diagnose, "_STATE", tmp_path / "state")
    monkeypatch.setattr(diagnose, "DEFAULT_SOCKET", str(tmp_path / "view.sock"))
    monkeypatch.setattr(diagnose, "_output", lambda *command: f"output of {' '.join(command)}\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path / "state"


def contents(archive):
    """Content of the parts by their name."""
    with tarfile.open(archive) as file:
        return {
            member.name.partition("/")[2]: file.extractfile(member).read().decode()
            for member in file.getmembers()
        }


def flight(folder, *parts):
    folder.mkdir(parents=True)
    for part in parts:
        (folder / part).write_text(f'{{"kind": "text", "flight": "{folder.name}"}}\n')


def test_versions_configuration_check_log_and_the_last_flight_are_in_it(state, tmp_path, capsys):
    shutil.copytree(CONFIGS, tmp_path / "configs")
    flight(state / "flights/flight_20261127T100000.000000Z", "decisions.jsonl")
    last = state / "flights/flight_20261128T100000.000000Z"
    flight(last, "decisions.jsonl", "decisions-2.jsonl", "flight.tlog")
    assert main(["diagnose", "--config", "configs/companion.yaml", "--out", "fault.tar.gz"]) == 0
    found = contents("fault.tar.gz")
    assert found["versions.txt"].startswith("moar-companion ")
    assert "check --files --config configs/companion.yaml" in found["check.txt"]
    assert "--unit=moar-companion\n" in found["log.txt"]
    for name in ("companion.yaml", "linedrone_flight.yaml", "315kv_double_circuit.yaml"):
        (original,) = CONFIGS.rglob(name)
        assert found[f"configuration/{name}"] == original.read_text()
    assert {name for name in found if name.startswith("flight/")} == {
        "flight/decisions.jsonl",
        "flight/decisions-2.jsonl",
    }
    assert last.name in found["flight/decisions.jsonl"]
    # What is missing is named, there and in the list.
    assert "no such socket" in found["status.json"]
    assert "state/mission.json           no such file" in capsys.readouterr().out
    assert Path("fault.tar.gz").stat().st_mode & 0o077 == 0


def test_an_instance_has_its_own_configuration_unit_and_state(state, tmp_path, monkeypatch):
    monkeypatch.setattr(diagnose, "INSTALLED_CONFIG", tmp_path / "etc/companion.yaml")
    shutil.copytree(CONFIGS, tmp_path / "etc/second")
    flight(state / "second/flights/flight_20261128T100000.000000Z", "decisions.jsonl")
    assert main(["diagnose", "second"]) == 0
    (archive,) = tmp_path.glob("moar-diagnose-*.tar.gz")
    found = contents(archive)
    assert "--unit=moar-companion@second\n" in found["log.txt"]
    assert "configuration/linedrone_flight.yaml" in found
    assert "flight/decisions.jsonl" in found


def test_of_a_configuration_that_cannot_be_used_the_text_is_in_it_without_its_password(state):
    Path("bad.yaml").write_text("mqtt: {url: mqtt://me:hunter2@10.0.0.2, password: 'hunter2'}\n")
    assert main(["diagnose", "--config", "bad.yaml", "--out", "fault.tar.gz"]) == 0
    found = contents("fault.tar.gz")
    assert found["configuration/bad.yaml"] == (
        "mqtt: {url: mqtt://(blanked)@10.0.0.2, password: (blanked)}\n"
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("password: two, words\nport: 1\n", "password: (blanked)\nport: 1\n"),
        ('- api_token: "two words"  # a\n', "- api_token: (blanked)\n"),
        ("{port: 1, password: two words, id: 2}", "{port: 1, password: (blanked), id: 2}"),
        ('{"key": "a, b", "id": 2}', '{"key": (blanked), "id": 2}'),
        ("  key: |\n    abc\n    def\n  port: 1\n", "  key: (blanked)\n  port: 1\n"),
        ("passphrase:\n  abc\nport: 1\n", "passphrase: (blanked)\nport: 1\n"),
        (f"signed by {'0a' * 32}.", "signed by (blanked)."),
        ("mqtt://me:hunt/er@2@10.0.0.2 lost", "mqtt://(blanked)@10.0.0.2 lost"),
        (
            "https://t/{z}/{x}.png?access_token=ab1&v=2",
            "https://t/{z}/{x}.png?access_token=(blanked)&v=2",
        ),
        ('tile_url: "https://t/{z}.png?key=ab1"', 'tile_url: "https://t/{z}.png?key=(blanked)"'),
        ("{key: [1, 2], id: 2}", "{key: (blanked), id: 2}"),
        ('{password: "a\\"b, c", id: 2}', "{password: (blanked), id: 2}"),
        ("SetCredential=page-token:ab cd\n", "SetCredential=page-token:(blanked)\n"),
        (
            "SetCredentialEncrypted=a: \\\n  bcd \\\n  efg\nUser=x\n",
            "SetCredentialEncrypted=a:(blanked)\nUser=x\n",
        ),
        ('Environment=A=1 "MQTT_PASSWORD=a b"\n', 'Environment=A=1 "MQTT_PASSWORD=(blanked)\n'),
        ("#LoadCredential=page-token:/etc/t\n", "#LoadCredential=page-token:/etc/t\n"),
        # Names of files and credentials are no secrets, nor are words of a comment.
        ("key_file: null  # its key: a file\n", "key_file: null  # its key: a file\n"),
        ("key_file: /etc/k.key\n", "key_file: /etc/k.key\n"),
        ("password_credential: mqtt-password\n", "password_credential: mqtt-password\n"),
        ("udp://127.0.0.1:14540", "udp://127.0.0.1:14540"),
    ],
)
def test_values_of_passwords_and_keys_are_blanked_and_names_of_their_files_are_not(text, expected):
    assert blanked(text) == expected


@pytest.mark.parametrize("name", ["../etc", "a b", ""])
def test_a_name_that_no_instance_can_have_is_refused(name, capsys):
    assert main(["diagnose", name]) == 2
    assert "NAME" in capsys.readouterr().err
