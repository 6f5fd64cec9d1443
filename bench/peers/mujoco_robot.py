"""mujoco_robot.py FILE JOINTS HELD SEED COUNT: random states, and what MuJoCo makes of them, one JSON line each.

FILE is an MJCF or a URDF, JOINTS the names of an import in its order, HELD "JOINT=POSITION,...". A line has the row (q, v,
force), the accelerations and the inverse inertia in that order of joints. Contacts, limits, actuators, springs, damping,
friction and gravity compensation are switched off; equalities of joints hold exactly, by projection. What the import
calls base_x to base_roll is MuJoCo's free joint.
"""

import json
import re
import sys
import xml.etree.ElementTree as xml

import mujoco
import numpy as np


def load(path):
    root = xml.parse(path).getroot()
    if root.tag == "mujoco":
        return mujoco.MjModel.from_xml_path(path)
    on_base, joints = {link.get("name") for link in root.iter("link")}, root.findall("joint")
    on_base -= {joint.find("child").get("link") for joint in joints}
    for joint in joints:  # parents come first in these files
        if joint.get("type") == "fixed" and joint.find("parent").get("link") in on_base:
            on_base.add(joint.find("child").get("link"))
    for link in root.iter("link"):  # meshes are not there, and inertias are in the file
        for inertial in link.findall("inertial") if link.get("name") in on_base else []:
            link.remove(inertial)  # it moves nothing, and MuJoCo refuses some
        for shape in link.findall("visual") + link.findall("collision"):
            link.remove(shape)
    for extra in [e for e in root if e.tag not in ("link", "joint")]:
        root.remove(extra)
    # where MuJoCo merges links itself, the inertia of one without mass is lost
    root.append(xml.fromstring('<mujoco><compiler fusestatic="false"/></mujoco>'))
    return mujoco.MjModel.from_xml_string(xml.tostring(root, encoding="unicode"))


def switch_off(m):
    m.opt.disableflags = 0
    for name in ("CONSTRAINT", "CONTACT", "LIMIT", "EQUALITY", "FRICTIONLOSS", "ACTUATION", "SPRING", "DAMPER"):
        m.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, "mjDSBL_" + name))
    m.opt.gravity[:] = 0.0, 0.0, -9.81
    m.opt.density = m.opt.viscosity = 0.0
    m.body_gravcomp[:] = 0.0
    m.tendon_armature[:] = 0.0


def identifier(name):
    return re.sub(r"[^A-Za-z0-9]", "_", name)


