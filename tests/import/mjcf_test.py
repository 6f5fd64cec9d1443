"""mjcf_test.py TILLER FOLDER [--write]: an MJCF through MuJoCo itself, and what the C++ tests have stored of that.

With mujoco: what tiller_tools.mjcf says of FOLDER/machine.xml is what machine.json has, the accelerations in
machine_accelerations.json are MuJoCo's, and the command imports the XML and its .mjb; so with servos.xml and with the
readings of sensors.xml. Without it: the command says how to get it. --write stores all files anew.
"""
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile

STATES, SEED = 40, 7
JOINTS = ["lane", "pan", "tip", "elbow", "grip", "wheel_joint"]
RATIO, OFFSET = 1.5, 0.02 + 0.005 - 1.5 * 0.01  # of the finger that follows: q - 0.02 = 0.005 + 1.5 (p - 0.01)


LOAD_KG, LOAD_KGM2 = 0.7, 0.004  # at the site eye


def load(mujoco, path, loaded=False):
    spec = mujoco.MjSpec.from_file(str(path))
    if loaded:
        eye = spec.site("eye")
        eye.parent.add_body(pos=eye.pos, ipos=[0, 0, 0], mass=LOAD_KG, inertia=[LOAD_KGM2] * 3, explicitinertial=True)
    m = spec.compile()
    for what in ("CONSTRAINT", "ACTUATION", "SPRING", "DAMPER"):  # these are effects of the robot file
        m.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, "mjDSBL_" + what))
    return m


def accelerations(mujoco, m, q, v, force):
    """Of the joints that move by themselves: the follower's by projection, the toy at rest."""
    import numpy as np

    d, jacobian = mujoco.MjData(m), np.zeros((m.nv, len(JOINTS)))
    ids = [m.joint(name).id if name != "wheel_joint" else m.body("wheel").jntadr[0] for name in JOINTS]
    for k, j in enumerate(ids):
        d.qpos[m.jnt_qposadr[j]], jacobian[m.jnt_dofadr[j], k] = q[k], 1.0
    follower = m.joint("grip_mirror").id
    d.qpos[m.jnt_qposadr[follower]] = RATIO * q[4] + OFFSET
    jacobian[m.jnt_dofadr[follower]] = RATIO * jacobian[m.jnt_dofadr[ids[4]]]
    d.qvel[:] = jacobian @ np.array(v)
    mujoco.mj_forward(m, d)
    inertia = np.zeros((m.nv, m.nv))
    mujoco.mj_fullM(m, d, inertia)
    return np.linalg.solve(jacobian.T @ inertia @ jacobian, np.array(force) - jacobian.T @ d.qfrc_bias).tolist()


def compiled(folder, name="machine.xml"):
    out = pathlib.Path(tempfile.mkdtemp()) / "out.json"
    package = pathlib.Path(__file__).resolve().parents[2] / "tools/python"
    subprocess.run([sys.executable, "-m", "tiller_tools.mjcf", str(folder / name), str(out)], check=True,
                   env=dict(os.environ, PYTHONPATH=str(package), PYTHONDONTWRITEBYTECODE="1"))
    return json.loads(out.read_text(encoding="utf-8"))


def both(mujoco, folder):
    return load(mujoco, folder / "machine.xml"), load(mujoco, folder / "machine.xml", True)


def write(mujoco, folder):
    import numpy as np

    (folder / "machine.json").write_text(json.dumps(compiled(folder), indent=1) + "\n", encoding="utf-8")
    m, heavy, rng, rows = *both(mujoco, folder), np.random.default_rng(SEED), []
    for _ in range(STATES):
        q, v, force = (rng.uniform(-a, a, len(JOINTS)).round(4).tolist() for a in (2.0, 3.0, 15.0))
        rows.append({"q": q, "v": v, "force": force, "a": accelerations(mujoco, m, q, v, force),
                     "a_loaded": accelerations(mujoco, heavy, q, v, force)})
    text = ",\n".join(json.dumps(row) for row in rows)
    (folder / "machine_accelerations.json").write_text(f"[\n{text}\n]\n", encoding="utf-8")


SERVO_JOINTS = ["shoulder", "elbow", "wrist", "left_finger"]
MIRROR = 1.25, 0.002  # right_finger = 0.002 + 1.25 left_finger
CONTROL = {"lift": 4.0, "bend": 3.0, "twist": 2.0, "grasp": 20.0}


