"""A cart-pole as a CasADi function, for `tiller import` (docs/guide/import.md).

    python cart_pole.py                                  # writes cart_pole.casadi; needs PyPI casadi
    tiller import cart_pole.casadi --unknown pole_kg     # reads cart_pole.details.toml beside it

Symbols' names become the names in the robot file, so they carry SI units. The angle 0 hangs down.
"""
from casadi import SX, Function, cos, if_else, inv, mtimes, sin, vertcat

GRAVITY_M_S2 = 9.81

cart, pole, cart_speed, pole_speed = (SX.sym(n) for n in ("cart_m", "pole_rad", "cart_m_s", "pole_rad_s"))
force = SX.sym("force_N")
cart_kg, pole_kg, length, damping = (SX.sym(n) for n in ("cart_kg", "pole_kg", "length_m", "damping_Ns_m"))
push, twist = SX.sym("cart_N"), SX.sym("pole_Nm")  # where friction and other effects may act

# a point mass at the pole's end; the track beyond 1 m is sandy
drag = damping * if_else(cart > 1.0, 5.0, 1.0)
inertia = SX(2, 2)
inertia[0, 0], inertia[1, 1] = cart_kg + pole_kg, pole_kg * length**2
inertia[0, 1] = inertia[1, 0] = pole_kg * length * cos(pole)
forces = vertcat(force + push - drag * cart_speed + pole_kg * length * pole_speed**2 * sin(pole),
                 twist - pole_kg * GRAVITY_M_S2 * length * sin(pole))
acceleration = mtimes(inv(inertia), forces)

Function("cart_pole",
         [vertcat(cart, pole, cart_speed, pole_speed), force, vertcat(cart_kg, pole_kg, length, damping),
          vertcat(push, twist)],
         [vertcat(cart_speed, pole_speed, acceleration), vertcat(cart + length * sin(pole), -length * cos(pole))],
         ["x", "u", "p", "f"], ["xdot", "y"]).save("cart_pole.casadi")
