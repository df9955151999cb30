"""What a person waits for on the page: `.venv/bin/python -m tests.benchmarks.screen`.

The server's part of a what-if answer on the 315 kV line (60,000 states), an obstacle moved each
time: processor time of its thread, with reading and writing of JSON. In Chromium: the time from an
obstacle's move by a key to the new path on screen, the processor time of its main thread, and the
first contentful paint.
"""

from __future__ import annotations

import contextlib
import copy
import json
import random
import sys
import time
from collections.abc import Iterator

import numpy as np

from moar_companion.analysis.what_if import WhatIf
from moar_companion.companion.error_margin import margin_of
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Site
from moar_companion.planner.site_view import maps_view, site_view
from moar_companion.service.page.page_server import PageContent
from moar_companion.settings.config import Supervision, shipped_configs
from moar_companion.settings.vehicle import Vehicle
from tests.service.page.browser import chromium, opened
from tests.service.page.serving import served

SITE_FILE = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
PARTS = (["maps"], ["maps", "baselines"], ["maps", "baselines", "front"], ["alternatives"])
COUNTS = (500, 200, 20, 200)
MOVES = 60
PAINTS = 5
MOVED = """async () => {
  const handle = document.querySelector(".handle[data-id^=obstacle]");
  const path = () => document.querySelector(".plane path.line.path")?.getAttribute("d");
  const took = [];
  for (let count = 0; count < MOVES; count++) {
    const before = document.querySelector(".plane image").getAttribute("href") + path();
    const key = count % 8 < 4 ? "ArrowRight" : "ArrowLeft";
    const began = performance.now();
    handle.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true, cancelable: true }));
    while (document.querySelector(".plane image").getAttribute("href") + path() === before) {
      await new Promise(requestAnimationFrame);
    }
    took.push(performance.now() - began);
    await new Promise((resolve) => setTimeout(resolve, 60));
  }
  return took;
}""".replace("MOVES", str(MOVES))


def answers_ms(what_if: WhatIf, parts: list[str], count: int) -> list[float]:
    """Processor time of each answer."""
    rng, times_ms = random.Random(1), []
    for number in range(count):
        site = copy.deepcopy(what_if.document()["site"])
        obstacle = site["obstacles"][number % 6]["conductor"]
        obstacle["x_m"] += rng.uniform(-2.0, 2.0)
        obstacle["z_m"] += rng.uniform(-1.0, 1.0)
        risk = {"wind": round(rng.random(), 2)}
        text = json.dumps({"site": site, "target": "splice-inner", "risk": risk, "parts": parts})
        began_s = time.thread_time()
        json.dumps(what_if.answer(json.loads(text)), allow_nan=False)
        times_ms.append(1e3 * (time.thread_time() - began_s))
    return times_ms


@contextlib.contextmanager
def main_thread(tab) -> Iterator[list[float]]:
    """Processor time of a tab's main thread meanwhile, in a list of one number."""
    session = tab.context.new_cdp_session(tab)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})

    def now_ms() -> float:
        metrics = session.send("Performance.getMetrics")["metrics"]
        return 1e3 * next(item["value"] for item in metrics if item["name"] == "TaskDuration")

    began_ms, used_ms = now_ms(), [0.0]
    yield used_ms
    used_ms[0] = now_ms() - began_ms


def row(name: str, times_ms: list[float]) -> str:
    median, high = np.percentile(times_ms, [50, 99])
    return f"| {name} | {len(times_ms)} | {median:.1f} | {high:.1f} | {max(times_ms):.1f} |"


def write(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main() -> None:
    vehicle = Vehicle.load(shipped_configs() / "vehicles" / "x500.yaml")
    margin = margin_of(vehicle, Supervision())
    text = SITE_FILE.read_text(encoding="utf-8")
    what_if = WhatIf(text=text, source=str(SITE_FILE), vehicle=vehicle, margin=margin)
    write("| | count | median | p99 | greatest, ms |\n|---|---|---|---|---|")
    for parts, count in zip(PARTS, COUNTS, strict=True):
        answers_ms(what_if, parts, 3)
        write(row(f"server: path, {', '.join(parts)}", answers_ms(what_if, parts, count)))
    planner = Planner(Site.load(SITE_FILE).flown_with(margin), vehicle)
    view = {"revision": 1, "site": site_view(planner.site), "maps": maps_view(planner.maps)}
    content = PageContent(
        about={"kind": "site", "recording": None, "vehicle": None},
        site=lambda: view,
        make_what_if=lambda: what_if,
    )
    with served(content) as page, chromium() as browser:
        paints_ms = []
        for _ in range(PAINTS):
            with opened(browser, f"http://{page.host}/") as tab:
                tab.get_by_text("different paths are optimal").wait_for()
                paints_ms.append(tab.evaluate("performance.getEntriesByType('paint')[0].startTime"))
                if len(paints_ms) == PAINTS:
                    with main_thread(tab) as used_ms:
                        moved_ms = tab.evaluate(MOVED)
                    write(row("from a key to the path on screen", moved_ms))
                    write(
                        f"| main thread of the browser, each | {MOVES} | {used_ms[0] / MOVES:.1f} |"
                    )
        write(row("first paint", paints_ms))


if __name__ == "__main__":
    main()
