"""The confusion matrix of ./dev bench gap as a picture: what was hidden against what was said."""

import csv
from collections import Counter

SAID_NOTHING = ["in the set", "partly right", "unnamed", "no gap"]
WORD_OF = {"in_set": "in the set", "part": "partly right", "none": "no gap", "unnamed": "unnamed", "unfit": "unnamed"}


def kind(effects):
    return " + ".join(e.split("@")[0] for e in effects.split("+"))


def counts(path, least_r=3.0):
    """(truth, answer) -> cases, of the sealed single effects with r >= least_r."""
    with open(path, encoding="utf-8", newline="") as file:
        rows = [r for r in csv.DictReader(file) if r["section"] == "sealed" and r["outcome"] != "no_world"
                and float(r["r"]) >= least_r]
    said = lambda r: kind(r["truth"] if r["outcome"] == "exact" else r["answer"])
    return Counter((kind(r["truth"]), WORD_OF.get(r["outcome"]) or said(r)) for r in rows)


def draw(path, picture):
    """False where there is nothing to draw, or nothing to draw with."""
    cells = counts(path)
    if not cells:
        return False
    try:
        import matplotlib
    except ImportError:
        return False
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    truths = sorted({t for t, _ in cells})
    answers = truths + sorted({a for _, a in cells} - set(truths) - set(SAID_NOTHING)) + SAID_NOTHING
    total = Counter()
    for (truth, _), n in cells.items():
        total[truth] += n
    share = [[cells[t, a] / total[t] for a in answers] for t in truths]
    figure, axes = plt.subplots(figsize=(2.5 + 0.34 * len(answers), 2.2 + 0.3 * len(truths)))
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for i, t in enumerate(truths):
        for j, a in enumerate(answers):
            if cells[t, a]:
                axes.text(j, i, cells[t, a], ha="center", va="center", fontsize=7,
                          color="white" if share[i][j] > 0.5 else "black")
    axes.set_xticks(range(len(answers)), answers, rotation=60, ha="right", fontsize=7)
    axes.set_yticks(range(len(truths)), [f"{t} ({total[t]})" for t in truths], fontsize=7)
    axes.axvline(len(answers) - len(SAID_NOTHING) - 0.5, color="grey", linewidth=0.8)
    axes.set_xlabel("said")
    axes.set_ylabel("hidden (cases)")
    axes.set_title("single hidden effects, r >= 3", fontsize=9)
    figure.tight_layout()
    picture.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(picture, dpi=130)
    plt.close(figure)
    return True
