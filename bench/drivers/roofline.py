# programs: bench_roofline tiller_python
"""./dev bench roofline: what kernels attain of what the machine can, for each instruction set; batched rollouts.

    --rounds N        of the batched rollouts, by turns with copies (15)
    --build DIR ...   builds of bench_roofline (build/release): each instruction set is measured in the first that has it,
                      unless it was since that build (build/bench_peers/roofline_*.jsonl)
    --write           docs/evidence/roofline.md and docs/images/roofline.png anew

Work is counted: a call of a kernel runs in single steps (bench_roofline.cpp), and every instruction that was executed
counts by its disassembly. An add, multiply, divide or square root of one number is one operation, a fused
multiply-add two; comparisons, minima, conversions and integers are none. Bytes are those of every operand in memory,
which the first-level cache serves. The roof of a kernel is the smaller of the fused multiply-adds that the processor
makes in registers and of its operations a byte times the rate of copies within the first-level cache.
"""

import argparse
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile

from _driver import HOME, ONE_THREAD, ROOT, note, summary

PACKAGE = ROOT / "build/release/python_package"
SETS = ("sse2", "avx2", "avx512")
WIDTH = {"x": 16, "y": 32, "z": 64}
OPERATION = re.compile(r"^v?(add|sub|mul|div|sqrt|fn?m(?:add|sub)(?:132|213|231))([ps])([sd])$")
OPERAND = re.compile(r"\b(?:([XYZ])MMWORD|(QWORD|DWORD|WORD|BYTE)) (?:PTR|BCST)")
SIZE = {"QWORD": 8, "DWORD": 4, "WORD": 2, "BYTE": 1}
GOAL = 0.5  # of the copy's rate, for a million states of a bare model
ROWS = []


# ---- counting --------------------------------------------------------------------------------------


def weigh(mnemonic, operands):
    """(floating-point operations, bytes of memory) of one instruction in Intel's syntax."""
    flops, found = 0, OPERATION.match(mnemonic)
    if found:
        register = re.search(r"\b([xyz])mm", operands)
        lanes = WIDTH[register[1]] // (4 if found[3] == "s" else 8) if found[2] == "p" else 1
        flops = lanes * (2 if found[1].startswith("f") else 1)
    memory = OPERAND.search(operands)
    if memory is None or mnemonic.startswith(("lea", "nop", "prefetch", "cs", "data16")):
        return flops, 0
    return flops, WIDTH[memory[1].lower()] if memory[1] else SIZE[memory[2]]


def weights_of(program):
    """address -> weight, of all instructions that have one."""
    weights = {}
    with subprocess.Popen(["objdump", "-d", "-M", "intel", "--no-show-raw-insn", str(program)], stdout=subprocess.PIPE,
                          text=True) as process:
        for line in process.stdout:
            found = re.match(r"^ +([0-9a-f]+):\t(?:\{\w+\} |rep\w* |lock |bnd |notrack )*(\S+) *(.*)$", line)
            if found:
                weight = weigh(found[2], found[3].split("#")[0])
                if weight != (0, 0):
                    weights[int(found[1], 16)] = weight
    return weights


def sets_of(program):
    return subprocess.run([str(program), "--sets"], stdout=subprocess.PIPE, text=True, check=True).stdout.split()


def measure(isa, program, weights):
    """(peaks, kernels) of an instruction set."""
    kept = HOME / f"roofline_{isa}.jsonl"
    if not kept.exists() or kept.stat().st_mtime < program.stat().st_mtime:
        note(f"{isa}: times, then single steps (some minutes)")
        out = subprocess.run([str(program)], stdout=subprocess.PIPE, text=True, check=True,
                             env=dict(os.environ, TILLER_ISA=isa, **ONE_THREAD)).stdout
        HOME.mkdir(parents=True, exist_ok=True)
        kept.write_text(out, encoding="utf-8")
    peaks, *kernels = (json.loads(line) for line in kept.read_text(encoding="utf-8").splitlines())
    for k in kernels:
        steps = {int(at, 16): times for at, times in k.pop("executed").items()}
        for what, index in (("flops", 0), ("bytes", 1)):
            k[what] = sum(times * weights.get(at, (0, 0))[index] for at, times in steps.items()) / k["counted"]
        k["instructions"] = (sum(steps.values()) + k["elsewhere"]) / k["counted"]
        k["outside"] = k["elsewhere"] / k["counted"] / k["instructions"]
        k["rate"] = k["flops"] / k["seconds"]
    return peaks, kernels


