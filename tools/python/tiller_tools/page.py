"""The look of every report: one style sheet, one plot style, figures as inline SVG.

Figures are drawn at the width of a phone's column (about 440 px) and laid out in a grid, so that a phone
shows one a row with legible labels and a projector shows two or three.
"""

from __future__ import annotations

import html
import io
import re

import matplotlib
import matplotlib.ticker

matplotlib.use("svg")
from matplotlib import pyplot as plt  # noqa: E402  the backend is chosen first
import numpy as np  # noqa: E402

from .interval import digits_that_show  # noqa: E402

# Colours that stay apart for colour-blind readers and on a washed-out projector; page_test measures it.
ESTIMATE = "#1f5fa8"
MEASURED = "#9aa3ad"
TRUTH = "#d0521b"
BAND = "#a9c6e8"
PREDICTIVE = "#d6e5f5"
PRIOR = "#ececec"
LIMIT = "#b3261e"
INK = "#22262b"
CYCLE = [ESTIMATE, TRUTH, "#56b4e9", INK, "#e69f00", "#cc79a7"]
DASHES = ["-", (0, (5, 2)), (0, (1, 1.2)), (0, (6, 2, 1, 2)), (0, (3, 1)), (0, (8, 3))]

_STYLE = {
    "svg.fonttype": "none",  # text stays text: small, sharp, searchable
    "svg.hashsalt": "tiller",  # the same data give the same bytes
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#8b929a",
    "axes.labelcolor": INK,
    "axes.grid": True,
    "grid.color": "#e9ebee",
    "grid.linewidth": 0.8,
    "axes.axisbelow": True,
    "xtick.color": "#5a626b",
    "ytick.color": "#5a626b",
    "text.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "lines.linewidth": 1.6,
    "figure.dpi": 72,
    "figure.constrained_layout.use": True,
}
plt.rcParams.update(_STYLE)
plt.rcParams["axes.prop_cycle"] = matplotlib.cycler(color=CYCLE)

_MARGIN = 50  # for the tick labels at the left of the axes

_CSS = """
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 20px clamp(12px, 3vw, 40px) 48px; max-width: 1500px; background: #fff;
  color: #22262b; font: 16px/1.5 system-ui, -apple-system, "Segoe UI", "DejaVu Sans", sans-serif; }
h1 { font-size: clamp(22px, 3vw, 32px); line-height: 1.2; margin: 0 0 4px; }
h2 { font-size: 19px; margin: 34px 0 8px; }
h3 { font-size: 15px; margin: 0 0 2px; }
p { max-width: 80ch; margin: 6px 0; }
.lead { color: #5a626b; margin: 0 0 14px; }
.outcome { display: inline-block; padding: 4px 14px; border-radius: 6px; font-weight: 600; margin: 4px 0 10px; }
.good { background: #e3f3e8; color: #14532d; } .bad { background: #fbe6e4; color: #7f1d1d; }
.plain { background: #eef1f4; color: #22262b; }
.facts { display: flex; flex-wrap: wrap; gap: 6px 28px; padding: 0; margin: 8px 0 4px; list-style: none; }
.facts b { display: block; font-size: 18px; font-weight: 600; font-variant-numeric: tabular-nums; }
.facts span { color: #5a626b; font-size: 13px; }
.scroll { overflow-x: auto; }
li { overflow-wrap: anywhere; }
table { border-collapse: collapse; font-size: 15px; font-variant-numeric: tabular-nums; min-width: 50%; }
th, td { padding: 6px 14px 6px 0; text-align: right; white-space: nowrap; border-bottom: 1px solid #e3e6ea; }
th { color: #5a626b; font-weight: 500; } th:first-child, td:first-child { text-align: left; }
.grid { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 400px), 1fr));
  gap: 22px 28px; margin: 14px 0; }
.grid .wide { grid-column: 1 / -1; }
figure { margin: 0; } figure svg { width: 100%; height: auto; display: block; }
.stage canvas { width: 100%; height: clamp(240px, 46vw, 430px); display: block; border: 1px solid #e3e6ea;
  border-radius: 6px; touch-action: pan-y; cursor: grab; }
.stage .controls { display: flex; flex-wrap: wrap; gap: 6px 12px; align-items: center; margin: 8px 0 4px; }
.stage .controls input { flex: 1 1 140px; min-width: 0; } .stage .controls output { font-variant-numeric: tabular-nums; }
.stage button, .stage select { font: inherit; font-size: 14px; padding: 3px 12px; border: 1px solid #c4cad1;
  border-radius: 6px; background: #f7f8fa; color: inherit; } .stage button { min-width: 5em; }
.legend { display: flex; flex-wrap: wrap; gap: 2px 18px; font-size: 14px; color: #5a626b; }
.legend i { display: inline-block; width: 24px; margin-right: 6px; vertical-align: middle; }
.robot { display: grid; gap: 22px 28px; margin: 14px 0; grid-template-columns: minmax(0, 1fr); }
@media (min-width: 800px) { .robot { grid-template-columns: minmax(0, 3fr) minmax(0, 2fr); } }
@media print { .stage { display: none; } }
figcaption { color: #5a626b; font-size: 14px; line-height: 1.4; }
code { font-size: .92em; background: #f3f5f7; padding: 1px 5px; border-radius: 4px; }
footer { margin-top: 40px; color: #5a626b; font-size: 14px; }
"""


