"""contacts_test.py FOLDER EXAMPLES [--write]: contacts of the leg rig and the gripper in MuJoCo, as the C++ tests have
them stored.

Of each example: what tiller_tools.mjcf says of it (FOLDER/leg.json), and rows of states with MuJoCo's accelerations and
contact forces, beside the forces of the same law solved to its end from MuJoCo's own mass matrix and Jacobian
(FOLDER/leg_contacts.json). --write stores them anew; else they are compared. Exits 77 without mujoco.
"""
import json
import pathlib
import sys

from mjcf_test import compiled, same

SEED, ROWS, SWEEPS = 11, 100, 3000
# the law's constants, as the examples' geoms have them
FRICTION, SETTLE_S, RATIO, IMPEDANCE, GRIP = 0.8, 0.01, 1.0, 0.98, 10.0
ROBOTS = {
    # joints by name with what follows them, and places: geom, its body, how far below its centre it touches, against
    "leg": ((("rail",), ("hip",), ("knee",)), (("foot", "floor"),)),
    "gripper": ((("lift",), ("finger", "finger_mirror"), ("box_y",), ("box_z",)),
                (("left_pad", "box"), ("right_pad", "box"), ("box", "table"))),
}


def load(mujoco, path):
    m = mujoco.MjModel.from_xml_path(str(path))
    m.dof_damping[:] = 0.0  # effects of the robot file
    m.opt.tolerance, m.opt.iterations = 1e-14, 500
    m.eq_solimp[:] = [0.9999, 0.9999, 0.001, 0.5, 2.0]  # the coupling is exact in the model
    return m


def set_state(mujoco, m, d, joints, q, v):
    for names, position, speed in zip(joints, q, v):
        for name in names:
            d.qpos[m.joint(name).qposadr[0]], d.qvel[m.joint(name).dofadr[0]] = position, speed


def their_forces(mujoco, m, d, places):
    """Push on the first geom of each place, in world axes: MuJoCo's, summed over its points."""
    import numpy as np

    out = np.zeros((len(places), 3))
    for i in range(d.ncon):
        c, f = d.contact[i], np.zeros(6)
        names = [m.geom(g).name for g in c.geom]
        for k, pair in enumerate(places):
            if set(pair) != set(names): continue
            mujoco.mj_contactForce(m, d, i, f)
            out[k] += (c.frame.reshape(3, 3).T @ f[:3]) * (1.0 if names[1] == pair[0] else -1.0)
    return out


def jacobian(mujoco, m, d, fold, geom, point):
    import numpy as np

    out = np.zeros((3, m.nv))
    mujoco.mj_jac(m, d, out, None, point, m.geom_bodyid[m.geom(geom).id])
    return out @ fold


def place_rows(mujoco, m, d, fold, pair):
    """Gap and Jacobian (normal, tangents) of one place, from MuJoCo's poses."""
    import numpy as np

    a, b = (m.geom(name).id for name in pair)
    at, size = d.geom_xpos[a].copy(), m.geom_size[a]
    if pair[1] == "box":  # a pad beside it
        normal = np.array([0.0, np.sign(at[1] - d.geom_xpos[b][1]), 0.0])
        gap = abs(at[1] - d.geom_xpos[b][1]) - m.geom_size[b][1] - size[0]
        point = at - size[0] * normal
    else:  # on the ground
        down = size[2] if pair[0] == "box" else size[0]
        normal, gap, point = np.array([0.0, 0.0, 1.0]), at[2] - down, at - [0.0, 0.0, down]
    across = np.array([[1.0, 0.0, 0.0], np.cross(normal, [1.0, 0.0, 0.0])])
    rows = jacobian(mujoco, m, d, fold, pair[0], point) - jacobian(mujoco, m, d, fold, pair[1], point)
    return gap, np.vstack([normal, across]) @ rows, np.vstack([normal, across])