def bound(k, peaks):
    """The roof of a kernel."""
    k["roof"] = min(peaks["f64_flops" if k["doubles"] else "f32_flops"], k["flops"] / k["bytes"] * peaks["near_bytes"])
    if k["far_bytes"]:
        k["roof"] = min(k["roof"], k["flops"] / k["far_bytes"] * peaks["far_bytes"])


# ---- batched rollouts ------------------------------------------------------------------------------

BATCH = r"""
import json, sys, time
import numpy as np, tiller
path, rounds = sys.argv[1], int(sys.argv[2])
robot = tiller.Robot.from_toml(path)
def clock(call):
    begin = time.process_time(); call(); return time.process_time() - begin
for lanes, steps in ((1_000_000, 1), (20_000, 50)):
    x = np.full((lanes, 4), 0.1, np.float32)
    u = np.random.default_rng(1).uniform(-1, 1, (lanes, steps, 1)).astype(np.float32)
    out = np.empty((lanes, steps + 1, 4), np.float32)
    size = x.nbytes + u.nbytes + out.nbytes
    of, to = np.ones(size // 16), np.empty(size // 16)
    calls = [lambda threads=threads: tiller.rollout(robot, x, u, dtype=np.float32, threads=threads, out=out)
             for threads in (1, 2)] + [lambda: np.copyto(to, of)]
    one, two, copy = (min(times) for times in zip(*([clock(call) for call in calls] for _ in range(rounds))))
    print(json.dumps({"lanes": lanes, "steps": steps, "ns": one / lanes / steps * 1e9, "bytes": size / lanes / steps,
                      "rate": size / one, "copy": size / copy, "two": two / one}))
"""


def bare(text):
    """The robot without effects, by the cheapest integrator: the least that a step may take."""
    text = re.sub(r"^\[\[effects\]\]\n(?:[^\[\n].*\n)*", "", text, flags=re.M)
    return text.replace('integrator = "rk4"', 'integrator = "semi_implicit_euler"\nsubsteps = 1')


def batches(rounds):
    rows = []
    text = (ROOT / "robots/cart_pole.toml").read_text(encoding="utf-8")
    for name, changed in (("bare, semi-implicit", bare(text)), ("as shipped: friction, RK4", text)):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "robot.toml"
            path.write_text(changed, encoding="utf-8")
            note(f"batched rollouts, {name}")
            done = subprocess.run([sys.executable, "-c", BATCH, str(path), str(rounds)], stdout=subprocess.PIPE, text=True,
                                  check=True, env=dict(os.environ, PYTHONPATH=str(PACKAGE), **ONE_THREAD))
        rows += [dict(json.loads(line), name=name) for line in done.stdout.splitlines()]
    return rows


# ---- the page --------------------------------------------------------------------------------------


def table(measured, batched):
    lines = []
    for isa, (peaks, kernels) in measured.items():
        lines += [f"### {isa}", "",
                  f"Fused multiply-adds: {peaks['f32_flops'] / 1e9:.0f} GF/s in float32, {peaks['f64_flops'] / 1e9:.0f} in "
                  f"float64.\nCopies (read and written): {peaks['near_bytes'] / 1e9:.0f} GB/s within the first-level cache, "
                  f"{peaks['far_bytes'] / 1e9:.1f} GB/s of memory.", "",
                  "| kernel | operations | bytes | operations a byte | instructions | time | GF/s | GB/s | of its roof |",
                  "|---|---|---|---|---|---|---|---|---|"]
        for k in kernels:
            lines.append(f"| {k['kernel']}, a {k['unit']} | {k['flops']:.4g} | {k['bytes']:.4g} | "
                         f"{k['flops'] / k['bytes']:.2f} | {k['instructions']:.4g} | {time_of(k['seconds'])} | "
                         f"{k['rate'] / 1e9:.3g} | {k['bytes'] / k['seconds'] / 1e9:.3g} | {k['rate'] / k['roof']:.0%} |")
        lines.append("")
    lines += ["## Batched rollouts in Python", "",
              "| cart-pole, float32, one thread | a step | bytes a step | GB/s | copies, GB/s | of these | CPU time of two "
              "threads |", "|---|---|---|---|---|---|---|"]
    for b in batched:
        lines.append(f"| {b['name']}: {b['lanes']:,} states, {b['steps']} step{'s' if b['steps'] > 1 else ''} | "
                     f"{b['ns']:.2f} ns | {b['bytes']:.0f} | {b['rate'] / 1e9:.2f} | {b['copy'] / 1e9:.2f} | "
                     f"{b['rate'] / b['copy']:.0%} | {b['two']:.2f} |")
    return "\n".join(lines) + "\n"


