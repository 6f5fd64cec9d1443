"""How well a stiff spring and damper close a four-bar's chain at the periods of MPC: the table of docs/guide/import.md.

    four_bar.py [CONNECT]

MuJoCo has the equations of the cut chain, three hinges in a tree; what steps it is here. The reference is the exact
constraint (a multiplier, with Baumgarte's terms at 50/s) at 0.1 ms by RK4. Minutes. With CONNECT the reference is held
against MuJoCo's own <connect> first.
"""
import sys

import mujoco
import numpy as np

CHAIN = """<mujoco><option gravity="0 0 0" timestep="1e-4" integrator="RK4"/><compiler angle="radian"/>
<default><geom contype="0" conaffinity="0" size="0.012" type="capsule"/></default><worldbody>
<body name="crank"><joint axis="0 1 0" damping="0.1"/><geom fromto="0 0 0 0.1 0 0" mass="0.3"/>
<body name="coupler" pos="0.1 0 0"><joint axis="0 1 0"/><geom fromto="0 0 0 0.25 0 0" mass="0.3"/>
<body name="rocker" pos="0.25 0 0"><joint axis="0 1 0"/><geom fromto="0 0 0 0.2 0 0" mass="0.4"/>
<site name="end" pos="0.2 0 0"/></body></body></body></worldbody>%s</mujoco>"""
CONNECT = """<equality>
<connect body1="rocker" anchor="0.2 0 0" solref="0.002 1" solimp="0.9999 0.9999 0.001"/></equality>"""
PIVOT, SECONDS, STABILISE = np.array([0.22, 0.0, 0.0]), 0.5, 50.0
m = mujoco.MjModel.from_xml_string(CHAIN % "")
d = mujoco.MjData(m)


def torque(t):
    return 1.5 * np.cos(4 * np.pi * t)


def parts(q, v, u=0.0):
    """Inertia, accelerations of the cut chain, slope of the gap and its rate, the gap."""
    d.qpos[:], d.qvel[:], d.qfrc_applied[:] = q, v, [u, 0, 0]
    mujoco.mj_forward(m, d)
    inertia, slope, rate = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    mujoco.mj_fullM(m, d, inertia)
    mujoco.mj_jacSite(m, d, slope, None, 0)
    mujoco.mj_jacDot(m, d, rate, None, d.site_xpos[0].copy(), m.site_bodyid[0])
    return inertia, d.qacc.copy(), slope[[0, 2]], rate[[0, 2]], (d.site_xpos[0] - PIVOT)[[0, 2]]


def exact(q, v, u):
    inertia, free, slope, rate, gap = parts(q, v, u)
    push = np.linalg.solve(inertia, slope.T)
    error = slope @ free + rate @ v + 2 * STABILISE * slope @ v + STABILISE**2 * gap
    return free - push @ np.linalg.solve(slope @ push, error)


def spring(stiffness, damping):
    def accelerate(q, v, u):
        inertia, free, slope, _, gap = parts(q, v, u)
        return free - np.linalg.solve(inertia, slope.T @ (stiffness * gap + damping * (slope @ v)))

    return accelerate


def step(accelerate, x, u, h, kind):
    f = lambda x: np.concatenate([x[3:], accelerate(x[:3], x[3:], u)])
    if kind == "midpoint":
        return x + h * f(x + 0.5 * h * f(x))
    a = f(x)
    b = f(x + 0.5 * h * a)
    c = f(x + 0.5 * h * b)
    return x + h / 6 * (a + 2 * b + 2 * c + f(x + h * c))


def run(accelerate, x, period, substeps, kind):
    """Cranks at the periods and the largest gap; None where it is unstable."""
    cranks, widest = [x[0]], 0.0
    for k in range(round(SECONDS / period)):
        for _ in range(substeps):
            x = step(accelerate, x, torque(k * period), period / substeps, kind)
            if not np.all(np.isfinite(x)) or np.abs(x[3:]).max() > 1e4:
                return None
            widest = max(widest, np.linalg.norm(parts(x[:3], x[3:])[4]))
        cranks.append(x[0])
    return np.array(cranks), widest


def closed(crank):
    q = np.array([crank, 3.9, 27.4 - 8 * np.pi])
    for _ in range(50):
        _, _, slope, _, gap = parts(q, np.zeros(3))
        q[1:] -= np.linalg.solve(slope[:, 1:], gap)
    return np.concatenate([q, np.zeros(3)])


def of_mujoco(x, period):
    own = mujoco.MjModel.from_xml_string(CHAIN % CONNECT)
    data, cranks = mujoco.MjData(own), [x[0]]
    own.eq_data[0][3:6] = PIVOT  # the compiler takes where the end is at 0
    data.qpos[:] = x[:3]
    for k in range(round(SECONDS / period)):
        data.qfrc_applied[0] = torque(k * period)
        for _ in range(round(period / own.opt.timestep)):
            mujoco.mj_step(own, data)
        cranks.append(data.qpos[0])
    return np.array(cranks)


def main():
    start = closed(1.0)
    inertia, _, slope, _, _ = parts(start[:3], start[3:])
    lightest = 1 / np.linalg.eigvalsh(slope @ np.linalg.solve(inertia, slope.T)).max()
    for period in (0.01, 0.02):
        cranks, gap = run(exact, start, period, round(period / 1e-4), "rk4")
        print(f"period {1e3 * period:g} ms: crank from {cranks.min():.2f} to {cranks.max():.2f} rad, "
              f"gap {1e3 * gap:.1e} mm")
        if sys.argv[1:]:
            print(f"  MuJoCo's connect: crank within {1e3 * np.abs(of_mujoco(start, period) - cranks).max():.3f} mrad")
        for substeps in (1, 2, 4, 8, 16, 32, 64):
            for kind in ("midpoint", "rk4"):
                tried = []
                for stiffness in 10 ** np.arange(3, 8.01, 0.25):
                    found = run(spring(stiffness, 1.4 * np.sqrt(stiffness * lightest)), start, period, substeps, kind)
                    if found is None:
                        break
                    tried.append((found[1], stiffness, np.abs(found[0] - cranks).max()))
                if tried:
                    gap, stiffness, error = min(tried)
                    print(f"  {substeps:2d} substeps, {kind:8s}: {stiffness:7.1e} N/m, gap {1e3 * gap:6.3f} mm, "
                          f"crank {1e3 * error:7.3f} mrad", flush=True)


if __name__ == "__main__":
    main()
