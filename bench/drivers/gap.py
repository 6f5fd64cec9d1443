# programs: bench_gap bench_gap_measured bench_gap_loop bench_gap_residual bench_gap_export
"""./dev bench gap: how often `tiller gap` names what is missing, on data in which it was hidden and on measured
machines.

    ./dev bench gap                        every section for which there are data
    ./dev bench gap sealed --seeds 2       one section; what follows goes to its program (--plants, --kinds, --noises, ..)
    ./dev bench gap --tune sealed          on the tuning seeds, 100001 and up
    ./dev bench gap --quick                a fixed small part

Sections:
    sealed    every kind of the catalogue hidden in ODE plants, three noises; beside an oracle; time and memory
    null      nothing hidden: false alarms
    two       two effects at once
    outside   effects that the catalogue lacks
    mujoco    one effect hidden in machines that MuJoCo simulates, and none (--seeds N, --kinds A,B)
    sindy     PySINDy on the sealed data
    emps      a measured ball-screw axis (--emps FOLDER; never shipped)
    xl330     a measured servo (--xl330 FOLDER)
    dfki      a measured pendulum (data/, or --dfki FOLDER)
    loop      what the new robot file is worth in closed loop
    residual  what is learnt where nothing fits

    --jobs N       processes that share the cases (one a core)
    --emps, --xl330, --dfki FOLDER   data as published; also TILLER_EMPS, TILLER_XL330, TILLER_DFKI (docs/evidence/measured.md)
    --open-test    also opens the EMPS test file, DATA_EMPS_PULSES.mat: once, when nothing is tuned any more
    --plot FILE    picture of the confusion matrix (build/gap/confusion.png)
    --out FOLDER   results.csv with a line for each case (build/gap); a run that was cut goes on from there
    --build DIR    the CMake build folder (build/release)

Every row with a goal stands in the summary at the end, short or not. A short row is no error; a program that fails is.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys

import _gap_confusion as confusion
import _gap_mujoco as mujoco
import _gap_sindy as sindy
from _driver import ROOT, note, run_table, summary

WORLDS = ["sealed", "null", "two", "outside"]
MACHINES = ["emps", "xl330", "dfki"]
OTHERS = {"loop": "bench_gap_loop", "residual": "bench_gap_residual"}
SECTIONS = [*WORLDS, "mujoco", "sindy", *MACHINES, *OTHERS]
TITLES = {"sealed": "one hidden effect", "null": "nothing hidden", "two": "two hidden effects",
          "outside": "hidden effects that the catalogue lacks", "emps": "EMPS", "xl330": "XL330", "dfki": "DFKI pendulum",
          "mujoco": "MuJoCo's machines", "sindy": "PySINDy on the same data", "loop": "closing the loop", "residual": "when nothing fits"}
QUICK = {"sealed": ["--seeds", "1", "--noises", "0.002"], "null": ["--seeds", "1", "--noises", "0.002"]}
# logs of the XL330 that nothing is fitted to
HELD_OUT = "up_and_down"
# swing-ups of the DFKI pendulum with its usual bob; other logs hold spikes of torque (docs/guide/identify.md) or little
# motion
SWING_UPS = ["ddp", "direct_collocation", "ilqr", "sac"]


# ---- measured machines -----------------------------------------------------------------------------


def convert(kind, folder, out, *options):
    """The converted CSVs; none if it fails."""
    done = subprocess.run([sys.executable, "-m", "tiller_tools.convert", kind, str(pathlib.Path(folder).resolve()),
                           str(out.resolve()), *options], cwd=ROOT / "tools/python", stdout=subprocess.PIPE, text=True,
                          check=False)
    return [pathlib.Path(line) for line in done.stdout.split()] if done.returncode == 0 else []


def machine_arguments(section, args):
    """What bench_gap_measured gets; None with a word about it where there are no data."""
    folder = getattr(args, section) or os.environ.get(f"TILLER_{section.upper()}", "")
    if section == "dfki":
        home = pathlib.Path(folder or ROOT / "data/dfki_simple_pendulum")
        if logs := [p for n in SWING_UPS if (p := home / f"{n}_measured.csv").exists()]:
            return ["dfki", *map(str, logs)]
    elif folder:
        out = args.out / section
        logs = convert(section, folder, out)
        if section == "emps" and logs:
            test = convert("emps", folder, out, "--pulses") if args.open_test else []
            return ["emps", str(logs[0]), *(["--hold-out", str(test[0]), "--test", str(test[0])] if test else [])]
        if logs:
            held_out = [str(p) for p in logs if HELD_OUT in p.name]
            return ["xl330", *(str(p) for p in logs if HELD_OUT not in p.name), "--hold-out", *held_out]
    print(f"  NOT MEASURED: no data of {section}; name their folder with --{section} (docs/evidence/measured.md)")
    return None


# ---- driver ----------------------------------------------------------------------------------------


def run_section(section, args):
    """(rows, whether it came to its end)"""
    print(f"\n==== {TITLES[section]}", flush=True)
    programs = args.build / "bench"
    if section in WORLDS:
        arguments = [section, "--out", str(args.out), "--jobs", str(args.jobs), *args.rest]
        arguments += QUICK.get(section, []) if args.quick else []
        return run_table(section, programs / "bench_gap", arguments + (["--tune"] if args.tune else []))
    if section == "sindy":
        return sindy.run(args)
    if section == "mujoco":
        return mujoco.run(mujoco_arguments(args))
    if section in MACHINES:
        arguments = machine_arguments(section, args)
        return run_table(section, programs / "bench_gap_measured", arguments) if arguments else ([], True)
    return run_table(section, programs / OTHERS[section], args.rest)


def mujoco_arguments(args):
    """Its own options are among those that go after the section's name."""
    parser = argparse.ArgumentParser(prog="./dev bench gap mujoco", allow_abbrev=False)
    parser.add_argument("--seeds", type=int, default=1 if args.quick else 2, help="of every kind, plant and noise")
    parser.add_argument("--kinds", type=lambda text: text.split(","), default=[])
    own = parser.parse_args(args.rest if args.sections == ["mujoco"] else [])
    return argparse.Namespace(**{**vars(args), **vars(own)})


def parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter,
                                     usage="./dev bench gap [SECTION ..] [OPTIONS]", allow_abbrev=False)
    for name in ("quick", "tune", "open-test"):
        parser.add_argument(f"--{name}", action="store_true")
    for machine in MACHINES:
        parser.add_argument(f"--{machine}", metavar="FOLDER", default="")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "build/gap")
    parser.add_argument("--plot", type=pathlib.Path)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build/release")
    args, words = parser.parse_known_args([a for a in arguments if a != "--"])
    count = next((i for i, word in enumerate(words) if word not in SECTIONS), len(words))
    named, args.rest = words[:count], words[count:]
    if args.rest and len(named) != 1:
        parser.error(f"'{' '.join(args.rest)}' is no section and no option here; options of a program go after its "
                     f"section, and that alone. Sections: {' '.join(SECTIONS)}")
    args.sections = named or (list(QUICK) if args.quick else SECTIONS)
    if args.quick:
        args.tune, args.out = True, args.out / "quick"
    args.plot = args.plot or args.out / "confusion.png"
    return args


def main():
    args = parse(sys.argv[1:])
    args.out.mkdir(parents=True, exist_ok=True)
    rows, good = [], True
    for section in args.sections:
        found, ended = run_section(section, args)
        rows += found
        good = good and ended
    summary(rows)
    results = args.out / ("tuning.csv" if args.tune else "results.csv")
    if results.exists() and confusion.draw(results, args.plot):
        note(f"confusion matrix: {args.plot}")
    (args.out / "gap.json").write_text(json.dumps(rows, indent=1), encoding="utf-8")
    note(f"rows: {args.out / 'gap.json'}; cases: {results}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
