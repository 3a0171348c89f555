"""Pictures for pages: matplotlib figures as inline SVG that takes its colours from the page.

matplotlib knows no CSS variables, so figures are drawn in marker colours (`INK`, `BLUE`, …) which
`svg` replaces by `var(--…)`; a page in dark mode then recolours its pictures by itself. Text stays
text, in the page's font, and scales, selects and searches like the rest.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.figure import Figure

# Marker colours: each stands for one CSS variable of templates/page.css.
INK = "#010101"
MUTED = "#020202"
FAINT = "#030303"
PAPER = "#040404"
BLUE = "#050505"
ORANGE = "#060606"
GREEN = "#070707"
ROSE = "#080808"
_VARIABLES = {
    INK: "ink",
    MUTED: "muted",
    FAINT: "faint",
    PAPER: "paper",
    BLUE: "blue",
    ORANGE: "orange",
    GREEN: "green",
    ROSE: "rose",
}

_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "chiplog",
    "font.family": "DejaVu Sans",
    "font.size": 11,
    "axes.titlesize": 11,
    "axes.labelsize": 11,
    "xtick.labelsize": 10.5,
    "ytick.labelsize": 10.5,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": MUTED,
    "axes.linewidth": 1.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.unicode_minus": True,
    "axes.formatter.useoffset": False,
    "grid.color": FAINT,
    "grid.linewidth": 0.6,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": MUTED,
    "ytick.labelcolor": MUTED,
    "xtick.major.size": 0,
    "ytick.major.size": 0,
    "lines.linewidth": 1.8,
    "lines.solid_capstyle": "round",
    "text.color": INK,
    "text.parse_math": False,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
    "path.simplify": True,
    "path.simplify_threshold": 0.1,
}


@dataclass(frozen=True)
class Canvas:
    """One of the two sizes every picture is drawn in, in CSS pixels."""

    name: str
    width_px: int

    @property
    def is_narrow(self) -> bool:
        """Whether this is the phone's size, with room for less text."""
        return self.width_px < 500


WIDE = Canvas("wide", 760)
NARROW = Canvas("narrow", 358)


@dataclass(frozen=True)
class Picture:
    """An inline picture: what it shows, in words, and its markup for both screen widths."""

    title: str
    caption: str
    markup: Markup


def picture(
    name: str, title: str, caption: str, draw: Callable[[Canvas], Figure], *, alt: str
) -> Picture:
    """Draw a picture for a desk and for a phone; the page's style shows the one that fits.

    `name` must be unique on the page: it keeps the pictures' internal references apart. `alt` says
    in words what a reader who cannot see the picture should know.
    """
    drawings = []
    for canvas in (WIDE, NARROW):
        with style():
            drawings.append(
                Markup('<div class="{}">{}</div>').format(
                    canvas.name, svg(draw(canvas), f"{name}-{canvas.name}", alt)
                )
            )
    return Picture(title, caption, Markup("\n").join(drawings))


@contextmanager
def style() -> Iterator[None]:
    """Draw in the pages' style inside this context."""
    with mpl.rc_context(_STYLE):
        yield


def new_figure(canvas: Canvas, height_px: float, *, rows: int = 1) -> tuple[Figure, list[Axes]]:
    """Return a figure of the canvas's width with `rows` axes that share their x axis."""
    figure = Figure(figsize=(canvas.width_px / 72, height_px / 72), dpi=72)
    figure.set_layout_engine("constrained", w_pad=4 / 72, h_pad=5 / 72)
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)
    return figure, [row[0] for row in axes]


def svg(figure: Figure, name: str, alt: str) -> Markup:
    """Return `figure` as an inline `<svg>` element with the page's colours and font."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.S)
    text = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', text)
    text = re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", text)
    text = re.sub(r'href="#([^"]+)"', rf'href="#{name}-\1"', text)
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", text, count=1)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text, count=1)
    text = re.sub(r"font: (?:(\w+) )?([\d.]+)px [^;\"]*", _font, text)
    for colour, variable in _VARIABLES.items():
        text = text.replace(colour, f"var(--{variable})")
    label = escape(alt)
    return Markup(text.replace("<svg", f'<svg role="img" aria-label="{label}"', 1))


def _font(match: re.Match[str]) -> str:
    """Keep size and weight; the family is the page's."""
    weight, size_px = match.groups()
    return f"font-size: {size_px}px" + (f"; font-weight: {weight}" if weight else "")