def solved(mujoco, m, d, joints, places, q, v):
    """The law's forces in world axes and accelerations: by blocks to the end, from MuJoCo's own matrices."""
    import numpy as np

    fold = np.zeros((m.nv, len(joints)))
    for k, names in enumerate(joints):
        for name in names: fold[m.joint(name).dofadr[0], k] = 1.0
    flags, speed = m.opt.disableflags, np.array(v)
    m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    mujoco.mj_forward(m, d)
    inertia = np.zeros((m.nv, m.nv))
    mujoco.mj_fullM(m, d, inertia)
    inverse = np.linalg.inv(fold.T @ inertia @ fold)
    free = inverse @ (fold.T @ (d.qfrc_actuator - d.qfrc_bias))
    m.opt.disableflags = flags
    here = [place_rows(mujoco, m, d, fold, pair) for pair in places]

    def speeds(by):
        set_state(mujoco, m, d, joints, np.array(q) + by * speed, v)
        mujoco.mj_fwdPosition(m, d)
        return np.concatenate([place_rows(mujoco, m, d, fold, pair)[1] @ speed for pair in places])

    drift = (speeds(1e-6) - speeds(-1e-6)) / 2e-6
    set_state(mujoco, m, d, joints, q, v)
    reach = np.vstack([rows for _, rows, _ in here])
    couple = reach @ inverse @ reach.T
    wanted = -2.0 / (IMPEDANCE * SETTLE_S) * (reach @ speed) - drift - reach @ free
    wanted[::3] -= np.array([gap for gap, _, _ in here]) / (IMPEDANCE * (SETTLE_S * RATIO) ** 2)
    impedance = np.tile([IMPEDANCE] + 2 * [IMPEDANCE / (IMPEDANCE + (1.0 - IMPEDANCE) / GRIP)], len(places))
    force = np.zeros(3 * len(places))
    for _ in range(SWEEPS):
        for i, (gap, _, _) in enumerate(here):
            if gap > 0.001: continue
            n = 3 * i
            rest = lambda r: wanted[r] - couple[r] @ force + couple[r, r] * force[r]
            if couple[n, n] > 1e-12: force[n] = max(0.0, impedance[n] * rest(n) / couple[n, n])
            for r in (n + 1, n + 2):
                if couple[r, r] > 1e-12: force[r] = impedance[r] * rest(r) / couple[r, r]
            size = np.hypot(force[n + 1], force[n + 2])
            if size > FRICTION * force[n]: force[n + 1:n + 3] *= FRICTION * force[n] / size
    world = np.array([axes.T @ force[3 * i:3 * i + 3] for i, (_, _, axes) in enumerate(here)])
    return world, free + inverse @ reach.T @ force, free


def leg_state(rng, m):
    import numpy as np

    hip, knee, gap = rng.uniform(0.3, 1.2), rng.uniform(-2.2, -1.0), rng.uniform(-0.003, -0.0001)
    if rng.random() < 0.2: gap = rng.uniform(0.002, 0.1)
    rail = 0.213 * np.cos(hip) + 0.213 * np.cos(hip + knee) + 0.022 + gap - 0.32
    share = rng.choice([0.0, 0.02, 0.3])
    return [rail, hip, knee], (share * rng.uniform(-1, 1, 3) * [1, 3, 3]).tolist(), rng.uniform(-15, 15, 2).tolist()


def gripper_state(rng, m):
    deep, height = rng.uniform(0.0001, 0.002), rng.uniform(-0.0005, 0.05)
    if rng.random() < 0.2: deep = -rng.uniform(0.002, 0.02)
    share = rng.choice([0.0, 0.02, 0.1])
    q = [height + rng.uniform(-0.01, 0.01), 0.02 + deep, rng.uniform(-5e-5, 5e-5), height]
    squeeze = rng.uniform(0, 2) if rng.random() < 0.3 else rng.uniform(3, 20)
    return q, (share * rng.uniform(-1, 1, 4)).tolist(), [rng.uniform(0, 20), squeeze]