def axes(title: str, ylabel: str, xlabel: str = "time (s)", height: float = 3.6, width: float = 6.0):
    """A figure and its axes at the common size (inches at 72 dpi)."""
    figure, ax = plt.subplots(figsize=(width, height))
    figure.set_label(title)  # becomes a heading of the page: legible at any width, and never under a legend
    ax.set_xlabel(xlabel)
    ax.set_ylabel(ylabel)
    return figure, ax


def density_axes(title: str, xlabel: str, height: float = 3.2):
    """Of a histogram whose heights mean nothing but each beside the other."""
    figure, ax = axes(title, "density", xlabel, height)
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)
    ax.grid(axis="y", visible=False)
    return figure, ax


def unit_text(unit: str) -> str:
    return unit.replace("^2", "²").replace("^3", "³")


def unit_label(name: str, unit: str | None) -> str:
    """Of an axis whose figure is called by the quantity: its unit, or the quantity again where that is not known."""
    return "dimensionless" if unit == "1" else unit_text(unit) if unit else name


def quantity_label(name: str, unit: str | None) -> str:
    """Of an axis whose figure is called by something else."""
    return name if unit in (None, "", "1") else f"{name} ({unit_text(unit)})"


def plain(value: float, _=None) -> str:
    """A tick's label: the number, where a logarithmic axis would write powers of ten."""
    return f"{value:g}".replace("e+0", "e")


def log_axis(axis, low: float, high: float) -> None:
    """A logarithmic axis over positive values, labelled in plain numbers, three a decade where decades are few."""
    decades = np.log10(high / low)
    axis.axes.set_yscale("log")
    axis.axes.set_ylim(low, high)
    axis.set_major_locator(matplotlib.ticker.LogLocator(subs=(1.0,) if decades > 2.5 else (1.0, 2.0, 5.0)))
    axis.set_major_formatter(plain)
    axis.set_minor_formatter(matplotlib.ticker.NullFormatter())


def curve(i: int) -> dict:
    """Colour and dashes of the i-th of several curves: either alone tells them apart."""
    return {"color": CYCLE[i % len(CYCLE)], "linestyle": DASHES[i % len(DASHES)]}


