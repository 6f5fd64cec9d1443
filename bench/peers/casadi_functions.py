"""casadi_functions.py FOLDER NAME STATES: a model as a CasADi function, xdot = f(x, u, p), and what is compared.

Writes FOLDER/NAME.casadi, its C code NAME.c, and NAME.details.toml; prints a line of JSON for each of STATES random
points: x, u, p, then xdot and its slopes by x and by u, by CasADi.
"""
import json
import pathlib
import sys

import casadi as ca
import numpy as np


def symbols(*names):
    return [ca.SX.sym(name) for name in names]


def cart_pole():
    x, a, v, w = symbols("x_m", "pole_rad", "x_m_s", "pole_rad_s")
    u, (cart, pole, length) = ca.SX.sym("u_N"), symbols("cart_kg", "pole_kg", "length_m")
    s, c = ca.sin(a), ca.cos(a)
    total = cart + pole * s**2
    acceleration = (u + pole * s * (length * w**2 + 9.81 * c)) / total
    turn = -(u * c + pole * length * w**2 * c * s + (cart + pole) * 9.81 * s) / (length * total)
    return [x, a, v, w], [v, w, acceleration, turn], [u], [cart, pole, length], [1.0, 0.2, 0.5]


def car():
    """A single-track car with saturated tyres; below 1 m/s the slip is that of 1 m/s."""
    x, y, h, v, w, r, d = symbols("x_m", "y_m", "heading_rad", "speed_m_s", "slip_m_s", "yaw_rad_s", "steer_rad")
    u = symbols("accel_m_s2", "steer_rad_s")
    m, i, a, b, stiff, grip = p = symbols("mass_kg", "inertia_kgm2", "front_m", "rear_m", "stiff_N_rad", "grip_N")
    along = ca.if_else(v > 1, v, 1)
    tyre = lambda slip: -grip * ca.tanh(stiff / grip * ca.atan(slip))
    front, rear = tyre((w + a * r) / along - ca.tan(d)), tyre((w - b * r) / along)
    rates = [v * ca.cos(h) - w * ca.sin(h), v * ca.sin(h) + w * ca.cos(h), r, u[0] + w * r - front * ca.sin(d) / m,
             (front * ca.cos(d) + rear) / m - v * r, (a * front * ca.cos(d) - b * rear) / i, u[1]]
    return [x, y, h, v, w, r, d], rates, u, p, [1200.0, 1500.0, 1.2, 1.4, 6e4, 6e3]


def quadrotor():
    x = symbols(*"px_m py_m pz_m qw qx qy qz vx_m_s vy_m_s vz_m_s wx_rad_s wy_rad_s wz_rad_s".split())
    u = symbols("t0_N", "t1_N", "t2_N", "t3_N")
    mass, arm, ixx, iyy, izz, drag = p = symbols("mass_kg", "arm_m", "ixx_kgm2", "iyy_kgm2", "izz_kgm2", "drag_m")
    q, v, w = x[3:7], ca.vertcat(*x[7:10]), ca.vertcat(*x[10:13])
    a, (b, c, d) = q[0], q[1:]
    thrust = sum(u)
    up = ca.vertcat(2 * (b * d + a * c), 2 * (c * d - a * b), a**2 - b**2 - c**2 + d**2)
    turn = [0.5 * e for e in (-b * w[0] - c * w[1] - d * w[2], a * w[0] + c * w[2] - d * w[1],
                              a * w[1] - b * w[2] + d * w[0], a * w[2] + b * w[1] - c * w[0])]
    force = up * thrust / mass - ca.vertcat(0, 0, 9.81)
    torque = ca.vertcat(arm * (u[1] - u[3]), arm * (u[2] - u[0]), drag * (u[0] - u[1] + u[2] - u[3]))
    inertia = ca.vertcat(ixx, iyy, izz)
    spin = (torque - ca.cross(w, inertia * w)) / inertia
    rates = ca.vertsplit(v) + turn + ca.vertsplit(force) + ca.vertsplit(spin)
    return x, rates, u, p, [0.8, 0.2, 0.005, 0.005, 0.009, 0.016]


def triple_pendulum():
    """Three links on a cart, by Lagrange: CasADi differentiates the energies and solves for the accelerations."""
    q, v = symbols("cart_m", "a_rad", "b_rad", "c_rad"), symbols("cart_m_s", "a_rad_s", "b_rad_s", "c_rad_s")
    u, p = symbols("force_N"), symbols("cart_kg", "a_kg", "b_kg", "c_kg", "length_m")
    coordinates, speeds = ca.vertcat(*q), ca.vertcat(*v)
    place, kinetic, potential = ca.vertcat(q[0], 0), 0.5 * p[0] * v[0]**2, 0
    for angle, mass in zip(q[1:], p[1:4]):
        place = place + p[4] * ca.vertcat(ca.sin(angle), -ca.cos(angle))
        kinetic = kinetic + 0.5 * mass * ca.sumsqr(ca.jtimes(place, coordinates, speeds))
        potential = potential + 9.81 * mass * place[1]
    momentum = ca.gradient(kinetic, speeds)
    push = ca.vertcat(u[0], 0, 0, 0) + ca.gradient(kinetic - potential, coordinates)
    push = push - ca.jtimes(momentum, coordinates, speeds)
    acceleration = ca.solve(ca.jacobian(momentum, speeds), push)
    return q + v, v + ca.vertsplit(acceleration), u, p, [1.0, 0.3, 0.2, 0.1, 0.4]


MODELS = {"cart pole": cart_pole, "car": car, "quadrotor": quadrotor, "triple pendulum": triple_pendulum}


def main():
    folder, name, states = pathlib.Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
    x, rates, u, p, nominal = MODELS[name]()
    stem = name.replace(" ", "_")
    given = [ca.vertcat(*x), ca.vertcat(*u), ca.vertcat(*p)]
    function = ca.Function("f", given, [ca.vertcat(*rates)], ["x", "u", "p"], ["xdot"])
    function.save(str(folder / f"{stem}.casadi"))
    generator = ca.CodeGenerator(f"{stem}.c")
    generator.add(function)
    generator.generate(f"{folder}/")
    values = "\n".join(f"{s.name()} = {v}" for s, v in zip(p, nominal))
    (folder / f"{stem}.details.toml").write_text(f"[parameters]\n{values}\n", encoding="utf-8")
    slopes = ca.Function("s", given, [ca.jacobian(ca.vertcat(*rates), ca.vertcat(*x, *u))])
    rng = np.random.default_rng(1)
    for _ in range(states):
        at = [rng.uniform(-1.5, 1.5, len(x)).tolist(), rng.uniform(-2, 2, len(u)).tolist(),
              [n * rng.uniform(0.7, 1.4) for n in nominal]]
        print(json.dumps({"row": sum(at, []), "xdot": np.array(function(*at)).ravel().tolist(),
                          "slopes": np.array(ca.DM(slopes(*at)).full()).ravel().tolist()}))


if __name__ == "__main__":
    main()
