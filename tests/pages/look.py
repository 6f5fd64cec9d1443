"""What a page looks like: what is wrong with it whatever it shows, and how it differs from an approved one.

A font is the reader's: nothing here depends on one. What is compared lies within the plots, where the axes' frames are,
and texts are asked only not to meet each other, nor the legend the plot.
"""

import re
from dataclasses import dataclass

import numpy as np

from tiller_tools import page

_COLUMNS, _ROWS = 12, 6  # cells of a plot's luminance: about 40 x 40 pixels
_PALETTE = {"blue": page.ESTIMATE, "orange": page.TRUTH, "grey": page.MEASURED, "band": page.BAND,
            "readings": page.PREDICTIVE, "prior": page.PRIOR, "red": page.LIMIT, "sky": page.CYCLE[2],
            "ink": page.INK, "yellow": page.CYCLE[4], "pink": page.CYCLE[5]}


@dataclass
class Tolerance:
    """Of a plot beside the approved one."""
    cell: float  # of the luminance of one cell
    mean: float  # of the luminance over all cells
    share: float  # factor of a colour's share of the plot
    line: float  # least share in percent of a full colour that is asked for; less is the rim of another one
    area: float  # the same of a pale colour, or of grey: lines in them are the grid's, too


# The same data: serif and monospaced fonts in the place of the approved one move a cell by up to 0.05 (numbers within a
# plot), the mean by 0.003. Another rasteriser puts the rims of lines elsewhere, a third of a thin line's pixels.
SAME_DATA = Tolerance(cell=0.08, mean=0.01, share=1.6, line=0.1, area=0.1)
# Data of a simulation, whose last bits are the compiler's and are amplified by whatever swings: other lanes, with their
# own rounding, move the mean by up to 0.05 (histograms). A curve that is missing leaves nothing of its colour.
SAME_TASK = Tolerance(cell=0.5, mean=0.08, share=4.0, line=0.25, area=2.0)

_FULL = ("blue", "orange", "red", "sky", "yellow", "pink")


def _rgb(code: str) -> np.ndarray:
    return np.array([int(code[i:i + 2], 16) / 255 for i in (1, 3, 5)])


def _union(boxes: list) -> list:
    left, top = min(b[0] for b in boxes), min(b[1] for b in boxes)
    return [left, top, max(b[0] + b[2] for b in boxes) - left, max(b[1] + b[3] for b in boxes) - top]


def _shared(a: list, b: list) -> tuple[float, float]:
    """Width and height of what two boxes share; zero: apart."""
    return (max(0.0, min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])),
            max(0.0, min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])))


def _pixels(picture: np.ndarray, box: list) -> np.ndarray:
    """Of a plot without its frame, which is as grey as measured points."""
    x, y, width, height = (int(round(v)) for v in box)
    return picture[y + 3:y + height - 3, x + 3:x + width - 3]


def _luminance(pixels: np.ndarray) -> np.ndarray:
    """(rows x columns) means over cells, 0 .. 1."""
    grey = pixels @ np.array([0.299, 0.587, 0.114])
    rows = np.array_split(np.arange(grey.shape[0]), _ROWS)
    columns = np.array_split(np.arange(grey.shape[1]), _COLUMNS)
    return np.array([[grey[np.ix_(r, c)].mean() for c in columns] for r in rows])


def _colours(pixels: np.ndarray) -> dict:
    """Percent of the plot's pixels that have a colour of the palette."""
    shares = {name: round(100 * float(np.mean(np.all(np.abs(pixels - _rgb(code)) < 0.06, axis=2))), 2)
              for name, code in _PALETTE.items()}
    return {name: share for name, share in shares.items() if share > 0}


def measure(probe: dict, picture: np.ndarray) -> list[dict]:
    """Of each figure what is compared with the approved one."""
    figures = []
    for f in probe["figures"]:
        plot = _pixels(picture, _union(f["plots"]))
        cells = np.round(255 * _luminance(plot)).astype(int).clip(0, 255)
        figures.append({"title": f["title"], "x": f["x"], "y": f["y"], "legend": f["legend"],
                        "size": [round(v) for v in f["svg"][2:]], "colours": _colours(plot),
                        "luminance": bytes(cells.ravel().tolist()).hex()})
    return figures


# ---- whatever a page shows ---------------------------------------------------------------------------


