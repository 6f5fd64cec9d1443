"""Follows docs/guide to the letter: every `tiller` command of a code block runs, with the files that the pages speak of.

    guide_test.py SOURCE TILLER WORK

A command passes if it exits with a code that its page allows. Commands that steer a robot get one: a plant that `tiller
sim` serves over LCM. Runs without an end are given one (`--seconds`), searches few trials. Synopses (with [OPTIONAL] or
PLACEHOLDER words) are not run; their options must be in the command's help.
"""

import pathlib
import re
import shutil
import subprocess
import sys
import time

SOURCE, TILLER, WORK = (pathlib.Path(a) for a in sys.argv[1:4])
# 0..3 are verdicts of `tiller gap`; 2 of `tiller excite` says that no input separates a pair.
ALLOWED = {"gap": {0, 1, 2, 3}, "excite": {0, 2}}
SECONDS = "3"
FEW_TRIALS = "--trials 3 --seconds 1 --train 1 --test 1"
FOLLOWED = set()
HIDDEN = {"mine": 1.0, "pendulum": 0.1}  # N, Nm


def blocks(text):
    """Lines of fenced and indented code, blocks apart by ''."""
    fenced = False
    for line in text.splitlines():
        if line.startswith("```"):
            fenced = not fenced
            yield ""
        elif fenced:
            yield line
        elif line.startswith("    "):
            yield line[4:]
        else:
            yield ""


def commands(text):
    """Commands of a page that begin with `tiller`, continued lines joined, comments cut."""
    found, open_line = [], ""
    for line in blocks(text):
        line = re.sub(r"\s+#.*$", "", line.strip())
        if open_line or line.startswith("tiller "):
            open_line += " " + line.rstrip("\\").strip()
            if not line.endswith("\\"):
                found.append(open_line.strip())
                open_line = ""
    return found


def is_synopsis(command):
    """What needs MuJoCo, which is no package of this environment, counts as one: import_contact_tasks runs it."""
    return "[" in command or re.search(r"\b[A-Z]{3,}\b", command) is not None or "examples/contacts/" in command


def run(command, limit_s=300):
    done = subprocess.run(command, shell=isinstance(command, str), cwd=WORK, capture_output=True, text=True, check=False,
                          timeout=limit_s)
    return done.returncode, done.stdout + done.stderr


def must(command):
    code, told = run(command)
    if code != 0:
        sys.exit(f"preparation failed ({code}): {command}\n{told}")


def prepare():
    """The reader's folder: a robot file from the quick start, a robot with a model of its own, logs."""
    shutil.rmtree(WORK, ignore_errors=True)
    (WORK / "bin").mkdir(parents=True)
    (WORK / "bin/tiller").symlink_to(TILLER)
    for folder in ["robots", "data", "examples"]:
        (WORK / folder).symlink_to(SOURCE / folder)
    page = (SOURCE / "docs/guide/quick_start.md").read_text(encoding="utf-8")
    mine = page.split("```toml\n", 1)[1].split("```", 1)[0]
    (WORK / "my_robot.toml").write_text(mine, encoding="utf-8")
    pendulum = (SOURCE / "robots/pendulum.toml").read_text(encoding="utf-8")
    # calibrate.md draws this box
    box = '[probe]\nbox = { "angle_rad" = [-0.8, 0.8], "rate_rad_s" = [-6, 6], "torque_Nm" = [-1.5, 1.5] }\n'
    (WORK / "robot.toml").write_text(f'{pendulum}\n{box}[transport]\nkind = "lcm"\n', encoding="utf-8")
    # Logs of robots that have friction which their files do not name, one truth for all logs of a robot.
    for name, text, port in (("mine", mine, "cart"), ("pendulum", pendulum, "joint")):
        text = text.replace("draw = true", "")
        hidden = f'\n[[sim.effects]]\nkind = "coulomb_friction"\nport = "{port}"\nfriction_SI = {HIDDEN[name]}\n'
        (WORK / f"{name}_with_friction.toml").write_text(text + hidden, encoding="utf-8")
    shutil.copytree(SOURCE / "examples/own_model", WORK / "my_robot")
    shutil.copy(SOURCE / "examples/from_urdf/my_arm.urdf", WORK)
    (WORK / "nightly").mkdir()
    for i in ("1", "2", "3"):
        for robot, log in (("mine", f"run{i}.csv"), ("pendulum", f"nightly/run{i}.csv")):
            must([TILLER, "run", f"{robot}_with_friction.toml", "--sim", "--seconds", "8", "--seed", i, "--log", log])
    for i, name in (("1", "log.csv"), ("2", "other.csv")):
        must([TILLER, "run", "my_robot/robot.toml", "--sim", "--seconds", "8", "--seed", i, "--log", name])
    code, told = run([TILLER, "gap", "robot.toml", *(f"nightly/run{i}.csv" for i in (1, 2, 3)), "-o", "report"])
    if code not in ALLOWED["gap"]:
        sys.exit(f"preparation failed ({code}): {told}")