class Robot:
    def __init__(self, path, joints, held):
        self.m, self.joints, self.held = load(path), joints, held
        switch_off(self.m)
        m, obj, self.of, self.place = self.m, mujoco.mjtObj, {}, {}
        for k in range(m.njnt):
            body = mujoco.mj_id2name(m, obj.mjOBJ_BODY, m.jnt_bodyid[k]) or f"body{m.jnt_bodyid[k]}"
            name = mujoco.mj_id2name(m, obj.mjOBJ_JOINT, k) or body + "_joint"
            while identifier(name) in self.place:
                name += "_"
            self.place[identifier(name)] = k
        self.free = next((k for k in range(m.njnt) if m.jnt_type[k] == mujoco.mjtJoint.mjJNT_FREE), -1)
        self.data = mujoco.MjData(m)

    def followers(self):
        """(joint, leader, ratio, offset) of every coupling that is on."""
        m = self.m
        for k in range(m.neq):
            if m.eq_type[k] == mujoco.mjtEq.mjEQ_JOINT and m.eq_active0[k]:
                joint, leader, c = m.eq_obj1id[k], m.eq_obj2id[k], m.eq_data[k]
                q0 = m.qpos0[m.jnt_qposadr]
                yield joint, leader, c[1], q0[joint] + c[0] - c[1] * q0[leader]

    def place_all(self, q, v):
        """Sets the full state; the Jacobian of the full velocities, and their rates at accelerations of zero."""
        m, d = self.m, self.data
        d.qpos[:], d.qvel[:] = m.qpos0, 0.0
        jacobian, drift = np.zeros((m.nv, len(q))), np.zeros(m.nv)
        for name, at in self.held.items():
            d.qpos[m.jnt_qposadr[self.place[name]]] = at
        for k, name in enumerate(self.joints):
            if not name.startswith("base_"):
                d.qpos[m.jnt_qposadr[self.place[name]]] = q[k]
                jacobian[m.jnt_dofadr[self.place[name]], k] = 1.0
        for joint, leader, ratio, offset in self.followers():
            d.qpos[m.jnt_qposadr[joint]] = ratio * d.qpos[m.jnt_qposadr[leader]] + offset
            jacobian[m.jnt_dofadr[joint]] = ratio * jacobian[m.jnt_dofadr[leader]]
        if "base_x" in self.joints:
            self.place_base(q, v, jacobian, drift)
        d.qvel[:] = jacobian @ v
        return jacobian, drift

    def place_base(self, q, v, jacobian, drift):
        """Moves, then turns about z, y and x, of the world with the body where the file puts it."""
        m, d, at = self.m, self.data, {name: k for k, name in enumerate(self.joints)}
        a, p, r = (q[at[n]] for n in ("base_yaw", "base_pitch", "base_roll"))
        turn = lambda axis, angle: np.array(axis_turn(axis, angle))
        before, axes, rate, pulled = np.eye(3), [], np.zeros(3), np.zeros(3)
        for axis, (name, angle) in zip((2, 1, 0), (("base_yaw", a), ("base_pitch", p), ("base_roll", r))):
            along = before[:, axis]
            pulled = pulled + np.cross(rate, along) * v[at[name]]
            rate = rate + along * v[at[name]]
            axes.append((at[name], along))
            before = before @ turn(axis, angle)
        row, adr = m.jnt_dofadr[self.free], m.jnt_qposadr[self.free]
        arm, first = before @ m.qpos0[adr:adr + 3], np.zeros(9)
        mujoco.mju_quat2Mat(first, m.qpos0[adr + 3:adr + 7])
        turned = before @ first.reshape(3, 3)
        for k, name in enumerate(("base_x", "base_y", "base_z")):
            jacobian[row + k, at[name]] = 1.0
        for k, along in axes:
            jacobian[row:row + 3, k] = np.cross(along, arm)
            jacobian[row + 3:row + 6, k] = turned.T @ along
        drift[row:row + 3] = np.cross(pulled, arm) + np.cross(rate, np.cross(rate, arm))
        drift[row + 3:row + 6] = turned.T @ pulled
        d.qpos[adr:adr + 3] = q[[at[n] for n in ("base_x", "base_y", "base_z")]] + arm
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, turned.flatten())
        d.qpos[adr + 3:adr + 7] = quaternion

    def answer(self, q, v, force):
        m, d = self.m, self.data
        jacobian, drift = self.place_all(q, v)
        if jacobian.shape[0] == jacobian.shape[1]:
            back = np.linalg.inv(jacobian)
            d.qfrc_applied[:] = back.T @ force
            mujoco.mj_forward(m, d)
            columns = np.zeros((m.nv, m.nv))
            mujoco.mj_solveM(m, d, columns, np.ascontiguousarray(back))
            return back @ (d.qacc - drift), back @ columns.T
        d.qfrc_applied[:] = 0.0
        mujoco.mj_forward(m, d)
        inertia = np.zeros((m.nv, m.nv))
        mujoco.mj_fullM(m, d, inertia)
        inverse = np.linalg.inv(jacobian.T @ inertia @ jacobian)
        return inverse @ (force - jacobian.T @ (d.qfrc_bias + inertia @ drift)), inverse


def axis_turn(axis, angle):
    c, s, out = np.cos(angle), np.sin(angle), np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out[i, i] = out[j, j] = c
    out[i, j], out[j, i] = -s, s
    return out


def main():
    path, joints, held, seed, count = sys.argv[1:6]
    fixed = {identifier(h.split("=")[0]): float((h.split("=") + ["0"])[1]) for h in held.split(",") if h}
    try:
        robot = Robot(path, joints.split(","), fixed)
    except (ValueError, KeyError) as refusal:
        sys.exit("MuJoCo: " + " ".join(str(refusal).split()))
    rng, n = np.random.default_rng(int(seed)), len(robot.joints)
    for _ in range(int(count)):
        q, v, force = (rng.uniform(-a, a, n) for a in (3.0, 3.0, 20.0))
        for k, name in enumerate(robot.joints):
            q[k] *= 0.4 if name == "base_pitch" else 1.0  # short of the upright where its three angles are no coordinates
        acceleration, inverse = robot.answer(q, v, force)
        print(json.dumps({"row": [*q, *v, *force], "acceleration": acceleration.tolist(), "inverse": inverse.tolist()}))


if __name__ == "__main__":
    main()
