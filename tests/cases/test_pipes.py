"""Pipes instead of files: refused in one line, as directories are; nothing waits for a writer."""

from __future__ import annotations

import os

import pytest

from moar_companion.commands.cli import main

CASES = {
    "site": ["plan", "{pipe}.yaml", "--mission", "exit"],
    "vehicle": ["plan", "{pipe}.yaml", "--mission", "exit", "--vehicle", "{pipe}.yaml"],
    "configuration": ["--config", "{pipe}.yaml"],
    "configuration of check": ["check", "--files", "--config", "{pipe}.yaml"],
    "recording": ["replay", "{pipe}.tlog"],
    "packed recording": ["replay", "{pipe}.mcap"],
    "cloud": ["site", "from-cloud", "{pipe}.xyz", "--at", "1,2", "--out", "site.yaml"],
    "capture": ["site", "from-cloud", "{pipe}.pcap", "--at", "1,2", "--out", "site.yaml"],
    "map": ["site", "from-map", "{pipe}.csv", "--out", "site.yaml"],
    "site to show": ["site", "show", "{pipe}.yaml", "--kml", "site.kml"],
}


@pytest.mark.timeout(20)
@pytest.mark.parametrize("arguments", CASES.values(), ids=CASES)
def test_a_pipe_is_refused_in_one_line(arguments, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    for ending in (".yaml", ".tlog", ".mcap", ".xyz", ".pcap", ".csv"):
        os.mkfifo(f"pipe{ending}")
    status = main([word.format(pipe="pipe") for word in arguments])
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert status == 2
    assert "pipe." in line
    assert "is a pipe, must be a file" in line or "is no file" in line
