"""MuJoCo as a simulator for `tiller infer`: python -m tiller_tools.mujoco_simulator model.xml [options]

Speaks the lines of docs/guide/simulator.md. By the names in tiller's greeting:

    parameters    each by --parameter NAME=FIELD[ELEMENT,COLUMN], a field of mjModel: geom_friction[puck,0],
                  body_mass[cart], dof_damping[hinge]. ELEMENT is a name or an index. NAME may be given more than once:
                  all fields get the value. A body's inertia is scaled with its mass.
    measurements  each a joint's name for its position, or NAME=qpos:JOINT, qvel:JOINT or sensor:SENSOR by --measure.
                  Of joints and sensors with several numbers, one by its place from 0: qpos:free[2]. A request's start
                  sets qpos and qvel; sensors it cannot set.
    inputs        each an actuator's name, or --input NAME=ACTUATOR

Contact has one friction coefficient, by default the larger of the two geoms'. Give the other geom a small one (or one
of them a higher priority), or what is learnt moves nothing.

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


_UNSTABLE = ("mjWARN_BADQPOS", "mjWARN_BADQVEL", "mjWARN_BADQACC", "mjWARN_BADCTRL")
_KIND = {"geom": "GEOM", "body": "BODY", "dof": "JOINT", "jnt": "JOINT", "actuator": "ACTUATOR", "site": "SITE"}


class Machine:
    """A model with what the names of a greeting mean in it."""

    def __init__(self, mujoco, arguments: argparse.Namespace, hello: dict):
        try:
            self.mujoco, self.model = mujoco, mujoco.MjModel.from_xml_path(arguments.model)
        except (ValueError, OSError) as error:
            sys.exit(f"{arguments.model}: MuJoCo does not read it: {error}")
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
        self.measures = [self._measure(name, dict(_pairs(arguments.measure))) for name in hello["measurements"]]
        self.has_sensors = any(kind == "sensordata" for kind, _ in self.measures)
        inputs = dict(_pairs(arguments.input))
        self.actuators = [self._id("ACTUATOR", inputs.get(name, name), f"input {name}: ", f"--input {name}=ACTUATOR")
                          for name in hello["inputs"]]
        self.unstable = [int(getattr(mujoco.mjtWarning, name)) for name in _UNSTABLE]

    def _id(self, kind: str, name: str, whose: str, remedy: str) -> int:
        kinds, count = getattr(self.mujoco.mjtObj, f"mjOBJ_{kind}"), {"ACTUATOR": "nu", "JOINT": "njnt"}
        size = getattr(self.model, count.get(kind, f"n{kind.lower()}"))
        index = int(name) if name.isdigit() else self.mujoco.mj_name2id(self.model, kinds, name)
        if not 0 <= index < size:
            names = [self.mujoco.mj_id2name(self.model, kinds, i) or str(i) for i in range(size)]
            sys.exit(f"{whose}the model has no {kind.lower()} '{name}' but {', '.join(names[:20]) or 'none at all'}; "
                     f"write {remedy}")
        return index

    def _field(self, what: str):
        match = re.fullmatch(r"(\w+)\[([^,\]]+)(?:,(\d+))?\]", what)
        kind = _KIND.get(what.split("_")[0])
        if not match or not kind or not hasattr(self.model, match[1]):
            sys.exit(f"{what}: is no field of the model; write such as geom_friction[puck,0] or body_mass[cart]")
        index = self._id(kind, match[2], f"{what}: ", f"{match[1]}[NAME]")
        if match[1].startswith("dof"):
            index = self.model.jnt_dofadr[index]
        field = match[1], (index,) if match[3] is None else (index, int(match[3]))
        try:
            value = getattr(self.model, field[0])[field[1]]
        except (IndexError, TypeError):
            sys.exit(f"{what}: the field has no such place; write such as geom_friction[puck,0] or body_mass[cart]")
        if getattr(value, "size", 1) != 1:
            sys.exit(f"{what}: is {value.size} numbers; choose one: {match[1]}[{match[2]},0]")
        return field

    def _measure(self, name: str, measures: dict):
        what = measures.get(name, "qpos:" + name)
        whose, remedy = f"measurement {name}: ", f"--measure {name}=qpos:JOINT, qvel:JOINT or sensor:SENSOR"
        match = re.fullmatch(r"(qpos|qvel|sensor):([^\[\]]+)(?:\[(\d+)\])?", what)
        if not match:
            sys.exit(f"{whose}'{what}' is none; write {remedy}")
        kind, place, model = match[1], int(match[3] or 0), self.model
        index = self._id("SENSOR" if kind == "sensor" else "JOINT", match[2], whose, remedy)
        if kind == "sensor":
            first, size = model.sensor_adr[index], model.sensor_dim[index]
        else:
            sizes = {"qpos": (7, 4, 1, 1), "qvel": (6, 3, 1, 1)}[kind]  # free, ball, slide, hinge
            first = (model.jnt_qposadr if kind == "qpos" else model.jnt_dofadr)[index]
            size = sizes[model.jnt_type[index]]
        if place >= size:
            sys.exit(f"{whose}'{what}' has {size} numbers; choose a place below {size}")
        return "sensordata" if kind == "sensor" else kind, first + place

    def set_parameters(self, values: list[float]) -> None:
        for value, found in zip(values, self.fields):
            for name, index in found:
                getattr(self.model, name)[index] = value
                if name == "body_mass" and self.first_mass[index] > 0:
                    self.model.body_inertia[index] = self.first_inertia[index] * value / self.first_mass[index]
        self.mujoco.mj_resetData(self.model, self.data)
        self.mujoco.mj_setConst(self.model, self.data)

    def answer(self, ask: dict) -> dict:
        model, data = self.model, self.data
        self.set_parameters(ask["parameters"])
        for value, (kind, index) in zip(ask["start"], self.measures):
            if kind != "sensordata":
                getattr(data, kind)[index] = value
        rows = []
        for period, inputs in enumerate(ask["inputs"], 1):
            for actuator, value in zip(self.actuators, inputs):
                data.ctrl[actuator] = value
            self.mujoco.mj_step(model, data, self.steps)
            # it resets the state by itself where it diverges, and goes on as if nothing had been
            if any(data.warning[kind].number for kind in self.unstable):
                return {"id": ask["id"], "error": f"MuJoCo: the simulation is unstable in period {period}"}
            if self.has_sensors:  # a step leaves what they showed before it
                self.mujoco.mj_forward(model, data)
            rows.append([float(getattr(data, kind)[index]) for kind, index in self.measures])
        return {"id": ask["id"], "measured": rows}


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
    try:
        hello = json.loads(sys.stdin.readline())
    except ValueError:
        sys.exit("no greeting on stdin: tiller infer starts this program, from the command of a simulator file")
    machine = Machine(mujoco, arguments, hello)
    print(json.dumps({"tiller_simulator": 1}), flush=True)
    for line in sys.stdin:
        print(json.dumps(machine.answer(json.loads(line))), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
