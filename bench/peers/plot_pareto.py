"""Cost against time a step: plot_pareto.py pareto.json out.png"""

import json
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

CUT = 330.0  # dearer runs did not swing up


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        points = json.load(file)
    figure, axes = plt.subplots(figsize=(9, 5.5))
    groups = {}
    for p in points["tiller"]:
        groups.setdefault(p["planner"], []).append(p)
    for name, group in groups.items():
        shown = [p for p in group if p["cost"] < CUT]
        line = axes.plot([p["us"] for p in shown], [p["cost"] for p in shown], ".", markersize=4, alpha=0.45)[0]
        best, front = float("inf"), []
        for p in sorted(shown, key=lambda p: p["us"]):
            if p["cost"] < best:
                best = p["cost"]
                front.append(p)
        axes.step([p["us"] for p in front], [p["cost"] for p in front], where="post", color=line.get_color(), label=name)
    for marker, key in (("x", "peers"), ("s", "quoted")):
        others = {}
        for p in points[key]:
            if p["cost"] < CUT:
                others.setdefault(p["planner"], []).append(p)
        for name, group in others.items():
            axes.plot([p["us"] for p in group], [p["cost"] for p in group], marker, label=name)
    axes.plot([0, 20, 20], [104, 104, 0], "k:", linewidth=1, label="goal")
    axes.set_xscale("log")
    axes.set_ylim(85, CUT)
    axes.set_xlabel("CPU time a step [us], median")
    axes.set_ylabel("cost of 400 steps")
    axes.set_title("Cart-pole swing-up in closed loop, N = 50, |u| <= 20 N")
    axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    axes.grid(True, which="both", alpha=0.2)
    figure.tight_layout()
    figure.savefig(sys.argv[2], dpi=110)


main()
