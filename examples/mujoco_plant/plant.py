"""A robot in MuJoCo that tiller steers over LCM: joint forces in, encoders out. docs/guide/lcm.md explains it.

    plant.py my_arm.urdf my_arm/robot.toml --payload 1.2 --frame tool

The description (URDF, MJCF) is the machine; of the robot file the plant takes the wiring alone: which joints are
measured and driven, where they start, how long a period is. The load and the friction are known to nobody else. With
--servos (as in the import) the description's actuators act: inputs of position servos are goals.
"""
import argparse
import re
import struct
import time
import tomllib
import xml.etree.ElementTree as xml
import lcm
import mujoco
import numpy as np
from tiller_lcm import command_t, wide_command_t, wide_measurement_t

def load(path, driven, payload_kg, frame):
    """The model, with joints that the robot file does not know held at 0, and a ball of steel at a link or site."""
    root = xml.parse(path).getroot()
    if root.tag == "mujoco":
        spec = mujoco.MjSpec.from_file(path)
    else:  # a URDF's meshes are seldom there, and its inertias do not need them
        for link in root.iter("link"):
            for shape in link.findall("visual") + link.findall("collision"): link.remove(shape)
        root.append(xml.fromstring('<mujoco><compiler fusestatic="false"/></mujoco>'))
        spec = mujoco.MjSpec.from_string(xml.tostring(root, encoding="unicode"))
        for joint in root.findall("joint/dynamics[@armature]/.."):  # of a URDF MuJoCo does not read it
            spec.joint(joint.get("name")).armature = float(joint.find("dynamics").get("armature"))
    for joint in spec.joints: joint.name = joint.name or joint.parent.name + "_joint"  # as the import calls them
    ties = [e for e in spec.equalities if e.type == mujoco.mjtEq.mjEQ_JOINT and identifier(e.name2) in driven]
    driven = driven | {identifier(e.name1) for e in ties}  # what follows moves along
    for joint in [j for j in spec.joints if identifier(j.name) not in driven]:
        for tie in [e for e in spec.equalities if joint.name in (e.name1, e.name2)]: spec.delete(tie)
        spec.delete(joint)
    if payload_kg > 0.0:
        site = next((s for s in spec.sites if s.name == frame), None)
        body = site.parent if site else spec.body(frame)
        if body is None: raise SystemExit(f"{path} has no body or site '{frame}': name one with --frame")
        kgm2 = 0.4 * payload_kg * (payload_kg / (7850.0 * 4.0 / 3.0 * np.pi)) ** (2.0 / 3.0)
        at = site.pos if site else [0, 0, 0]
        body.add_body(mass=payload_kg, inertia=[kgm2] * 3, explicitinertial=True, ipos=[0, 0, 0], pos=at)
    spec.option.timestep, spec.option.integrator = STEP_S, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    if not options.servos:  # commands are forces at the joints
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    return spec.compile()

def identifier(name): return re.sub(r"[^A-Za-z0-9]", "_", name)
def split(key): return re.fullmatch(r"(.*?)_(rad_s|m_s|rad|m|Nm|N)", key).groups()

def decode(data):
    for kind in (wide_command_t, command_t):
        try: message = kind.decode(data)
        except (ValueError, struct.error): continue  # the other type, or no command
        if message.count == len(inputs): return message

def hear(channel, data):
    global newest
    newest = decode(data) or newest

def say(sequence, stamp_us, latency_us, values):
    message, mask = wide_measurement_t(), (1 << len(values)) - 1
    message.sequence, message.stamp_us, message.command_latency_us = sequence, stamp_us, latency_us
    message.count, message.value, message.valid_mask = len(values), values, mask - (mask >> 31 << 32)
    bus.publish(options.prefix + "MEASUREMENT", message.encode())

def read():
    if trace: print(f"{d.time:.4f}", *(f"{d.qpos[q]:.6f}" for q, _ in place.values()), sep=",", file=trace)
    exact = [d.qvel[place[name][1]] if unit.endswith("_s") else d.qpos[place[name][0]] for name, unit in wiring]
    return [float(v + options.noise * n) for v, n in zip(exact, noise.standard_normal(len(exact)))]

def follow(data):
    """Joints that follow others stand where these put them: q - q0 = a0 + a1 (p - p0)."""
    for e in np.flatnonzero(m.eq_type == mujoco.mjtEq.mjEQ_JOINT):
        own, other = (m.jnt_qposadr[j[e]] for j in (m.eq_obj1id, m.eq_obj2id))
        data.qpos[own] = m.qpos0[own] + m.eq_data[e][0] + m.eq_data[e][1] * (data.qpos[other] - m.qpos0[other])

def controls(goals):
    """The ctrl of each position servo that rests where its goal is: gain ctrl + b0 + b1 length = 0."""
    for at, goal in goals: rest.qpos[at] = goal
    follow(rest)
    mujoco.mj_fwdPosition(m, rest)
    b0, b1, gain = m.actuator_biasprm[:, 0], m.actuator_biasprm[:, 1], m.actuator_gainprm[:, 0]
    return np.where(b1 < 0.0, -(b0 + b1 * rest.actuator_length) / gain, 0.0)