def _text_faults(f: dict) -> list[str]:
    faults = []
    left, top, width, height = f["svg"]
    # room for the letters of another font, which are up to a fifth wider: at the figure's rim, and between two texts
    for text, *box in f["texts"]:
        spare = 0.2 * box[2] + 2
        if box[0] < left - spare or box[0] + box[2] > left + width + spare or box[1] < top - 4 or \
                box[1] + box[3] > top + height + 4:
            faults.append(f"the text '{text}' leaves the figure")
    for i, (one, *a) in enumerate(f["texts"]):
        for other, *b in f["texts"][i + 1:]:
            across, down = _shared(a, b)
            if across > 0.2 * min(a[2], b[2]) + 1 and down > 0.4 * min(a[3], b[3]):
                faults.append(f"the texts '{one}' and '{other}' overlap")
    return faults


def _figure_faults(f: dict, picture: np.ndarray) -> list[str]:
    faults = _text_faults(f)
    if not f["x"] or not f["y"]:
        faults.append("an axis has no label")
    if not f["plots"]:
        return faults + ["there is no plot"]
    for legend in f["legends"]:
        for plot in f["plots"]:
            if min(_shared(legend, plot)) > 4:  # the legend's frame has a rim of 1 px and may sit on the axes'
                faults.append("the legend lies over the plot")
    for plot in f["plots"]:
        # frame and grid have none of the colours but that of "prior" and "readings"; a number in a plot is ink, about
        # 0.05 %, a curve of ink is more
        colours = _colours(_pixels(picture, plot))
        drawn = sum(share for name, share in colours.items() if name not in ("prior", "readings", "ink"))
        if drawn < 0.02 and colours.get("ink", 0) < 0.2:
            faults.append("a plot is empty")
    return faults


def faults(probe: dict, picture: np.ndarray) -> list[str]:
    """Sentences on what no page may show."""
    found = [f"wider than the window: {what}" for what in probe["wide"]]
    # four digits are what a reader can use; eight would be a value that nobody rounded
    found += [f"the number {number} has too many digits" for number in re.findall(r"\d+\.\d+", probe["text"])
              if len(number.replace(".", "").lstrip("0")) >= 8]
    if probe["height"] > picture.shape[0]:
        return found + [f"the page is {probe['height']:.0f} px high, more than the picture: give the browser more"]
    titles = [f["title"] for f in probe["figures"]]
    found += [f"{title}: {titles.count(title)} figures are called so" for title in sorted(set(titles))
              if titles.count(title) > 1]
    return found + [f"{f['title']}: {fault}" for f in probe["figures"] for fault in _figure_faults(f, picture)]


# ---- beside an approved one --------------------------------------------------------------------------


def axes_text(figure: dict) -> str:
    return f"{figure['title']} | {', '.join(figure['x'])} | {', '.join(figure['y'])}"


def _plot_differences(now: dict, approved: dict, tolerance: Tolerance) -> list[str]:
    found = []
    if now["legend"] != approved["legend"]:
        found.append(f"the legend says {now['legend']}, approved {approved['legend']}")
    if max(abs(a - b) for a, b in zip(now["size"], approved["size"])) > 2:
        found.append(f"is {now['size']} px large, approved {approved['size']}")
    for name, share in approved["colours"].items():
        has = now["colours"].get(name, 0.0)
        least = tolerance.line if name in _FULL else tolerance.area
        if share >= least and not share / tolerance.share <= has <= share * tolerance.share:
            found.append(f"{has} % of the plot are {name}, approved {share} %")
    a, b = (np.frombuffer(bytes.fromhex(figure["luminance"]), np.uint8) / 255 for figure in (now, approved))
    apart = np.abs(a - b)
    if apart.max() > tolerance.cell or apart.mean() > tolerance.mean:
        found.append(f"brightness differs by {apart.mean():.3f} on average, {apart.max():.3f} at most")
    return [f"{now['title']}: {text}" for text in found]


def missing_and_extra(now: list[dict], expected: list[str]) -> list[str]:
    """`expected`: a line "title | x | y" a figure, in any order."""
    texts = [axes_text(figure) for figure in now]
    return [f"missing: {text}" for text in expected if text not in texts] + [
        f"not expected: {text}" for text in texts if text not in expected]


def differences(now: list[dict], approved: list[dict], tolerance: Tolerance, axes_only: str = "^$") -> list[str]:
    """Sentences on every figure that is missing, too many, or looks otherwise. Of figures whose title matches
    `axes_only` only the axes are compared."""
    old = {axes_text(figure): figure for figure in approved}
    new = {axes_text(figure): figure for figure in now}
    found = missing_and_extra(now, list(old))
    for text in old:
        if text in new and not re.search(axes_only, new[text]["title"]):
            found += _plot_differences(new[text], old[text], tolerance)
    return found
