"""Shell completion, as bash asks for it: the installed script, and its questions to the program."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from moar_companion.commands.cli import COMMANDS, main
from moar_companion.settings.config import shipped_configs
from tests.one_line import one_line

ROOT = Path(__file__).parents[2]
SITE = str(shipped_configs() / "sites" / "315kv_double_circuit.yaml")

COMPLETED_BY_BASH = """\
eval "$({python} -m moar_companion completion bash)"
moar-companion() {{ {python} -m moar_companion "$@"; }}
COMP_LINE={line!r}; COMP_POINT=${{#COMP_LINE}}; COMP_TYPE=9
_python_argcomplete moar-companion
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


def completions(line):
    """What bash offers at the end of a line."""
    script = COMPLETED_BY_BASH.format(python=sys.executable, line=line)
    result = subprocess.run(
        ["bash", "-c", script],
        stdout=subprocess.PIPE,
        text=True,
        timeout=60,
        check=True,
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(map(str, [ROOT, *sys.path]))},
    )
    return [word.strip() for word in result.stdout.split("\n") if word.strip()]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("moar-companion ch", ["check"]),
        ("moar-companion plan site.yaml --mission e", ["exit", "evacuation"]),
        (f"moar-companion plan {SITE} --target splice-i", ["splice-inner"]),
        ("moar-companion site from-m", ["from-map"]),
        ("moar-companion command rel", ["release"]),
        ("moar-companion --conf", ["--config"]),
        ("moar-companion plan site.yaml --qz", []),
    ],
)
def test_bash_offers_the_words_that_may_follow(line, offered):
    assert sorted(completions(line)) == sorted(offered)


@pytest.mark.slow
def test_all_commands_are_offered():
    assert set(COMMANDS) <= set(completions("moar-companion "))


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shell_has_its_script(shell, capsys):
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert "moar-companion" in script
    assert ("complete --command" in script) == (shell == "fish")


def test_another_shell_is_one_line(capsys):
    assert "'tcsh', must be one of bash, zsh, fish" in one_line(["completion", "tcsh"], 2, capsys)
