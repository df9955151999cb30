"""The whole front beside what weighted sums reach: `.venv/bin/python -m tests.benchmarks.fronts`.

Two tables on stdout: times on the problems of `plans`, 59k states, each with another start, and the
points and gaps of the evaluation's 36 scenes. Times are processor time of the calling thread.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from moar_companion import Mission, Planner, Vehicle
from moar_companion.analysis.evaluation.scenes import SCENES, problem
from moar_companion.planner.whole_front import whole_front
from moar_companion.settings.config import shipped_configs

from .plans import SIZES_M, VEHICLE, problems, sites

CALLS = 100
WISHES = 1000


def _line(text: str) -> None:
    sys.stdout.write(f"{text}\n")


def times() -> None:
    """Times of a front and of a wish on a known one, and the number of its points."""
    _line("| mission | front, ms, median / p99 | points, median / most | wish on a known front |")
    _line("|---|---|---|---|")
    site = sites()[[*SIZES_M][-1]]
    planner = Planner(site, Vehicle.load(shipped_configs() / "vehicles" / VEHICLE))
    for mission in Mission:
        spent_ms, points, wish_ms = [], [], []
        for call in problems(planner, mission, CALLS):
            request = planner.plan(**call).request
            began_s = time.thread_time()
            front = whole_front(planner, request)
            spent_ms.append(1e3 * (time.thread_time() - began_s))
            assert front is not None  # the problems have a path
            points.append(len(front))
            limits = np.linspace(front.second[-1], front.second[0], WISHES)
            began_s = time.thread_time()
            for limit in limits.tolist():
                front.within_second(limit)
            wish_ms.append(1e3 * (time.thread_time() - began_s) / WISHES)
        median, slow = np.percentile(spent_ms, [50, 99])
        _line(
            f"| {mission.value} | {median:.1f} / {slow:.1f} | "
            f"{np.median(points):.0f} / {max(points)} | {np.median(wish_ms):.4f} ms |"
        )


def gaps() -> None:
    """Points of each scene, and the widest gap of safety, as a share of its span."""
    _line("\n| scene | points | of these for some weights | widest gap | without the others |")
    _line("|---|---|---|---|---|")
    for scene in SCENES:
        posed = problem(scene)
        front = whole_front(posed.planner, posed.request)
        assert front is not None  # each scene has a path
        span = float(front.first[-1] - front.first[0]) or 1.0
        alone = front.first[front.supported]
        _line(
            f"| {scene.name} | {len(front)} | {len(alone)} | "
            f"{np.diff(front.first).max(initial=0.0) / span:.2f} | "
            f"{np.diff(alone).max(initial=0.0) / span:.2f} |"
        )


if __name__ == "__main__":
    times()
    gaps()