def legend(ax) -> None:
    """Outside the axes, above the plot at the right: it never hides data. Of as many rows as the width asks for."""
    handles, labels = ax.get_legend_handles_labels()
    room = ax.figure.get_size_inches()[0] * ax.figure.dpi - _MARGIN
    for columns in range(len(handles), 0, -1):
        box = ax.legend(handles, labels, loc="lower right", bbox_to_anchor=(1.0, 0.99), ncols=columns,
                        handlelength=1.6, columnspacing=1.0, borderpad=0.1, markerscale=2)
        if columns == 1 or box.get_window_extent().width < room:
            return


def thin(n: int, most: int = 900) -> slice:
    """Every k-th sample: a phone's column has no more pixels than this, and the page stays small."""
    return slice(None, None, max(1, -(-n // most)))


def svg(figure, caption: str = "", wide: bool = False) -> str:
    """The figure as an inline <figure>; the file's XML prologue and sizes are dropped, ids made unique."""
    for i, ax in enumerate(figure.axes):  # ids by which a test finds them in the page
        ax.xaxis.label.set_gid(f"xlabel_{i + 1}")
        ax.yaxis.label.set_gid(f"ylabel_{i + 1}")
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    plt.close(figure)
    text = buffer.getvalue()
    text = text[text.index("<svg"):]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.S)
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", text, count=1)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text, count=1)
    text = _unique_ids(text)
    title = f"<h3>{html.escape(figure.get_label())}</h3>" if figure.get_label() else ""
    note = f"<figcaption>{html.escape(caption)}</figcaption>" if caption else ""
    return f'<figure{" class=wide" if wide else ""}>{title}{text}{note}</figure>'


_figures = 0


def _unique_ids(text: str) -> str:
    """Several SVGs share one page, where a repeated id would clip one figure by another's frame."""
    global _figures
    _figures += 1
    tag = f"f{_figures}-"
    text = re.sub(r'\bid="', f'id="{tag}', text)
    text = re.sub(r'(href="#|url\(#)', rf"\g<1>{tag}", text)
    return text


def number(value, digits: int = 4) -> str:
    """For readers: about four significant digits, a dash for what is not known."""
    if value is None or not np.isfinite(value):
        return "–"
    if value != 0 and not 1e-5 <= abs(value) < 1e6:
        return f"{value:.{digits - 1}e}"
    decimals = 0 if value == 0 else max(0, digits - 1 - int(np.floor(np.log10(abs(value)))))
    return f"{value:.{decimals}f}"


def interval(low, high, least: int = 4, between: str = " .. ", unit: str = "") -> str:
    """Both ends with the digits that the width needs."""
    known = [v for v in (low, high) if v is not None and np.isfinite(v)]
    digits = digits_that_show(known[1] - known[0], max(map(abs, known)), least) if len(known) == 2 else least
    return f"{number(low, digits)}{unit}{between}{number(high, digits)}{unit}"


def mean(value, sd, least: int = 4) -> str:
    """A mean with the digits that its standard deviation needs."""
    return number(value, digits_that_show(sd, value, least))


def rows(header: list[str], body: list[list[str]]) -> str:
    """A table; cells are escaped here and nowhere else."""
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in header)
    lines = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in body)
    return f'<div class=scroll><table><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table></div>'


def facts(pairs: list[tuple[str, str]]) -> str:
    items = "".join(f"<li><b>{html.escape(value)}</b><span>{html.escape(name)}</span></li>" for name, value in pairs)
    return f"<ul class=facts>{items}</ul>"


def warnings(texts: list[str]) -> str:
    return "".join(f"<p>⚠ {html.escape(text)}</p>" for text in texts)


def outcome(text: str, good: bool | None) -> str:
    kind = "plain" if good is None else "good" if good else "bad"
    return f'<div class="outcome {kind}">{html.escape(text)}</div>'


def grid(figures: list[str]) -> str:
    return f'<div class=grid>{"".join(figures)}</div>'


def page(title: str, body: str) -> str:
    return (f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
            f'<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{html.escape(title)}</title><style>{_CSS}</style></head><body>{body}</body></html>\n")
