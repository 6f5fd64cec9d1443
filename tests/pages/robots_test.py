"""robots_test.py KIND ROBOT.toml FOLDER: the page of a shipped robot, as the program makes it, beside the approved one.

The page and its picture stay in FOLDER. TILLER_APPROVE=1 approves them: look at them first. What a gap's page shows
goes by its verdict, which the last bits of a simulated run may turn: its figures are those that gap.json asks for.
"""

import csv
import json
import math
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, os.environ["TILLER_PYTHON_PACKAGE"])
sys.path.insert(0, str(Path(__file__).parent))

import look  # noqa: E402
from browser import CHROMIUM, Browser  # noqa: E402

TILLER = os.environ["TILLER_COMMAND"]
APPROVED = Path(__file__).parent / "approved"
# Lanes that every x86-64 processor has, so that all of them show the same run. Elsewhere what the machine has is taken.
SIMULATED = ("--sim", "--quiet", "--alarm-seconds", 0)
ENVIRONMENT = os.environ | {"TILLER_ISA": "sse2", "PYTHONDONTWRITEBYTECODE": "1"}
# How fast this machine is; and single rollouts of what a last bit takes anywhere: an acrobot, a hopper that lands.
AXES_ONLY = r"^time of a tick$"
AXES_ONLY_CHAOTIC = AXES_ONLY + r"| from [0-9.]+ s of "


def tiller(*arguments, codes=(0,)) -> None:
    run = subprocess.run([TILLER, *map(str, arguments)], env=ENVIRONMENT, capture_output=True, text=True, check=False)
    if run.returncode not in codes:
        sys.exit(f"tiller {' '.join(map(str, arguments))} ended with {run.returncode}:\n{run.stdout}{run.stderr}")


def record(robot: Path, folder: Path, name: str, seed: int, seconds: float) -> Path:
    file = folder / f"{name}.mcap"
    tiller("run", robot, *SIMULATED, "--seconds", seconds, "--seed", seed, "--record", file)
    return file


def page_of_run(robot: Path, folder: Path, seconds: float = 2) -> Path:
    tiller("run", robot, *SIMULATED, "--seconds", seconds, "--report", folder / "run.html")
    return folder / "run.html"


def page_of_reference(robot: Path, folder: Path) -> Path:
    """The quadrotor on half of an ellipse, round an obstacle that touches the way."""
    rows = ["time_s,x_m,z_m,tilt_rad,x_m_s,z_m_s,tilt_rad_s"]
    for k in range(151):
        phase = math.pi * k / 150
        rows.append(f"{0.02 * k},{-0.25 - 0.75 * math.cos(phase)},{0.5 * math.sin(phase)},0,"
                    f"{0.785 * math.sin(phase)},{0.524 * math.cos(phase)},0")
    (folder / "ellipse.csv").write_text("\n".join(rows) + "\n")
    text = robot.read_text(encoding="utf-8").replace("[cost]", """[cost]
reference = "ellipse.csv"
obstacles = [{ x_state = "x_m", y_state = "z_m", x_m = -0.25, y_m = 0.2, radius_m = 0.2, weight = 100 }]""")
    (folder / "reference.toml").write_text(text, encoding="utf-8")
    return page_of_run(folder / "reference.toml", folder, 3)


def page_of_demo(_: Path, folder: Path) -> Path:
    tiller("demo", "--fast", "--seconds", 3, "--out", folder)
    return folder / "demo.html"


def page_of_identify(robot: Path, folder: Path) -> Path:
    one, other = (record(robot, folder, name, seed, 3) for name, seed in (("one", 1), ("other", 2)))
    tiller("identify", robot, one, "--hold-out", other, "--particles", 128, "--window", 32, "--moves", 8, "-o", folder)
    return folder / "identify.html"


def page_of_gap(robot: Path, folder: Path) -> Path:
    # short: a robot that has arrived stands still, which tells nothing
    logs = [record(robot, folder, name, seed, 2.5) for seed, name in enumerate(("one", "two", "three", "four"), 1)]
    tiller("gap", robot, *logs, "-o", folder, codes=(0, 1, 2, 3))  # every verdict has a page
    return folder / "gap.html"


