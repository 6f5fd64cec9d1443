"""What inverse dynamics leaves of the TX40's measured torques, by pinocchio and least squares: bench/drivers/tx40.py.

    tx40_judge.py FOLDER [FITTED.json]

FOLDER as published. Reads nothing that tiller wrote but FITTED.json: {"armature": [6], "inertia_SI": [6], "damping_SI":
[6], "friction_SI": [6], "force_SI": [6]}, as fitted there. Prints one line of JSON: by model the RMS of what is left at
each motor, in the file's unit, and the least-squares friction. All under one zero-phase filter of 40 Hz; Coulomb friction
is tanh(v / 0.02 rad/s), without sticking.
"""

import json
import pathlib
import sys

import numpy
import pinocchio

ROWS_PER_S, CUT_HZ, EDGE, EVERY = 5000, 40.0, 400, 50
GEARS = numpy.diag([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])
GEARS[5, 4] = 32.0  # motors = GEARS x joints
ZEROS = numpy.array([0.0, -numpy.pi / 2, numpy.pi / 2, 0.0, 0.0, 0.0])
# thanhndv212/figaroh-examples (c0b5c7f), examples/staubli_TX40/config
PUBLISHED = {"damping_SI": [8.05, 5.53, 1.97, 1.11, 1.86, 0.65], "friction_SI": [7.14, 8.26, 6.34, 2.48, 3.03, 0.282],
             "inertia_SI": [0.362, 0.362, 0.0988, 0.0313, 0.0468, 0.0105],
             "force_SI": [0.392, 1.37, 0.326, -0.102, -0.0288, 0.127]}
WRIST = {"inertia_SI": 0.00964, "damping_SI": 0.616, "friction_SI": 1.95}


def smooth(x):
    """Zero phase: a Gaussian over the frequencies, of the signal and its point reflection at both ends."""
    head, tail = 2 * x[:1] - x[EDGE:0:-1], 2 * x[-1:] - x[-2:-EDGE - 2:-1]
    longer = numpy.concatenate([head, x, tail])
    line = numpy.linspace(longer[0], longer[-1], len(longer))  # what is periodic has no step at its ends
    frequency = numpy.fft.rfftfreq(len(longer), 1 / ROWS_PER_S)
    weight = numpy.exp(-0.5 * numpy.log(2) * (frequency / CUT_HZ) ** 2)[:, None]
    return (numpy.fft.irfft(numpy.fft.rfft(longer - line, axis=0) * weight, len(longer), axis=0) + line)[EDGE:EDGE + len(x)]


def motion(folder):
    read = lambda name: numpy.loadtxt(folder / name, delimiter=",", skiprows=1)
    q = smooth(read("pos_read_data.csv") @ numpy.linalg.inv(GEARS).T + ZEROS)
    torque = smooth(read("curr_data.csv") @ GEARS)
    v = numpy.gradient(q, 1 / ROWS_PER_S, axis=0)
    a = numpy.gradient(v, 1 / ROWS_PER_S, axis=0)
    rows = slice(EDGE, -EDGE, EVERY)
    return q[rows], v[rows], a[rows], torque[rows]


def dry(v):
    return numpy.tanh(v / 0.02)


def own_friction(law, v, a):
    get = lambda name: numpy.array(law.get(name, [0.0] * 6))
    return (get("armature") + get("inertia_SI")) * a + get("damping_SI") * v + get("friction_SI") * dry(v) + get("force_SI")


def wrist_friction(v, a):
    """Of motor 6, which turns by q5 + q6: the same torque at both joints, but for the inertia across."""
    turned = v[:, 4] + v[:, 5]
    both = WRIST["damping_SI"] * turned + WRIST["friction_SI"] * dry(turned)
    torque = numpy.zeros_like(v)
    torque[:, 4] = both + WRIST["inertia_SI"] * a[:, 5]
    torque[:, 5] = both + WRIST["inertia_SI"] * a[:, 4]
    return torque


def least_squares(rest, v, a, wrist):
    """(prediction, coefficients by joint): inertia, viscous, Coulomb, offset at each joint by itself."""
    guess, found = numpy.zeros_like(rest), []
    turned = v[:, 4] + v[:, 5]
    for j in range(6):
        columns = [a[:, j], v[:, j], dry(v[:, j]), numpy.ones(len(v))]
        if wrist and j > 3:
            columns += [turned, dry(turned), a[:, 9 - j]]
        columns = numpy.stack(columns, 1)
        x = numpy.linalg.lstsq(columns, rest[:, j], rcond=None)[0]
        guess[:, j] = columns @ x
        found.append([float(value) for value in x])
    return guess, found


def main():
    folder = pathlib.Path(sys.argv[1])
    q, v, a, torque = motion(folder)
    model = pinocchio.buildModelFromUrdf(str(folder / "tx40_mdh_modified.urdf"))
    data = model.createData()
    body = numpy.array([pinocchio.rnea(model, data, *row) for row in zip(q, v, a)])
    rest = torque - body
    # the published viscous friction of joints 5 and 6 holds the wrist's: what the data say (least squares, "wrist")
    own = dict(PUBLISHED, damping_SI=[f - (WRIST["damping_SI"] if j > 3 else 0) for j, f in enumerate(PUBLISHED["damping_SI"])])
    alone, alone_found = least_squares(rest, v, a, False)
    coupled, coupled_found = least_squares(rest, v, a, True)
    guesses = {"measured": -body, "rigid body": numpy.zeros_like(rest), "published": own_friction(PUBLISHED, v, a) + wrist_friction(v, a),
               "published, viscous as sums": own_friction(own, v, a) + wrist_friction(v, a),
               "least squares": alone, "least squares, wrist": coupled}
    if len(sys.argv) > 2:
        guesses["tiller"] = own_friction(json.loads(pathlib.Path(sys.argv[2]).read_text(encoding="utf-8")), v, a)
    back = numpy.linalg.inv(GEARS)
    left = {name: [float(x) for x in numpy.sqrt((((rest - guess) @ back) ** 2).mean(0))] for name, guess in guesses.items()}
    print(json.dumps({"left": left, "least_squares": alone_found, "wrist": coupled_found}))


if __name__ == "__main__":
    main()