def rows_of(mujoco, path, name):
    import numpy as np

    joints, places = ROBOTS[name]
    m, rng, rows = load(mujoco, path), np.random.default_rng(SEED), []
    for _ in range(ROWS):
        q, v, u = (leg_state if name == "leg" else gripper_state)(rng, m)
        q, v, u = ([round(float(x), 7) for x in values] for values in (q, v, u))
        d = mujoco.MjData(m)
        set_state(mujoco, m, d, joints, q, v)
        d.ctrl[:] = u
        mujoco.mj_forward(m, d)
        theirs, a = their_forces(mujoco, m, d, places), [float(d.qacc[m.joint(j[0]).dofadr[0]]) for j in joints]
        law, a_law, free = solved(mujoco, m, d, joints, places, q, v)
        short = lambda values: [round(float(x), 6) for x in values]
        rows.append({"q": q, "v": v, "u": u, "a": short(a), "force": [short(f) for f in theirs], "a_law": short(a_law),
                     "force_law": [short(f) for f in law], "a_free": short(free)})
    return rows


def drop_of(mujoco, path):
    """The gripper's box falls 5 cm on the table: what MuJoCo makes of it, at steps of 0.1 ms."""
    import numpy as np

    m = load(mujoco, path)
    m.opt.timestep = 1e-4
    d = mujoco.MjData(m)
    d.joint("box_z").qpos[0] = 0.05
    d.ctrl[0] = -m.opt.gravity[2] * sum(m.body(b).mass[0] for b in ("palm", "left", "right"))  # the palm stays
    weight, impulse, peak, rebound, landed = -m.opt.gravity[2] * m.body("box").mass[0], 0.0, 0.0, 0.0, False
    for _ in range(5000):
        mujoco.mj_step(m, d)
        push = their_forces(mujoco, m, d, (("box", "table"),))[0][2]
        impulse, peak, landed = impulse + push * m.opt.timestep, max(peak, push), landed or push > 0.0
        if landed: rebound = max(rebound, float(d.joint("box_z").qvel[0]))
    return {"impulse_Ns": impulse, "peak_N": peak, "rebound_m_s": rebound, "weight_N": weight, "rest_N": push,
            "rest_m": float(d.joint("box_z").qpos[0])}


def main():
    folder, examples = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]).resolve()
    try:
        import mujoco
    except ImportError:
        print("no MuJoCo here")
        raise SystemExit(77)
    for name in ROBOTS:
        model, rows = compiled(examples, f"{name}.xml"), rows_of(mujoco, examples / f"{name}.xml", name)
        if sys.argv[3:] == ["--write"]:
            (folder / f"{name}.json").write_text(json.dumps(model, indent=1) + "\n", encoding="utf-8")
            text = ",\n".join(json.dumps(row) for row in rows)
            (folder / f"{name}_contacts.json").write_text(f"[\n{text}\n]\n", encoding="utf-8")
            if name == "gripper":
                drop = {key: round(value, 6) for key, value in drop_of(mujoco, examples / "gripper.xml").items()}
                (folder / "gripper_drop.json").write_text(json.dumps(drop) + "\n", encoding="utf-8")
        assert (difference := same(model, json.loads((folder / f"{name}.json").read_text()))) is None, difference
        stored = json.loads((folder / f"{name}_contacts.json").read_text())
        for row, old in zip(rows, stored):
            for key in ("q", "v", "u"): assert row[key] == old[key]
            for key in ("a", "a_law"):
                scale = 1.0 + max(map(abs, old[key]))
                assert max(abs(x - y) for x, y in zip(row[key], old[key])) < 1e-5 * scale, (key, row, old)
        if name == "gripper":
            old = json.loads((folder / "gripper_drop.json").read_text())
            for key, value in drop_of(mujoco, examples / "gripper.xml").items():
                assert abs(value - old[key]) < 1e-4 * (1.0 + abs(value)), (key, value, old)
        print(f"{name}: {len(rows)} states as stored, mujoco {mujoco.__version__}")


if __name__ == "__main__":
    main()