def figures_of_gap(result: dict) -> list[str]:
    """A line "title | x | y" for each figure that the page owes the result."""
    axes = {"position": "position", "velocity": "velocity", "input": "command", "input_rate": "change of the command",
            "time": "time", "input_sign_square": "direction of movement times load"}
    lines = []
    if result["horizons"]:
        lines.append("error of rollouts on held-out windows | length of the rollout (s) | RMS error (σ)")
    maps = result["where"]["maps"]
    lines += [f"{m['joint']}: over {axes[m['axis']]} | {m['axis_label']} | residual {m['force']}" for m in maps]
    if maps:
        lines.append("what chance would give | evidence of the strongest map | density")
        lines += [f"{f['joint']}: the force that the model lacks | time (s) | {f['force']}"
                  for f in result["where"]["forces"]]
    if len(result["ranking"]) > 1:
        lines.append("log density behind the best | nats | explanation")
    for p in result["ranking"][0]["parameters"] if result["ranking"] else []:
        if not p["fixed"] and p["sd"]:
            unit = f" ({p['unit'].replace('^2', '²')})" if p["unit"] not in ("", "1") else ""
            lines.append(f"{p['name']} | {p['name']}{unit} | fit")
    names = [channel["name"] for channel in result["data"]["channels"]] + result["robot"]["inputs"]
    return lines + [f"{Path(o['log']).name} from {o['first_time_s']:.2f} s | time (s) | {', '.join(names)}"
                    for o in result["overlays"]]


def gap_differences(figures: list[dict], folder: Path) -> list[str]:
    return look.missing_and_extra(figures, figures_of_gap(json.loads((folder / "gap.json").read_text())))


def approved_differences(figures: list[dict], file: Path) -> list[str]:
    if os.environ.get("TILLER_APPROVE"):
        file.write_text(text_of(figures), encoding="utf-8")
    if not file.exists():
        return [f"nothing is approved: look at the page, then run again with TILLER_APPROVE=1 to make {file}"]
    approved = json.loads(file.read_text(encoding="utf-8"))
    return look.differences(figures, approved, look.SAME_TASK,
                            AXES_ONLY_CHAOTIC if re.search("acrobot|hopper", file.stem) else AXES_ONLY)


def innovation_faults(folder: Path) -> list[str]:
    """Every measured value of the log has an innovation, but for those before the posterior has begun.

    A measured attitude has three: its turn from the prediction, under x, y and z.
    """
    with open(folder / "run.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    faults = []
    measured = json.loads((folder / "run.json").read_text())["columns"]["measured"]
    for name in measured:
        if name.endswith("_w") and {name[:-1] + axis for axis in "xyz"} <= set(measured):
            continue
        there = sum(1 for row in rows if row[f"innovation.{name}"])
        if there < 0.9 * sum(1 for row in rows if row[name]):
            faults.append(f"{name}: {there} innovations in {len(rows)} rows")
    return faults


PAGES = {"run": page_of_run, "reference": page_of_reference, "demo": page_of_demo, "identify": page_of_identify,
         "gap": page_of_gap}


def text_of(figures: list[dict]) -> str:
    """A line a figure, so that a change of the approved file can be read."""
    return "[\n" + ",\n".join(json.dumps(figure, ensure_ascii=False) for figure in figures) + "\n]\n"


def look_at(file: Path, folder: Path) -> tuple[list[dict], list[str]]:
    """Its figures, and what is wrong with it whatever it shows."""
    browser = Browser(folder, file)
    on_a_phone = browser.look(width=420, height=400)[0]
    probe, picture = browser.look()
    return look.measure(probe, picture), look.faults(probe, picture) + [
        f"wider than a phone: {what}" for what in on_a_phone["wide"]]


def main(kind: str, robot: Path, folder: Path) -> int:
    if not CHROMIUM:
        print("no chromium: ./dev setup installs it")
        return 77
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    figures, found = look_at(PAGES[kind](robot, folder), folder)
    found += gap_differences(figures, folder) if kind == "gap" else approved_differences(
        figures, APPROVED / f"{kind}_{robot.stem}.json")
    found += innovation_faults(folder) if kind == "run" else []
    for text in found:
        print(text)
    print(f"{len(figures)} figures; the page and its picture: {folder}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])))
