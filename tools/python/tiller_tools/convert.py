"""Measured data of others into logs that tiller reads.

    python -m tiller_tools.convert emps FOLDER OUT [--pulses]
    python -m tiller_tools.convert xl330 FOLDER OUT
    python -m tiller_tools.convert sts3250 FOLDER OUT
    python -m tiller_tools.convert tx40 FOLDER OUT

emps: DATA_EMPS.mat (with --pulses DATA_EMPS_PULSES.mat instead) of the Electro-Mechanical Positioning System, A. Janot,
M. Gautier, M. Brunot, "Data set and reference models of EMPS", nonlinear system identification workshop 2019. One CSV:
time_s, position_m (measured), reference_m, force_N = gtau x vir, of the test data also pulse_N.

xl330: the 6 s logs of a Dynamixel XL330 on a pendulum (Rhoban/bam, Apache-2.0; M. Duclusaud, G. Passault, V. Padois,
O. Ly, "Extended friction models for the physics simulation of servo actuators", arXiv 2410.08650). One CSV a log, named
by its gain and trajectory: time_s, angle_rad, rate_rad_s (the servo's own estimate, filtered), duty, volts, torque_Nm =
duty x volts x the servo's torque per volt at standstill by its data sheet (NM_PER_VOLT), goal_rad. Rows in which the
servo was switched off are left out: its windings are open then, another machine.

sts3250: logs of a Feetech STS3250 in position mode on a pendulum, of the same repository and form. One CSV a log:
time_s, angle_rad, rate_rad_s, volts, goal_rad, the position that the servo is told; it tells no torque.

tx40: a Staubli TX40, six joints that move at once (thanhndv212/figaroh-examples, examples/staubli_TX40):
pos_read_data.csv (motor positions, rad) and curr_data.csv (motor torques in N m, by their size; named currents), 5 kHz
without stamps, and tx40_mdh_modified.urdf. One CSV at 200 Hz: time_s, joint_1_rad .. joint_6_rad at the row's instant,
joint_1_Nm .. joint_6_Nm, means from the row to the next, without the standstill at the end; beside it tx40.urdf, a copy, and tx40.toml, a robot file for the
model that `tiller import OUT/tx40.urdf -o OUT/model --armature ..` writes (its head has the line).
"""

import argparse
import csv
import json
import math
import pathlib
import shutil
import sys

# XL330-M288-T, robotis.com: stall torque 0.52 N m at 5 V
NM_PER_VOLT = 0.52 / 5.0
PWM_LIMIT = 885.0

# TX40: motor positions = GEARS x joint positions; motor 6 turns with joint 5 too (the wrist). Zeros as the URDF has them.
TX40_JOINTS = 6
TX40_GEARS = [32.0, 32.0, 45.0, -48.0, 45.0, 32.0]
TX40_WRIST = 32.0  # motor 6 over joint 5
TX40_ZEROS_RAD = [0.0, -1.5707963267948966, 1.5707963267948966, 0.0, 0.0, 0.0]
TX40_ROWS_PER_S = 5000
TX40_MERGED = 25  # rows: 5 ms
TX40_STILL_RAD = 0.002  # from where the arm stands in the end; what comes after is standstill, which tells nothing


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


def servo_logs(folder):
    """Of each log its settings and the rows in which the servo was on."""
    sources = sorted(folder.glob("*.json"))
    if not sources:
        raise FileNotFoundError(f"no *.json in {folder}")
    for source in sources:
        log = json.loads(source.read_text(encoding="utf-8"))
        yield log, [e for e in log["entries"] if e["torque_enable"]]


def xl330(folder, out):
    for log, rows in servo_logs(folder):
        duty = [max(-1.0, min(1.0, signed(e["load"]) / PWM_LIMIT)) for e in rows]
        volts = [e["input_volts"] for e in rows]
        write(out / f"xl330_kp{log['kp']:03d}_{log['trajectory']}.csv",
              ["time_s", "angle_rad", "rate_rad_s", "duty", "volts", "torque_Nm", "goal_rad"],
              [[e["timestamp"] for e in rows], [e["position"] for e in rows], [e["speed"] for e in rows], duty, volts,
               [d * v * NM_PER_VOLT for d, v in zip(duty, volts)], [e["goal_position"] for e in rows]])


