"""The pictures of laws: panels of predictions and measurements, side by side on a desk."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import replace

from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from chiplog.pages.drawing import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    ROSE,
    Canvas,
    Picture,
    picture,
)
from chiplog.pages.quantities import SUPERSCRIPTS
from hil_harness.laws import Finding, Panel, Series

_COLOURS = (INK, BLUE, ORANGE, GREEN, ROSE)
_PANEL_HEIGHT_PX = 330.0
_LEFT_PX = 62.0
_RIGHT_PX = 14.0
_TOP_PX = 26.0
_BOTTOM_PX = 92.0  # tick labels, axis label, two rows of legend
_LEGEND_PX = 44.0


def law_picture(finding: Finding) -> Picture:
    """Draw the panels of one law for both screen widths."""
    law, evidence = finding.law, finding.evidence
    titles = ". ".join(panel.title for panel in evidence.panels)
    drawn = picture(
        law.name.replace("_", "-"),
        law.title,
        evidence.caption,
        lambda canvas: _draw(canvas, evidence.panels),
        alt=f"{titles}. {evidence.caption}",
    )
    return replace(drawn, markup=_with_subscripts(drawn.markup))


def _with_subscripts(markup: Markup) -> Markup:
    """Return the drawing in which labels such as ``ε_r·S`` have real subscripts."""

    def label(text: re.Match[str]) -> str:
        lowered = re.sub(
            r"_([A-Za-zα-ω]+)([^_]*)",
            r'<tspan dy="2.5" font-size="80%">\1</tspan><tspan dy="-2.5">\2</tspan>',
            text[1],
        )
        return f"{lowered}</text>"

    return Markup(re.sub(r"(?<=>)([^<>]*_[^<>]*)</text>", label, markup))


def _draw(canvas: Canvas, panels: Sequence[Panel]) -> Figure:
    """Lay the panels out by hand: margins in pixels, the same for all, so that axes line up."""
    count = len(panels)
    rows, columns = (count, 1) if canvas.is_narrow else (1, count)
    width_px, height_px = canvas.width_px / columns, _PANEL_HEIGHT_PX
    figure = Figure(figsize=(canvas.width_px / 72, height_px * rows / 72), dpi=72)
    for index, panel in enumerate(panels):
        left_px = index % columns * width_px + _LEFT_PX
        top_px = index // columns * height_px + _TOP_PX
        inner_px = (width_px - _LEFT_PX - _RIGHT_PX, height_px - _TOP_PX - _BOTTOM_PX)
        axes = figure.add_axes(
            (
                left_px / canvas.width_px,
                1 - (top_px + inner_px[1]) / (height_px * rows),
                inner_px[0] / canvas.width_px,
                inner_px[1] / (height_px * rows),
            )
        )
        _draw_panel(axes, panel, _LEGEND_PX / inner_px[1])
    return figure


def _draw_panel(axes: Axes, panel: Panel, legend_below: float) -> None:
    axes.set_title(panel.title, loc="left")
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    if panel.log_x:
        _make_logarithmic(axes.xaxis, axes.set_xscale)
    if panel.log_y:
        _make_logarithmic(axes.yaxis, axes.set_yscale)
    # Predictions lie on top of what they predict, dashed so that it shows through.
    for series in panel.series:
        _draw_series(axes, series)
    if panel.is_map:
        axes.set_aspect("equal", adjustable="datalim")
    if panel.y_limits is not None:
        axes.set_ylim(*panel.y_limits)
    if panel.broken is not None:
        axes.margins(x=0.02)
        axes.axvspan(*panel.broken, color=ROSE, alpha=0.13, linewidth=0, label="law breaks")
    if any(series.label for series in panel.series):
        axes.legend(
            loc="upper left",
            bbox_to_anchor=(0.0, -legend_below),
            ncols=2,
            frameon=False,
            fontsize=10,
            handlelength=1.6,
            columnspacing=1.2,
            borderaxespad=0.0,
        )


def _make_logarithmic(axis: Axis, set_scale: Callable[[str], None]) -> None:
    """Label decades in plain text: a picture's text is the page's, which knows no formulas."""
    set_scale("log")
    axis.set_major_locator(LogLocator(numticks=6))
    axis.set_major_formatter(FuncFormatter(lambda value, _: _decade(value)))
    axis.set_minor_formatter(NullFormatter())


def _decade(value: float) -> str:
    if 1e-3 <= value < 1e4:
        return f"{value:g}"
    return f"10{str(round(math.log10(value))).translate(SUPERSCRIPTS)}"


def _draw_series(axes: Axes, series: Series) -> None:
    colour = _COLOURS[series.colour]
    label = series.label or None
    if series.style == "law":
        if series.low is not None and series.high is not None:
            axes.fill_between(
                series.x, series.low, series.high, color=colour, alpha=0.12, linewidth=0
            )
        axes.plot(series.x, series.y, "--", color=colour, linewidth=1.4, label=label, zorder=3)
    elif series.style == "line":
        axes.plot(series.x, series.y, "-", color=colour, label=label)
    elif series.low is not None and series.high is not None:
        below, above = series.y - series.low, series.high - series.y
        axes.errorbar(
            series.x,
            series.y,
            yerr=(below, above),
            fmt="o",
            color=colour,
            markersize=3.5,
            elinewidth=1.2,
            label=label,
        )
    else:
        axes.plot(series.x, series.y, "o", color=colour, markersize=3.5, label=label)