def push(command):
    values = np.nan_to_num(command.value[:len(inputs)], posinf=0.0, neginf=0.0) if command else np.zeros(len(inputs))
    d.qfrc_applied[inputs] = np.where(is_goal, 0.0, values)
    if options.servos and command: d.ctrl[:] = controls([(q, v) for q, v, goal in zip(seats, values, is_goal) if goal])
    for at, force, begin_s, end_s in pushes: d.qfrc_applied[at] += force if begin_s <= d.time < end_s else 0.0

def lockstep():
    for k in range(round(options.seconds / period_s)):
        values, tries, answered = read(), 10 if newest else 10**9, False  # nobody has answered yet: ask without end
        while not answered and tries > 0:  # a datagram may be lost: ask again
            say(k, 10**6 + round(k * period_s * 1e6), 0, values)
            while not answered and bus.handle_timeout(100): answered = newest and newest.sequence == k
            tries -= 1
        push(newest if answered else None)
        for _ in range(round(period_s / STEP_S)): mujoco.mj_step(m, d)

def real_time():
    start_s, sent_s, latency_s, heard_s, last = clock(), {}, 0.0, 0.0, -1
    for step in range(round(options.seconds / STEP_S)):
        if step % round(period_s / STEP_S) == 0:
            k = step // round(period_s / STEP_S)
            sent_s[k] = clock()
            say(k, round(1e6 * sent_s[k]), round(1e6 * latency_s), read())
        while bus.handle_timeout(max(0, round(1e3 * (start_s + (step + 1) * STEP_S - clock())))): pass
        if newest and last < newest.sequence < len(sent_s):
            last, heard_s = newest.sequence, clock()
            latency_s += 0.1 * (heard_s - sent_s[last] - latency_s)
        push(newest if clock() - heard_s < 0.1 else None)  # the motors' watchdog
        if last >= 0: mujoco.mj_step(m, d)  # brakes hold until the first command

STEP_S, clock = 0.001, time.monotonic
options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
for name in ("description", "robot"): options.add_argument(name)
options.add_argument("--frame", default="", metavar="NAME", help="body or site that carries the payload")
options.add_argument("--real-time", action="store_true", help="else lockstep")
options.add_argument("--servos", action="store_true", help="the robot was imported with --servos")
for name, value, unit in (("payload", 0.0, "KG"), ("friction", 0.0, "NM"), ("armature", 0.0, "KGM2"),
                          ("noise", 0.00025, "RAD"), ("seconds", 10.0, "S"), ("seed", 1, "N"),
                          ("trace", "", "FILE"), ("push", "", "JOINT:NM:FROM_S:TO_S,.."), ("prefix", "TILLER_", "TEXT"),
                          ("url", "udpm://239.255.76.67:7667?ttl=0", "URL")):
    options.add_argument("--" + name, type=type(value), default=value, metavar=unit, help=f"[{value}]")
options = options.parse_args()
with open(options.robot, "rb") as file: robot = tomllib.load(file)
period_s, wiring = robot["model"]["period_s"], [split(key) for key in robot["measurement"]]
moving = {split(key)[0] for key in [*robot["measurement"], *robot["limits"], *robot["cost"]["target"]]}
m = load(options.description, moving, options.payload, options.frame)
m.dof_frictionloss[:] += options.friction
m.dof_armature[m.dof_armature == 0.0] = options.armature
d, noise = mujoco.MjData(m), np.random.default_rng(options.seed)
place = {identifier(m.joint(j).name): (m.jnt_qposadr[j], m.jnt_dofadr[j]) for j in range(m.njnt)}
inputs, seats = ([place[split(key)[0]][k] for key in robot["limits"]] for k in (1, 0))
served = {e["port"] for e in robot.get("effects", []) if e["kind"] == "position_servo"}
is_goal, rest = np.array([key in served for key in robot["limits"]]), mujoco.MjData(m)
for key, value in robot["start"]["state"].items(): d.qpos[place[split(key)[0]][0]] = value
follow(d)
if options.servos: d.ctrl[:] = controls([(q, d.qpos[q]) for q, goal in zip(seats, is_goal) if goal])
pushes = [(place[joint][1], *map(float, numbers)) for joint, *numbers in (p.split(":") for p in options.push.split(",") if p)]
trace = open(options.trace, "w", 1, "utf-8") if options.trace else None  # where every joint truly is, each period
if trace: print("time_s", *place, sep=",", file=trace)
bus, newest = lcm.LCM(options.url), None
bus.subscribe(options.prefix + "COMMAND", hear)
real_time() if options.real_time else lockstep()
miss = {key: d.qpos[place[split(key)[0]][0]] - value for key, value in robot["cost"]["target"].items()}
worst = max(miss, key=lambda key: abs(miss[key]))
print(f"after {options.seconds:g} s the largest distance from the target is {abs(miss[worst]):.4f} ({worst})")
