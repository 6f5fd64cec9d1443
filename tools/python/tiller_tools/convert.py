"""Measured data of others into logs that tiller reads.

    python -m tiller_tools.convert emps FOLDER OUT [--pulses]
    python -m tiller_tools.convert xl330 FOLDER OUT

emps: DATA_EMPS.mat (with --pulses DATA_EMPS_PULSES.mat instead) of the Electro-Mechanical Positioning System, A. Janot,
M. Gautier, M. Brunot, "Data set and reference models of EMPS", nonlinear system identification workshop 2019. One CSV:
time_s, position_m (measured), reference_m, force_N = gtau x vir, of the test data also pulse_N.

xl330: the 6 s logs of a Dynamixel XL330 on a pendulum (Rhoban/bam, Apache-2.0; M. Duclusaud, G. Passault, V. Padois,
O. Ly, "Extended friction models for the physics simulation of servo actuators", arXiv 2410.08650). One CSV a log, named
by its gain and trajectory: time_s, angle_rad, rate_rad_s (the servo's own estimate, filtered), duty, volts, torque_Nm =
duty x volts x the servo's torque per volt at standstill by its data sheet (NM_PER_VOLT), goal_rad. Rows in which the
servo was switched off are left out: its windings are open then, another machine.
"""

import argparse
import csv
import json
import pathlib
import sys

# XL330-M288-T, robotis.com: stall torque 0.52 N m at 5 V
NM_PER_VOLT = 0.52 / 5.0
PWM_LIMIT = 885.0


def write(path, names, columns):
    with open(path, "w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(names)
        rows.writerows([f"{v:.9g}" for v in row] for row in zip(*columns))
    print(path)


def emps(folder, out, pulses=False):
    import scipy.io  # half a second; comes with osqp

    with open(folder / ("DATA_EMPS_PULSES.mat" if pulses else "DATA_EMPS.mat"), "rb") as file:
        data = scipy.io.loadmat(file)
    get = lambda name: data[name].ravel()
    names, columns = ["time_s", "position_m", "reference_m", "force_N"], [
        get("t"), get("qm"), get("qg"), float(data["gtau"].ravel()[0]) * get("vir")]
    if pulses:
        names.append("pulse_N")
        columns.append(get("pulses_N"))
    write(out / ("emps_pulses.csv" if pulses else "emps.csv"), names, columns)


def signed(word):
    """The servo's 16-bit register as the log has it: without its sign."""
    return word - 65536 if word > 32767 else word


def xl330(folder, out):
    sources = sorted(folder.glob("*.json"))
    if not sources:
        raise FileNotFoundError(f"no *.json in {folder}")
    for source in sources:
        log = json.loads(source.read_text(encoding="utf-8"))
        rows = [e for e in log["entries"] if e["torque_enable"]]
        duty = [max(-1.0, min(1.0, signed(e["load"]) / PWM_LIMIT)) for e in rows]
        volts = [e["input_volts"] for e in rows]
        write(out / f"xl330_kp{log['kp']:03d}_{log['trajectory']}.csv",
              ["time_s", "angle_rad", "rate_rad_s", "duty", "volts", "torque_Nm", "goal_rad"],
              [[e["timestamp"] for e in rows], [e["position"] for e in rows], [e["speed"] for e in rows], duty, volts,
               [d * v * NM_PER_VOLT for d, v in zip(duty, volts)], [e["goal_position"] for e in rows]])


def main():
    parser = argparse.ArgumentParser(prog="tiller_tools.convert", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", choices=["emps", "xl330"])
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--pulses", action="store_true")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    try:
        emps(args.folder, args.out, args.pulses) if args.source == "emps" else xl330(args.folder, args.out)
    except (OSError, KeyError, ValueError) as why:
        print(f"convert: {args.folder}: {why}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
