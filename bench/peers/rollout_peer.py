"""Batched rollouts of a cart-pole by mujoco.rollout and by JAX (vmap over lanes, scan over steps, jit): nanoseconds a
lane and step, one line of JSON. rollout_peer.py mujoco|jax LANES STEPS"""
import json
import sys
import time

import numpy as np

ROUNDS = 7
PERIOD_S, GRAVITY = 0.02, 9.81
CART_KG, POLE_KG, HALF_M, DAMPING = 1.0, 0.1, 0.5, 0.2
CART_POLE = f"""
<mujoco>
  <option timestep="{PERIOD_S}" integrator="RK4" gravity="0 0 -{GRAVITY}">
    <flag contact="disable" constraint="disable"/></option>
  <worldbody>
    <body><joint name="cart" type="slide" axis="1 0 0" damping="{DAMPING}"/>
      <geom type="box" size=".1 .1 .1" mass="{CART_KG}"/>
      <body><joint name="pole" type="hinge" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 {2 * HALF_M}" size=".02" mass="{POLE_KG}"/></body></body>
  </worldbody>
  <actuator><motor joint="cart" gear="1"/></actuator>
</mujoco>"""


def fastest(call):
    call()
    best = float("inf")
    for _ in range(ROUNDS):
        begin = time.perf_counter_ns()
        call()
        best = min(best, time.perf_counter_ns() - begin)
    return best


def by_mujoco(lanes, inputs):
    import mujoco
    from mujoco import rollout

    model = mujoco.MjModel.from_xml_string(CART_POLE)
    data = mujoco.MjData(model)
    start = np.zeros((lanes, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    start[:, 1] = 0.1
    with rollout.Rollout(nthread=0) as pool:
        return fastest(lambda: pool.rollout([model] * lanes, data, start, inputs))


def by_jax(lanes, inputs):
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp

    def rate(x, u):
        s, c = jnp.sin(x[1]), jnp.cos(x[1])
        push = u[0] - DAMPING * x[2] + POLE_KG * HALF_M * x[3] ** 2 * s
        a = (push - 0.75 * POLE_KG * GRAVITY * s * c) / (CART_KG + POLE_KG - 0.75 * POLE_KG * c * c)
        return jnp.stack([x[2], x[3], a, 0.75 * (GRAVITY * s - a * c) / HALF_M])

    def step(x, u):
        a = rate(x, u)
        b = rate(x + PERIOD_S / 2 * a, u)
        c = rate(x + PERIOD_S / 2 * b, u)
        x = x + PERIOD_S / 6 * (a + 2 * b + 2 * c + rate(x + PERIOD_S * c, u))
        return x, x

    batch = jax.jit(jax.vmap(lambda x, u: jax.lax.scan(step, x, u)[1]))
    start, given = jnp.tile(jnp.array([0, 0.1, 0, 0.0]), (lanes, 1)), jnp.asarray(inputs)
    return fastest(lambda: batch(start, given).block_until_ready())


def main():
    lanes, steps = int(sys.argv[2]), int(sys.argv[3])
    inputs = np.random.default_rng(1).uniform(-1, 1, (lanes, steps, 1))
    ns = {"mujoco": by_mujoco, "jax": by_jax}[sys.argv[1]](lanes, inputs)
    print(json.dumps({"name": sys.argv[1], "ns": ns / (lanes * steps)}))


main()