def time_of(seconds):
    return f"{seconds * 1e9:.3g} ns" if seconds < 1e-6 else f"{seconds * 1e6:.3g} us"


def draw(measured, path):
    sys.path.insert(0, str(ROOT / "tools/python"))
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, len(measured), figsize=(5.2 * len(measured), 5.6), sharey=True, layout="constrained")
    marks = "osD*^vPX"
    for axis, (isa, (peaks, kernels)) in zip([axes] if len(measured) == 1 else axes, measured.items()):
        x = [2.0 ** (i / 8) for i in range(-32, 41)]
        for kind, style in (("f32", "-"), ("f64", "--")):
            axis.plot(x, [min(peaks[f"{kind}_flops"], v * peaks["near_bytes"]) / 1e9 for v in x], style, color="#22262b",
                      label=f"first-level cache, {'float32' if kind == 'f32' else 'float64'}")
        axis.plot(x, [min(peaks["f32_flops"], v * peaks["far_bytes"]) / 1e9 for v in x], ":", color="#8b929a", label="memory")
        for mark, k in zip(marks, kernels):
            bytes_moved = k["far_bytes"] or k["bytes"]
            axis.plot(k["flops"] / bytes_moved, k["rate"] / 1e9, mark, markersize=8, label=k["kernel"],
                      color="#d0521b" if k["doubles"] else "#1f5fa8", markerfacecolor="none" if k["far_bytes"] else None)
        axis.set(xscale="log", yscale="log", ylim=(2, 200), xlabel="operations a byte", title=isa)
        axis.grid(True, color="#e9ebee")
    first = axes if len(measured) == 1 else axes[0]
    first.set_ylabel("GF/s")
    handles, labels = first.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    figure.savefig(path, dpi=80)


def write(text, measured):
    page = ROOT / "docs/evidence/roofline.md"
    kept = page.read_text(encoding="utf-8").split("## Measured", 1)[0]
    page.write_text(kept + "## Measured\n\n" + text, encoding="utf-8")
    draw(measured, ROOT / "docs/images/roofline.png")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--build", type=pathlib.Path, nargs="+", default=[ROOT / "build/release"])
    parser.add_argument("--write", action="store_true")
    asked = parser.parse_args()
    measured = {}
    for program in (build / "bench/bench_roofline" for build in asked.build):
        weights = weights_of(program)
        for isa in sets_of(program):
            if isa not in measured:
                measured[isa] = measure(isa, program, weights)
    measured = {isa: measured[isa] for isa in SETS if isa in measured}
    far = max(peaks["far_bytes"] for peaks, _ in measured.values())  # the memory is the same for all
    for peaks, kernels in measured.values():
        peaks["far_bytes"] = far
        for k in kernels:
            bound(k, peaks)
    batched = batches(asked.rounds)
    text = table(measured, batched)
    print(text)
    for b in batched:
        if b["steps"] == 1 and b["name"].startswith("bare"):
            share = b["rate"] / b["copy"]
            ROWS.append({"section": "roofline", "heading": "batched rollouts", "unit": "", "goal": f">= {GOAL}",
                         "row": "a million states a call over copies of as many bytes",
                         "figure": share, "met": share >= GOAL})
    outside = max(k["outside"] for _, kernels in measured.values() for k in kernels)
    print(f"instructions in other libraries, whose operations and bytes are not counted: {outside:.1%} of a kernel at most")
    if asked.write:
        write(text, measured)
    summary(ROWS)


if __name__ == "__main__":
    main()