def sts3250(folder, out):
    for log, rows in servo_logs(folder):
        write(out / f"sts3250_kp{log['kp']:03d}_{log['trajectory']}.csv",
              ["time_s", "angle_rad", "rate_rad_s", "volts", "goal_rad"],
              [[e[name] for e in rows] for name in ("timestamp", "position", "speed", "input_volts", "goal_position")])


def numbers_of(path, columns):
    """The columns of a CSV with a header, as floats; refuses rows of another length and what is no number."""
    with open(path, encoding="utf-8", newline="") as file:
        rows = csv.reader(file)
        header = next(rows, [])
        if len(header) != columns:
            raise ValueError(f"{path.name}: {len(header)} columns; {columns} are expected, one for each motor")
        table = []
        for row in rows:
            try:
                values = [float(cell) for cell in row]
            except ValueError as why:
                raise ValueError(f"{path.name}:{rows.line_num}: {why}") from None
            if len(values) != columns or not all(map(math.isfinite, values)):
                raise ValueError(f"{path.name}:{rows.line_num}: {columns} finite numbers are expected")
            table.append(values)
    return table


def joint_positions(motor):
    """Joint angles of the URDF from motor angles: the wrist's coupling first, then gears and zeros."""
    joints = [angle / gear for angle, gear in zip(motor, TX40_GEARS)]
    joints[5] -= TX40_WRIST * joints[4] / TX40_GEARS[5]
    return [angle + zero for angle, zero in zip(joints, TX40_ZEROS_RAD)]


def joint_torques(motor):
    """What motor torques do at the joints: the transpose of the gears, by virtual work."""
    joints = [torque * gear for torque, gear in zip(motor, TX40_GEARS)]
    joints[4] += TX40_WRIST * motor[5]
    return joints


def tx40(folder, out):
    motors, torques = (numbers_of(folder / name, TX40_JOINTS) for name in ("pos_read_data.csv", "curr_data.csv"))
    if len(motors) != len(torques):
        raise ValueError(f"pos_read_data.csv has {len(motors)} rows and curr_data.csv {len(torques)}: not of one run")
    # The mean torque over the rows that follow is the impulse that moves the joints from one kept position to the next:
    # a filter's bandwidth would be one thing more to know.
    starts = range(0, len(motors) - TX40_MERGED + 1, TX40_MERGED)
    mean = lambda at, motor: math.fsum(row[motor] for row in torques[at:at + TX40_MERGED]) / TX40_MERGED
    rows = [[at / TX40_ROWS_PER_S, *joint_positions(motors[at]),
             *joint_torques([mean(at, motor) for motor in range(TX40_JOINTS)])] for at in starts]
    end = rows[-1][1:TX40_JOINTS + 1]
    moves = [max(abs(a - b) for a, b in zip(row[1:], end)) > TX40_STILL_RAD for row in rows]
    rows = rows[:len(moves) - moves[::-1].index(True) + 1] if any(moves) else rows
    names = [f"joint_{joint + 1}_{unit}" for unit in ("rad", "Nm") for joint in range(TX40_JOINTS)]
    write(out / "tx40.csv", ["time_s", *names], zip(*rows))
    for source, copy in ((folder / "tx40_mdh_modified.urdf", "tx40.urdf"),
                         (pathlib.Path(__file__).with_name("tx40.toml"), "tx40.toml")):
        shutil.copyfile(source, out / copy)
        print(out / copy)


SOURCES = {"emps": emps, "xl330": xl330, "sts3250": sts3250, "tx40": tx40}


def main():
    parser = argparse.ArgumentParser(prog="tiller_tools.convert", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", choices=SOURCES)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--pulses", action="store_true")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    try:
        SOURCES[args.source](args.folder, args.out, *([args.pulses] if args.source == "emps" else []))
    except (OSError, KeyError, ValueError) as why:
        print(f"convert: {args.folder}: {why}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
