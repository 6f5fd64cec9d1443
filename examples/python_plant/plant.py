"""A cart-pole in Python that tiller steers over LCM, in lockstep. docs/guide/lcm.md explains it."""
import argparse
import math
import lcm
from tiller_lcm import command_t, measurement_t

CART_KG, POLE_KG, HALF_LENGTH_M, FRICTION_NS_M, G_M_S2 = 1.0, 0.08, 0.35, 0.25, 9.81
PERIOD_US, STEP_S = 20000, 0.001

def step(x, angle, v, rate, force):
    """A uniform rod on a cart; angle 0 is upright and grows towards +x. Lagrange's equations, solved for a."""
    s, c = math.sin(angle), math.cos(angle)
    push = force - FRICTION_NS_M * v + POLE_KG * HALF_LENGTH_M * rate * rate * s
    a = (push - 0.75 * POLE_KG * G_M_S2 * s * c) / (CART_KG + POLE_KG - 0.75 * POLE_KG * c * c)
    v, rate = v + STEP_S * a, rate + STEP_S * 0.75 * (G_M_S2 * s - a * c) / HALF_LENGTH_M
    return x + STEP_S * v, angle + STEP_S * rate, v, rate

def answer(bus, inbox, sequence, timeout_ms):
    """The command that answers this measurement, or None."""
    while bus.handle_timeout(timeout_ms):
        while inbox:
            command = command_t.decode(inbox.pop())
            if command.sequence == sequence: return command

options = argparse.ArgumentParser(description=__doc__)
options.add_argument("--angle_rad", type=float, default=math.pi, help="at the start; 0 is upright")
options.add_argument("--seconds", type=float, default=10.0)
options.add_argument("--url", default="udpm://239.255.76.67:7667?ttl=0")
options.add_argument("--prefix", default="TILLER_")
options = options.parse_args()
bus, inbox, state, met, command = lcm.LCM(options.url), [], (0.0, options.angle_rad, 0.0, 0.0), False, None
bus.subscribe(options.prefix + "COMMAND", lambda channel, data: inbox.append(data))
for k in range(int(options.seconds * 1e6 / PERIOD_US)):
    m = measurement_t()  # two encoders, no rates: the order of the robot file's [measurement]
    m.sequence, m.stamp_us, m.count, m.valid_mask, m.value[:2] = k, 10**6 + k * PERIOD_US, 2, 0b11, state[:2]
    tries, wait_ms, command = (1, 20, None) if met and not command else (10, 100, None)
    while command is None and (tries > 0 or not met):  # measurement or answer may be lost: ask again
        bus.publish(options.prefix + "MEASUREMENT", m.encode())
        command, tries = answer(bus, inbox, k, wait_ms), tries - 1
    met = met or command is not None  # after that, no answer: the runtime is gone, and the motor's watchdog acts
    force = command.value[0] if command and math.isfinite(command.value[0]) else 0.0
    for _ in range(round(PERIOD_US * 1e-6 / STEP_S)): state = step(*state, force)
angle = math.remainder(state[1], math.tau)
print("time_s %.2f position_m %.3f angle_rad %.3f" % (k * PERIOD_US * 1e-6, state[0], angle))
