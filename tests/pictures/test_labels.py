"""Names on axes: of times, above them."""

from __future__ import annotations

from matplotlib.figure import Figure

from moar_companion.analysis.pictures.labels import name_times

STATES = [
    (15.0, "planning"),
    (15.1, "ready"),
    (16.6, "flying"),
    (24.0, "at_target"),
    (90.0, "idle"),
]


def test_each_time_is_named_and_no_line_crosses_a_name():
    axes = Figure(figsize=(8.0, 3.0)).add_subplot()
    axes.set_xlim(0.0, 100.0)
    name_times(axes, STATES)
    axes.figure.draw_without_rendering()
    texts = sorted(axes.texts, key=lambda text: text.get_position()[0])
    assert [text.get_text().strip() for text in texts] == [
        "planning",
        "ready",
        "flying",
        "at target",
        "idle",
    ]
    for text in texts:
        box = text.get_window_extent()
        for line in axes.lines:
            trace = line.get_window_extent()
            within = box.x0 + 1.0 < trace.x0 < box.x1
            assert not (within and trace.y1 > box.y0)