class Robot:
    """A plant over LCM for a command that steers, and nothing for others."""

    def __init__(self, command, robot):
        self.plant = None
        if re.match(r"tiller (run (?!.*--sim)|policy .*--on-robot)", command):
            lockstep = ["--lockstep"] if "--lockstep" in command else []
            self.plant = subprocess.Popen([TILLER, "sim", robot, "--serve", "lcm", *lockstep], cwd=WORK,
                                          stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.plant:
            self.plant.terminate()
            self.plant.wait()


def check_synopsis(command):
    """Options behind ` -- `, and those in quotes, are another program's."""
    own = re.sub(r'"[^"]*"', "", command.split(" -- ")[0])
    words = own.split()
    subcommand = [words[2]] if words[1] == "fleet" else []
    code, told = run([TILLER, words[1], *subcommand, "--help"])
    missing = [option for option in re.findall(r"--[a-z-]+", own) if option not in told]
    return code == 0 and not missing, f"not in its help: {missing}"


def bounded(command):
    endless = re.match(r"tiller (run|sim|demo) ", command + " ") and "--seconds" not in command
    if "--on-robot" in command:  # nobody presses a key
        return re.sub(r"--trials \d+", "--trials 1 --bumps 5 --evaluations 3 --restarts 0 --arm", command)
    if "adaptive_" in command:  # its defaults are eight trials of four seconds, twice
        return re.sub(r"--earlier \d+", "--earlier 6", command) + " --trials 1 --seconds 1"
    if command.startswith("tiller tune ") and "--trials" not in command:
        return f"{command} {FEW_TRIALS}"
    if shown := re.search(r"--view (rerun|foxglove)", command):  # nobody looks at a window
        command = command.replace(" --real-time", "")
        if "--view-file" not in command:
            command += f" --view-file view.{'rrd' if shown[1] == 'rerun' else 'mcap'}"
    elif command.startswith("tiller view "):
        command += " --view-file view.rrd"
    command = command.replace("--robots 200 --odd 5", "--robots 12 --odd 1")  # two hundred logs take minutes
    return command + (f" --seconds {SECONDS}" if endless and "demo" not in command else "")


def follow(command):
    if is_synopsis(command):
        return check_synopsis(command)
    words = command.split()
    if command in FOLLOWED and words[1] == "import":  # the folder is there, from another page
        return True, ""
    FOLLOWED.add(command)
    robot = next((w for w in words if w.endswith(".toml")), "my_robot.toml")
    if command.startswith("tiller replay") and "--through lcm" in command:
        # bits can be expected of a run in simulated time alone
        must([TILLER, "run", "my_robot.toml", "--sim", "--seconds", SECONDS, "--record", "run.mcap"])
        controller = subprocess.Popen([TILLER, "run", "my_robot.toml", "--transport", "lcm", "--arm", "--lockstep"], cwd=WORK,
                                      stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            code, told = run(f"PATH={WORK}/bin:$PATH {command}")
        finally:
            controller.terminate()
            controller.wait()
    else:
        with Robot(command, robot):
            code, told = run(f"PATH={WORK}/bin:$PATH {bounded(command)}")
    return code in ALLOWED.get(words[1], {0}), f"exit code {code}\n{told[-2000:]}"


def main():
    prepare()
    order = ["quick_start", "own_model", "identify", "gap"]
    pages = sorted((SOURCE / "docs/guide").glob("*.md"), key=lambda p: (order + [p.stem]).index(p.stem))
    count, wrong = 0, 0
    for page in pages:
        for command in commands(page.read_text(encoding="utf-8")):
            count += 1
            begun = time.monotonic()
            good, why = follow(command)
            wrong += not good
            print(f"{'ok    ' if good else 'FAILED'} {time.monotonic() - begun:5.1f} s {page.name}: {command}", flush=True)
            if not good:
                print("        " + why.replace("\n", "\n        "))
    print(f"{count} commands, {wrong} failed")
    return 1 if wrong or count < 20 else 0


if __name__ == "__main__":
    sys.exit(main())