def servo_accelerations(mujoco, m, q, v, control):
    """With every drive, spring and damper; the coupling by projection, since MuJoCo's own is soft."""
    import numpy as np

    d, jacobian = mujoco.MjData(m), np.zeros((m.nv, len(SERVO_JOINTS)))
    for k, name in enumerate(SERVO_JOINTS):
        j = m.joint(name).id
        d.qpos[m.jnt_qposadr[j]], jacobian[m.jnt_dofadr[j], k] = q[k], 1.0
    right = m.joint("right_finger").id
    d.qpos[m.jnt_qposadr[right]] = MIRROR[0] * q[3] + MIRROR[1]
    jacobian[m.jnt_dofadr[right], 3] = MIRROR[0]
    d.qvel[:], d.ctrl[:] = jacobian @ np.array(v), control
    mujoco.mj_forward(m, d)
    inertia = np.zeros((m.nv, m.nv))
    mujoco.mj_fullM(m, d, inertia)
    forces = d.qfrc_actuator + d.qfrc_passive - d.qfrc_bias
    return np.linalg.solve(jacobian.T @ inertia @ jacobian, jacobian.T @ forces).tolist()


def servo_arm(mujoco, folder):
    m = mujoco.MjModel.from_xml_path(str(folder / "servos.xml"))
    m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    return m


def write_servos(mujoco, folder):
    import numpy as np

    (folder / "servos.json").write_text(json.dumps(compiled(folder, "servos.xml"), indent=1) + "\n", encoding="utf-8")
    m, rng, rows = servo_arm(mujoco, folder), np.random.default_rng(SEED), []
    for _ in range(STATES):
        q = [*rng.uniform(-2, 2, 3).round(4).tolist(), round(float(rng.uniform(0.0, 0.04)), 5)]
        v = [*rng.uniform(-2, 2, 3).round(4).tolist(), round(float(rng.uniform(-0.2, 0.2)), 4)]
        low = {"lift": -4.0, "bend": -2.0, "twist": -2.0, "grasp": 0.0}
        control = [round(float(rng.uniform(low[name], high)), 4) for name, high in CONTROL.items()]
        rows.append({"q": q, "v": v, "control": control, "a": servo_accelerations(mujoco, m, q, v, control)})
    text = ",\n".join(json.dumps(row) for row in rows)
    (folder / "servos_accelerations.json").write_text(f"[\n{text}\n]\n", encoding="utf-8")


def servos_as_stored(mujoco, folder):
    difference = same(compiled(folder, "servos.xml"), json.loads((folder / "servos.json").read_text(encoding="utf-8")))
    assert difference is None, difference
    m = servo_arm(mujoco, folder)
    for row in json.loads((folder / "servos_accelerations.json").read_text(encoding="utf-8")):
        theirs = servo_accelerations(mujoco, m, row["q"], row["v"], row["control"])
        worst = max(abs(a - b) for a, b in zip(row["a"], theirs)) / max(map(abs, theirs))
        assert worst < 1e-10, worst


SENSED_JOINTS = ["pan", "lift", "reach", "swing"]


def sensor_readings(mujoco, m, q, v, force):
    """Accelerations of the joints, and what every sensor of one or three values reads: by name, or "camera_x"."""
    d = mujoco.MjData(m)
    for name, position, speed, push in zip(SENSED_JOINTS, q, v, force):
        j = m.joint(name).id
        d.qpos[m.jnt_qposadr[j]], d.qvel[m.jnt_dofadr[j]], d.qfrc_applied[m.jnt_dofadr[j]] = position, speed, push
    mujoco.mj_forward(m, d)
    readings = {}
    for k in range(m.nsensor):
        values = d.sensordata[m.sensor_adr[k]:m.sensor_adr[k] + m.sensor_dim[k]].tolist()
        ends = ["_x", "_y", "_z"] if len(values) == 3 else [""] if len(values) == 1 else []
        readings.update({m.sensor(k).name + end: value for end, value in zip(ends, values)})
    return [float(d.qacc[m.jnt_dofadr[m.joint(name).id]]) for name in SENSED_JOINTS], readings


