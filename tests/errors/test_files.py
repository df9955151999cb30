"""Files that are no configuration, through the commands that read them: one line, status 2."""

from __future__ import annotations

import copy
import json
import os

import pytest
import yaml

from moar_companion.commands import cli
from moar_companion.settings.config import shipped_configs
from tests.one_line import one_line

from .files import FILES

SITE = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
SHIPPED = SITE.read_text()


def bomb(first, each):
    """Aliases of aliases: eleven lines that stand for more than thirty thousand million values."""
    lines = [f"a0: &a0 {first}"]
    for index in range(1, 12):
        names = ", ".join([f"*a{index - 1}"] * 9)
        lines.append(f"a{index}: &a{index} {each % names}")
    return "\n".join(lines).encode()


CHANGES = {
    "with Windows line ends": lambda text: text.replace("\n", "\r\n").encode(),
    "with a byte order mark": lambda text: text.encode("utf-8-sig"),
    "without a last line end": lambda text: text.strip().encode(),
}
FORMS = {
    "empty": (b"", "is empty, must be a mapping with the keys name, "),
    "blank": (b"  \n\n", "is empty, must be a mapping with the keys name, "),
    "UTF-16": (SHIPPED.encode("utf-16"), "is not UTF-8 text (byte 0)"),
    "a picture": (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "is not UTF-8 text (byte 0)"),
    "zeros": (bytes(1000), "is not YAML: unacceptable character #x0000"),
    "a page of the web": (b"<!DOCTYPE html>\n<p>404</p>\n", "is '<!DOCTYPE html> <p>404</p>'"),
    "a recording": (b"\0\6\x44\x0c\xfd" * 100, "is not UTF-8 text (byte 4)"),
    "a table": (b"x_m,z_m\n1,2\n", "is 'x_m,z_m 1,2', must be a mapping"),
    "nested deeply": pytest.param(
        b"name: " + b"[" * 50_000, "is nested too deeply", marks=pytest.mark.slow
    ),
    "nested by blanks": (b"".join(b" " * i + b"a:\n" for i in range(1200)), "is nested too deeply"),
    "a bomb of aliases": (bomb("[1, 1, 1]", "[%s]"), "has more than 100000 values, aliases spelt"),
    "a bomb of merges": (
        bomb("{k: 1}", "{<<: [%s]}"),
        "has more than 100000 values, aliases spelt",
    ),
    "many keys": (
        b"".join(b"k%d: 1\n" % i for i in range(3000)),
        "k0: is not a known key, must be one of name, ",
    ),
    "with tabs": (
        SHIPPED.replace("  azimuth", "\tazimuth").encode(),
        "found a tab, must be blanks",
    ),
    "without a blank": (SHIPPED.replace("name: 3", "name:3").encode(), "found a key after text"),
    "with a decimal comma": (
        SHIPPED.replace("resolution_m: 0.3", "resolution_m: 0,3").encode(),
        "workspace: has '3' as a key (line ",
    ),
    "a vehicle": (
        (shipped_configs() / "vehicles" / "x500.yaml").read_bytes(),
        "autopilot: is not a known key, must be one of name, ",
    ),
    "too large for the memory": (
        SHIPPED.replace("resolution_m: 0.3", "resolution_m: 1e-9").encode(),
        "workspace.resolution_m: is 1e-09, which makes ",
    ),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_site_written_by_other_editors_is_read(change, tmp_path, capsys):
    path = tmp_path / "site.yaml"
    path.write_bytes(change(SHIPPED))
    assert cli.main(["plan", str(path), "--mission", "exit"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(("content", "problem"), FORMS.values(), ids=FORMS)
def test_a_file_that_is_no_site_is_refused_without_any_output_file(
    content, problem, tmp_path, capsys
):
    path = tmp_path / "site.yaml"
    path.write_bytes(content)
    line = one_line(
        ["plan", path, "--mission", "exit", "--json", tmp_path / "plan.json"], 2, capsys
    )
    assert line.startswith(f"{path}: ")
    assert problem in line
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_larger_than_any_site_is_refused_unread(tmp_path, capsys):
    path = tmp_path / "site.yaml"
    path.touch()
    os.truncate(path, 100_000_000_000)
    assert one_line(["plan", path, "--mission", "exit"], 2, capsys) == (
        f"{path}: is larger than 1000000 bytes"
    )


COMMANDS = {
    "plan SITE": ("site.yaml", ["plan", "{}", "--mission", "inspection"]),
    "plan --vehicle": (
        "vehicle.yaml",
        ["plan", SITE, "--mission", "exit", "--vehicle", "{}"],
    ),
    "replay --site": ("site.yaml", ["replay", "flight.tlog", "--site", "{}"]),
    "replay --vehicle": ("vehicle.yaml", ["replay", "flight.tlog", "--vehicle", "{}"]),
    "command --site": (
        "site.yaml",
        ["command", "inspection", "--target", "a", "--connect", "udp::1", "--site", "{}"],
    ),
    "the service's --config": ("companion.yaml", ["--config", "{}"]),
    "the service's --vehicle": ("vehicle.yaml", ["--vehicle", "{}", "--connect", "udp::1"]),
    "the service's --site": ("site.yaml", ["--site", "{}", "--connect", "udp::1"]),
}
WRONG = {
    "a value": (lambda content: {**content, "name": 3}, "name: is 3, must be text"),
    "a key": (lambda content: {**content, "nam": 3}, "nam: is not a known key"),
    "no file": (None, "no such file"),
    "a directory": ("", "is a directory, must be a file"),
}


@pytest.mark.parametrize(("file", "command"), COMMANDS.values(), ids=COMMANDS)
@pytest.mark.parametrize(("change", "problem"), WRONG.values(), ids=WRONG)
def test_every_command_that_reads_a_file_names_it_and_its_key(
    file, command, change, problem, tmp_path, capsys
):
    path = tmp_path / file
    if callable(change):
        content = copy.deepcopy(FILES[file][1])
        path.write_text(yaml.safe_dump(change(content), sort_keys=False))
    elif change is not None:
        path.mkdir()
    if file == "companion.yaml" and problem.startswith("name:"):
        problem = "name: is not a known key"
    line = one_line([str(word).format(path) for word in command], 2, capsys)
    assert line.startswith(f"{path}: {problem}")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
@pytest.mark.parametrize(("file", "command"), COMMANDS.values(), ids=COMMANDS)
def test_a_file_without_read_permission_is_one_line(file, command, tmp_path, capsys):
    path = tmp_path / file
    path.write_text("name: a")
    path.chmod(0)
    line = one_line([str(word).format(path) for word in command], 2, capsys)
    assert line == f"{path}: cannot be read: Permission denied"


WALL = {"polygon": {"name": "wall", "vertices_m": [[5, -1], [6, -1], [6, 99], [5, 99]]}}
ROCK = {"polygon": {"name": "rock", "vertices_m": [[2, 2], [8, 2], [8, 8], [2, 8]]}}
NO_PLAN = {
    "the start in an obstacle": ([ROCK], (5, 5), (20, 15), "start_occupied", "(5, 5)"),
    "the start outside": ([], (-5, 5), (20, 15), "out_of_bounds", "the start at (-5, 5)"),
    "the start too low": ([], (5, 1), (20, 15), "start_occupied", "too low"),
    "the target in an obstacle": ([ROCK], (20, 15), (5, 5), "target_occupied", "splice"),
    "the target outside": ([], (20, 15), (5, 500), "out_of_bounds", "splice"),
    "a wall between": ([WALL], (2, 15), (20, 15), "unreachable", "no free path"),
    "start and target outside": ([], (-5, 5), (50, 5), "out_of_bounds", "the start at (-5, 5)"),
}


@pytest.mark.parametrize(
    ("obstacles", "start", "target", "status", "words"), NO_PLAN.values(), ids=NO_PLAN
)
def test_no_plan_is_one_line_with_status_2_and_the_json_is_written(
    obstacles, start, target, status, words, tmp_path, capsys
):
    content = copy.deepcopy(FILES["site.yaml"][1])
    content["obstacles"] = obstacles
    content["start"] = {"x_m": start[0], "z_m": start[1]}
    content["targets"] = {"splice": {"x_m": target[0], "z_m": target[1]}}
    (tmp_path / "site.yaml").write_text(yaml.safe_dump(content))
    command_line = ["plan", str(tmp_path / "site.yaml"), "--mission", "inspection"]
    assert cli.main([*command_line, "--json", "-"]) == 2
    out, err = capsys.readouterr()
    answer = json.loads(out)
    assert answer["status"] == status
    assert (answer["states"], answer["waypoints"]) == ([], [])
    assert (answer["cost"], answer["metrics"]) == (None, None)
    assert err.startswith(f"moar-companion: no plan: {status}: ")
    assert words in err
    assert err[:-1].isprintable()
