"""MuJoCo as a simulator for `tiller infer`: python -m tiller_tools.mujoco_simulator model.xml [options]

Speaks the lines of docs/guide/simulator.md. By the names in tiller's greeting:

    parameters    each by --parameter NAME=FIELD[ELEMENT,COLUMN], a field of mjModel: geom_friction[puck,0],
                  body_mass[cart], dof_damping[hinge]. ELEMENT is a name or an index. NAME may be given more than once:
                  all fields get the value. A body's inertia is scaled with its mass.
    measurements  each a joint's name for its position, or NAME=qpos:JOINT, qvel:JOINT or sensor:SENSOR by --measure
    inputs        each an actuator's name, or --input NAME=ACTUATOR

Example: python -m tiller_tools.mujoco_simulator puck.xml --parameter friction=geom_friction[puck,0] \\
             --measure position_m=qpos:slide --measure speed_m_s=qvel:slide --input force_N=push
"""

from __future__ import annotations

import argparse
import json
import re
import sys


def _pairs(items: list[str]) -> list[tuple[str, str]]:
    pairs = []
    for item in items:
        name, equals, what = item.partition("=")
        if not equals:
            sys.exit(f"{item}: has no '='; write NAME=WHAT")
        pairs.append((name, what))
    return pairs


_KIND = {"geom": "GEOM", "body": "BODY", "dof": "JOINT", "jnt": "JOINT", "actuator": "ACTUATOR", "site": "SITE"}


class Machine:
    """A model with what the names of a greeting mean in it."""

    def __init__(self, mujoco, arguments: argparse.Namespace, hello: dict):
        self.mujoco, self.model = mujoco, mujoco.MjModel.from_xml_path(arguments.model)
        self.data = mujoco.MjData(self.model)
        self.steps = max(1, round(hello["period_s"] / self.model.opt.timestep))
        off = abs(self.steps * self.model.opt.timestep - hello["period_s"])
        if off > 1e-9:
            sys.exit(f"{arguments.model}: timestep {self.model.opt.timestep} s does not divide the period of "
                     f"{hello['period_s']} s; change it in <option>")
        fields = _pairs(arguments.parameter)
        self.fields = [[self._field(what) for name, what in fields if name == parameter]
                       for parameter in hello["parameters"]]
        for parameter, found in zip(hello["parameters"], self.fields):
            if not found:
                sys.exit(f"parameter {parameter}: add --parameter {parameter}=FIELD[ELEMENT,COLUMN]")
        self.first_mass, self.first_inertia = self.model.body_mass.copy(), self.model.body_inertia.copy()
        measures, inputs = dict(_pairs(arguments.measure)), dict(_pairs(arguments.input))
        self.measures = [self._measure(measures.get(name, "qpos:" + name)) for name in hello["measurements"]]
        self.actuators = [self._id("ACTUATOR", inputs.get(name, name)) for name in hello["inputs"]]

    def _id(self, kind: str, name: str) -> int:
        index = int(name) if name.isdigit() else self.mujoco.mj_name2id(
            self.model, getattr(self.mujoco.mjtObj, f"mjOBJ_{kind}"), name)
        if index < 0:
            sys.exit(f"the model has no {kind.lower()} '{name}'")
        return index

    def _field(self, what: str):
        match = re.fullmatch(r"(\w+)\[([^,\]]+)(?:,(\d+))?\]", what)
        kind = _KIND.get(what.split("_")[0])
        if not match or not kind or not hasattr(self.model, match[1]):
            sys.exit(f"{what}: is no field of the model; write such as geom_friction[puck,0] or body_mass[cart]")
        index = self._id(kind, match[2])
        if match[1].startswith("dof"):
            index = self.model.jnt_dofadr[index]
        return match[1], (index,) if match[3] is None else (index, int(match[3]))

    def _measure(self, what: str):
        kind, _, name = what.partition(":")
        if kind == "sensor":
            return "sensordata", self.model.sensor_adr[self._id("SENSOR", name)]
        if kind not in ("qpos", "qvel"):
            sys.exit(f"{what}: write qpos:JOINT, qvel:JOINT or sensor:SENSOR")
        joint = self._id("JOINT", name)
        return kind, (self.model.jnt_qposadr if kind == "qpos" else self.model.jnt_dofadr)[joint]

    def simulate(self, ask: dict) -> list[list[float]]:
        model, data = self.model, self.data
        for value, found in zip(ask["parameters"], self.fields):
            for name, index in found:
                getattr(model, name)[index] = value
                if name == "body_mass":
                    model.body_inertia[index] = self.first_inertia[index] * value / self.first_mass[index]
        self.mujoco.mj_resetData(model, data)
        self.mujoco.mj_setConst(model, data)
        for value, (kind, index) in zip(ask["start"], self.measures):
            if kind != "sensordata":
                getattr(data, kind)[index] = value
        rows = []
        for inputs in ask["inputs"]:
            for actuator, value in zip(self.actuators, inputs):
                data.ctrl[actuator] = value
            self.mujoco.mj_step(model, data, self.steps)
            rows.append([float(getattr(data, kind)[index]) for kind, index in self.measures])
        return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", help="MJCF file")
    parser.add_argument("--parameter", action="append", default=[])
    parser.add_argument("--measure", action="append", default=[])
    parser.add_argument("--input", action="append", default=[])
    arguments = parser.parse_args()
    try:
        import mujoco
    except ImportError:
        sys.exit("the package mujoco is missing; install it where this Python looks: pip install mujoco")
    machine = Machine(mujoco, arguments, json.loads(sys.stdin.readline()))
    print(json.dumps({"tiller_simulator": 1}), flush=True)
    for line in sys.stdin:
        ask = json.loads(line)
        warned = machine.data.warning.number.sum()
        answer = {"id": ask["id"], "measured": machine.simulate(ask)}
        if machine.data.warning.number.sum() > warned > 0:
            answer = {"id": ask["id"], "error": "MuJoCo warned: the simulation is unstable"}
        print(json.dumps(answer), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
