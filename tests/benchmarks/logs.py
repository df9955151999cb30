"""The risk indices over recordings: `.venv/bin/python -m tests.benchmarks.logs DIR`.

Draws every recording beside the checkout like `moar-companion replay --plot`. Prints a line of
figures for each: the range of every index, and the input that decided its greatest value.
`logs.md` has the results.
"""

from __future__ import annotations

import sys
from pathlib import Path

from moar_companion.analysis.pictures.replay_picture import draw_replay
from moar_companion.analysis.replay.replay_report import Replay
from moar_companion.commands.replay import played
from moar_companion.errors import InputError
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.vehicle import Vehicle
from tests.mavlink.conftest import SHARED

FOLDERS = ("traces/ardupilot", "traces/px4", "data/mavlink_tlog", "data/px4_ulog")
SUFFIXES = (".tlog", ".tlog.gz", ".ulg")


def line(replay: Replay) -> str:
    """Least to greatest of each index, and what decided the greatest."""
    words = []
    for name in replay.samples[0].risk:
        known = [
            (value, sample) for sample in replay.samples if (value := sample.risk[name]) is not None
        ]
        if not known:
            words.append(f"{name} unknown")
            continue
        values = [value for value, _ in known]
        greatest, sample = max(known, key=lambda item: item[0])
        words.append(f"{name} {min(values):.2f}-{greatest:.2f} ({sample.why[name] or 'held'})")
    return "; ".join(words)


def main() -> None:
    directory = Path(sys.argv[1])
    directory.mkdir(parents=True, exist_ok=True)
    vehicle = Vehicle.load(shipped_configs() / "vehicles" / "linedrone.yaml")
    for folder in FOLDERS:
        for path in sorted((SHARED / folder).glob("*")):
            if not path.name.endswith(SUFFIXES):
                continue
            try:
                replay = played(str(path), vehicle)
            except InputError as error:
                sys.stdout.write(f"{path.name}: {error.problem}\n")
                continue
            picture = directory / f"{folder.replace('/', '_')}_{path.name}.png"
            with picture.open("wb") as stream:
                draw_replay(replay, stream)
            sys.stdout.write(f"{path.name}, {replay.duration_s:.0f} s: {line(replay)}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