def write_sensors(mujoco, folder):
    import numpy as np

    (folder / "sensors.json").write_text(json.dumps(compiled(folder, "sensors.xml"), indent=1) + "\n", encoding="utf-8")
    m, rng, rows = mujoco.MjModel.from_xml_path(str(folder / "sensors.xml")), np.random.default_rng(SEED), []
    m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    for _ in range(STATES // 2):
        q, v, force = (rng.uniform(-a, a, len(SENSED_JOINTS)).round(4).tolist() for a in (1.5, 2.0, 5.0))
        a, readings = sensor_readings(mujoco, m, q, v, force)
        rows.append({"q": q, "v": v, "force": force, "a": a, "readings": readings})
    text = ",\n".join(json.dumps(row) for row in rows)
    (folder / "sensors_readings.json").write_text(f"[\n{text}\n]\n", encoding="utf-8")


def sensors_as_stored(mujoco, folder):
    stored = json.loads((folder / "sensors.json").read_text(encoding="utf-8"))
    difference = same(compiled(folder, "sensors.xml"), stored)
    assert difference is None, difference
    m = mujoco.MjModel.from_xml_path(str(folder / "sensors.xml"))
    m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    for row in json.loads((folder / "sensors_readings.json").read_text(encoding="utf-8")):
        _, readings = sensor_readings(mujoco, m, row["q"], row["v"], row["force"])
        assert all(math.isclose(row["readings"][k], readings[k], rel_tol=1e-9, abs_tol=1e-9) for k in readings), row


def same(ours, theirs, where=""):
    """Where two JSON values differ, beyond rounding; None: nowhere."""
    if isinstance(ours, dict) and isinstance(theirs, dict):
        if set(ours) != set(theirs):
            return f"{where}: keys {sorted(set(ours) ^ set(theirs))}"
        return next((d for k in ours if k != "mujoco" and (d := same(ours[k], theirs[k], f"{where}.{k}"))), None)
    if isinstance(ours, list) and isinstance(theirs, list) and len(ours) == len(theirs):
        return next((d for k, (a, b) in enumerate(zip(ours, theirs)) if (d := same(a, b, f"{where}[{k}]"))), None)
    if type(ours) in (int, float) and type(theirs) in (int, float):
        return None if math.isclose(ours, theirs, rel_tol=1e-9, abs_tol=1e-12) else f"{where}: {ours} and {theirs}"
    return None if ours == theirs else f"{where}: {ours} and {theirs}"


def imported(tiller, file, folder):
    return subprocess.run([tiller, "import", str(file), "-o", str(folder)], capture_output=True, text=True, check=False,
                          env=dict(os.environ, TILLER_PYTHON=sys.executable))


def with_mujoco(mujoco, tiller, folder):
    difference = same(compiled(folder), json.loads((folder / "machine.json").read_text(encoding="utf-8")))
    assert difference is None, difference
    servos_as_stored(mujoco, folder)
    sensors_as_stored(mujoco, folder)
    models, worst = both(mujoco, folder), 0.0
    for row in json.loads((folder / "machine_accelerations.json").read_text(encoding="utf-8")):
        for m, key in zip(models, ("a", "a_loaded")):
            theirs = accelerations(mujoco, m, row["q"], row["v"], row["force"])
            worst = max(worst, max(abs(a - b) for a, b in zip(row[key], theirs)) / max(map(abs, theirs)))
    assert worst < 1e-10, worst
    with tempfile.TemporaryDirectory() as out:
        out = pathlib.Path(out)
        done = imported(tiller, folder / "machine.xml", out / "xml")
        assert done.returncode == 0 and "toy" in done.stdout, done.stderr + done.stdout
        mujoco.mj_saveModel(mujoco.MjModel.from_xml_path(str(folder / "machine.xml")), str(out / "machine.mjb"), None)
        done = imported(tiller, out / "machine.mjb", out / "mjb")
        assert done.returncode == 0, done.stderr
        texts = [next((out / kind).glob("*.hpp")).read_text(encoding="utf-8") for kind in ("xml", "mjb")]
        assert texts[0] == texts[1].replace("machine.mjb", "machine.xml"), "the .mjb is another machine"
        (out / "bad.xml").write_text("<mujoco><worldbody><body><joint/></body></worldbody></mujoco>", encoding="utf-8")
        done = imported(tiller, out / "bad.xml", out / "bad")
        assert done.returncode != 0 and "bad.xml: MuJoCo does not compile it: " in done.stderr, done.stderr
    print("with mujoco", mujoco.__version__, "worst", worst)


def without_mujoco(tiller, folder):
    done = imported(tiller, folder / "machine.xml", "nowhere")
    assert done.returncode != 0 and f"{sys.executable} -m pip install mujoco" in done.stderr, done.stderr
    print("without mujoco")


def main():
    tiller, folder = sys.argv[1], pathlib.Path(sys.argv[2]).resolve()
    try:
        import mujoco
    except ImportError:
        return without_mujoco(tiller, folder)
    if sys.argv[3:] == ["--write"]:
        write(mujoco, folder)
        write_servos(mujoco, folder)
        write_sensors(mujoco, folder)
    return with_mujoco(mujoco, tiller, folder)


if __name__ == "__main__":
    main()
