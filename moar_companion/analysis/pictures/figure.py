"""A page drawn without a screen: the type of all pictures, and panels placed in inches."""

from __future__ import annotations

import textwrap
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from matplotlib import style
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

DPI = 150
INK = "#1b1d21"
"""Colour of names, rims and lines."""

_STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.linewidth": 0.8,
    "savefig.dpi": DPI,
    "figure.dpi": DPI,
    "svg.fonttype": "path",
}


@contextmanager
def page_style() -> Iterator[None]:
    """Context with one style for drawing and saving, independent of the user's settings."""
    with style.context(["default", _STYLE], after_reset=True), warnings.catch_warnings():
        # A name in a script that the font does not have is drawn as boxes.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        yield


class Page:
    """An empty white page, sizes in inches."""

    def __init__(self, width_in: float, height_in: float) -> None:
        self.width_in, self.height_in = width_in, height_in
        self.figure: Any = Figure(figsize=(width_in, height_in), facecolor="white")
        FigureCanvasAgg(self.figure)

    def panel(self, left_in: float, bottom_in: float, width_in: float, height_in: float) -> Any:
        """Axes that fill a rectangle of the page."""
        return self.figure.add_axes(
            (
                left_in / self.width_in,
                bottom_in / self.height_in,
                width_in / self.width_in,
                height_in / self.height_in,
            )
        )

    def title(self, left_in: float, site: str, what: str, colour: str = INK) -> None:
        """The site in bold, and the subject below it; too long a text is shortened."""
        for down_in, text, most, size, weight, text_colour in (
            (0.12, site, 90, 13, "bold", INK),
            (0.4, what, 130, 10.5, "normal", colour),
        ):
            self.figure.text(
                left_in / self.width_in,
                1.0 - down_in / self.height_in,
                textwrap.shorten(text, most, placeholder=" …"),
                fontsize=size,
                weight=weight,
                color=text_colour,
                va="top",
                parse_math=False,
            )
