"""A robot in MuJoCo's format, compiled by MuJoCo itself, as JSON that `tiller import` reads.

    python -m tiller_tools.mjcf ROBOT OUT

ROBOT is an MJCF or an .mjb. OUT holds the compiled model's bodies, joints and what acts on them, in MuJoCo's own words
and units, or {"error": ...} where it does not compile. Nothing of the XML is read here: defaults, includes, classes and
inertias from meshes are the compiler's.
"""

import json
import pathlib
import sys


def compiled(mujoco, path):
    if path.read_bytes()[:1] == b"1":  # an .mjb begins with 54321, an XML with "<" or a byte order mark
        return mujoco.MjModel.from_binary_path(str(path))
    return mujoco.MjModel.from_xml_path(str(path))


def word(enum, value, prefix):
    """mjGAIN_FIXED: "fixed"."""
    try:
        return enum(int(value)).name[len(prefix):].lower()
    except ValueError:
        return f"kind {int(value)}"


class Names:
    """Names of one kind, made up where the file has none, each once."""

    def __init__(self, mujoco, model, kind, count, fallback):
        self.of, taken = [], set()
        for k in range(count):
            name = mujoco.mj_id2name(model, kind, k) or fallback(k)
            while name in taken:
                name += "_"
            taken.add(name)
            self.of.append(name)


def touching_world(m, body):
    """Bodies that move and have a shape that may touch one of what stands on the world."""
    stands = lambda g: m.body_weldid[m.geom_bodyid[g]] == 0
    meets = lambda a, b: m.geom_contype[a] & m.geom_conaffinity[b] or m.geom_contype[b] & m.geom_conaffinity[a]
    pairs = [(a, b) for b in range(m.ngeom) if stands(b) for a in range(m.ngeom) if meets(a, b)]
    pairs += [ends for k in range(m.npair) for ends in ((m.pair_geom1[k], m.pair_geom2[k]), (m.pair_geom2[k], m.pair_geom1[k]))
              if stands(ends[1])]
    apart = {int(s) for s in m.exclude_signature}  # a body's number above 16 bits, the other's below
    own = lambda g: int(m.geom_bodyid[g])
    moving = {own(a) for a, b in pairs if not stands(a) and not {own(a) << 16 | own(b), own(b) << 16 | own(a)} & apart}
    return [body[k] for k in sorted(moving)]


def tendon_of(mujoco, m, k, name, joint, no_springs, no_damping, no_friction, no_limits):
    """A fixed tendon with its joints and coefficients; one over sites has none of them."""
    wraps = range(m.tendon_adr[k], m.tendon_adr[k] + m.tendon_num[k])
    fixed = all(m.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT for w in wraps)
    value = lambda field, off=False: 0.0 if off or not hasattr(m, field) else float(getattr(m, field)[k])
    higher = any(any(getattr(m, f)[k]) for f in ("tendon_stiffnesspoly", "tendon_dampingpoly") if hasattr(m, f))
    out = {"name": name, "joints": [[joint[m.wrap_objid[w]], float(m.wrap_prm[w])] for w in wraps] if fixed and not higher else [],
           "stiffness": value("tendon_stiffness", no_springs), "damping": value("tendon_damping", no_damping),
           "frictionloss": value("tendon_frictionloss", no_friction), "armature": value("tendon_armature"),
           "spring_range": m.tendon_lengthspring[k].tolist(), "limited": bool(m.tendon_limited[k]) and not no_limits,
           "range": m.tendon_range[k].tolist()}
    acting = ("stiffness", "damping", "frictionloss", "armature", "limited")
    return {**out, "acts": higher or any(out[key] for key in acting)}


def shapes_of(mujoco, m, geom, body):
    """What a contact may be made of, with what MuJoCo mixes for a pair."""
    return [{"name": geom[k], "body": body[m.geom_bodyid[k]], "type": word(mujoco.mjtGeom, m.geom_type[k], "mjGEOM_"),
             "pos": m.geom_pos[k].tolist(), "quat": m.geom_quat[k].tolist(), "size": m.geom_size[k].tolist(),
             "friction": float(m.geom_friction[k][0]), "condim": int(m.geom_condim[k]),
             "priority": int(m.geom_priority[k]), "solmix": float(m.geom_solmix[k]),
             "solref": m.geom_solref[k].tolist(), "solimp": m.geom_solimp[k].tolist()} for k in range(m.ngeom)]


def pairs_of(m, geom):
    return [{"geoms": [geom[m.pair_geom1[k]], geom[m.pair_geom2[k]]], "friction": float(m.pair_friction[k][0]),
             "condim": int(m.pair_dim[k]), "solref": m.pair_solref[k].tolist(), "solimp": m.pair_solimp[k].tolist()}
            for k in range(m.npair)]


def sensor_of(mujoco, m, k, name, named):
    """A sensor with what it is attached to, and what MuJoCo does beside reading it."""
    kind, held_by = word(mujoco.mjtSensor, m.sensor_type[k], "mjSENS_"), word(mujoco.mjtObj, m.sensor_objtype[k], "mjOBJ_")
    value = lambda field: float(getattr(m, field)[k]) if hasattr(m, field) else 0.0  # not in every version
    target = int(m.sensor_objid[k])
    return {"name": name, "type": kind, "of": held_by,
            "target": named[held_by][target] if held_by in named and target >= 0 else "",
            "relative": int(m.sensor_refid[k]) >= 0, "noise": value("sensor_noise"), "cutoff": value("sensor_cutoff"),
            "delay": value("sensor_delay")}


def describe(mujoco, m, stem):
    obj, lists = mujoco.mjtObj, lambda rows: [[float(v) for v in row] for row in rows]
    body = Names(mujoco, m, obj.mjOBJ_BODY, m.nbody, lambda k: f"body{k}").of
    joint = Names(mujoco, m, obj.mjOBJ_JOINT, m.njnt, lambda k: f"{body[m.jnt_bodyid[k]]}_joint").of
    names = lambda kind, count, what: Names(mujoco, m, kind, count, lambda k: f"{what}{k}").of
    site = names(obj.mjOBJ_SITE, m.nsite, "site")
    tendon = names(obj.mjOBJ_TENDON, m.ntendon, "tendon")
    own = m.names[:m.names.index(b"\0")].decode()
    optional = lambda field, k, none=0.0: getattr(m, field)[k] if hasattr(m, field) else none  # not in every version

    def off(*what):  # switched off by <option><flag/>
        bits = [getattr(mujoco.mjtDisableBit, "mjDSBL_" + w, 0) for w in what]
        return any(m.opt.disableflags & int(b) for b in bits)

    no_springs, no_damping = off("SPRING", "PASSIVE"), off("DAMPER", "PASSIVE")
    no_friction, no_limits = off("FRICTIONLOSS", "CONSTRAINT"), off("LIMIT", "CONSTRAINT")
    out = {"mujoco": mujoco.__version__, "name": own if own not in ("", "MuJoCo Model") else stem,
           "gravity": [0.0, 0.0, 0.0] if off("GRAVITY") else m.opt.gravity.tolist(),
           "density": m.opt.density, "viscosity": m.opt.viscosity}
    out["bodies"] = [{"name": body[k], "parent": int(m.body_parentid[k]), "on_world": int(m.body_weldid[k]) == 0,
                      "pos": m.body_pos[k].tolist(), "quat": m.body_quat[k].tolist(), "mass": float(m.body_mass[k]),
                      "ipos": m.body_ipos[k].tolist(), "iquat": m.body_iquat[k].tolist(),
                      "inertia": m.body_inertia[k].tolist(), "gravcomp": float(m.body_gravcomp[k])}
                     for k in range(m.nbody)]
    out["joints"] = []
    for k in range(m.njnt):
        q, v, kind = m.jnt_qposadr[k], m.jnt_dofadr[k], word(mujoco.mjtJoint, m.jnt_type[k], "mjJNT_")
        extra = [what for what, there in (
            ("springs of higher order", any(optional("jnt_stiffnesspoly", k, []))),
            ("damping of higher order", any(optional("dof_dampingpoly", v, []))),
            ("a spring that yields", optional("jnt_springyield", k) > 0.0)) if there]
        out["joints"].append({
            "name": joint[k], "type": kind, "body": int(m.jnt_bodyid[k]), "pos": m.jnt_pos[k].tolist(),
            "axis": m.jnt_axis[k].tolist(), "limited": bool(m.jnt_limited[k]) and not no_limits,
            "range": m.jnt_range[k].tolist(),
            "armature": float(m.dof_armature[v]), "damping": 0.0 if no_damping else float(m.dof_damping[v]),
            "frictionloss": 0.0 if no_friction else float(m.dof_frictionloss[v]),
            "stiffness": 0.0 if no_springs else float(m.jnt_stiffness[k]),
            "springref": float(m.qpos_spring[q]), "ref": float(m.qpos0[q]),
            "force_limited": bool(m.jnt_actfrclimited[k]), "force_range": m.jnt_actfrcrange[k].tolist(),
            "beyond": extra})

    targets = {"joint": joint, "jointinparent": joint, "tendon": tendon, "site": site, "body": body,
               "slidercrank": site}
    actuator = names(obj.mjOBJ_ACTUATOR, len(m.actuator_trntype), "actuator")
    out["actuators"] = []
    for k, name in enumerate(actuator):
        kind, control = word(mujoco.mjtTrn, m.actuator_trntype[k], "mjTRN_"), optional("actuator_ctrladr", k, k)
        target = int(m.actuator_trnid[k][0])
        out["actuators"].append({
            "name": name, "transmission": kind,
            "target": targets[kind][target] if kind in targets and target >= 0 else "",
            "gear": float(m.actuator_gear[optional("actuator_outadr", k, k)][0]),
            "dynamics": word(mujoco.mjtDyn, m.actuator_dyntype[k], "mjDYN_"),
            "gain": word(mujoco.mjtGain, m.actuator_gaintype[k], "mjGAIN_"),
            "gain_values": m.actuator_gainprm[k].tolist(),
            "bias": word(mujoco.mjtBias, m.actuator_biastype[k], "mjBIAS_"),
            "bias_values": m.actuator_biasprm[k].tolist(),
            "control_limited": bool(m.actuator_ctrllimited[control]),
            "control_range": m.actuator_ctrlrange[control].tolist(),
            "force_limited": bool(m.actuator_forcelimited[k]), "force_range": m.actuator_forcerange[k].tolist(),
            "armature": float(optional("actuator_armature", k)),
            "damping": 0.0 if no_damping else float(optional("actuator_damping", k)),
            "delay": float(optional("actuator_delay", k)), "plugin": int(m.actuator_plugin[k]) >= 0})

    out["equalities"] = []
    for k, name in enumerate(names(obj.mjOBJ_EQUALITY, m.neq, "equality")):
        kind, ends = word(mujoco.mjtEq, m.eq_type[k], "mjEQ_"), [int(m.eq_obj1id[k]), int(m.eq_obj2id[k])]
        on_sites = m.eq_objtype[k] == obj.mjOBJ_SITE
        entry = {"name": name, "type": kind, "active": bool(m.eq_active0[k]) and not off("EQUALITY", "CONSTRAINT"),
                 "data": m.eq_data[k][:5].tolist()}
        if kind == "joint":
            entry["joints"] = [joint[e] for e in ends if e >= 0]
        elif kind in ("connect", "weld"):
            entry["bodies"] = [body[m.site_bodyid[e] if on_sites else e] for e in ends]
        out["equalities"].append(entry)

    out["tendons"] = [tendon_of(mujoco, m, k, tendon[k], joint, no_springs, no_damping, no_friction, no_limits)
                      for k in range(m.ntendon)]
    out["sites"] = [{"name": site[k], "body": int(m.site_bodyid[k]), "pos": m.site_pos[k].tolist(),
                     "quat": m.site_quat[k].tolist()} for k in range(m.nsite)]
    out["keyframes"] = [{"name": name, "positions": [float(m.key_qpos[k][a]) for a in m.jnt_qposadr]}
                        for k, name in enumerate(names(obj.mjOBJ_KEY, m.nkey, "key"))]
    named = {"joint": joint, "site": site, "xbody": body, "body": body, "tendon": tendon, "actuator": actuator}
    out["sensors"] = [sensor_of(mujoco, m, k, name, named)
                      for k, name in enumerate(names(obj.mjOBJ_SENSOR, m.nsensor, "sensor"))]
    out["touching"] = int(sum(1 for k in range(m.ngeom) if m.geom_contype[k] or m.geom_conaffinity[k])) + m.npair
    out["touching_world"] = touching_world(m, body)
    geom = names(obj.mjOBJ_GEOM, m.ngeom, "geom")
    out["shapes"], out["pairs"], out["impratio"] = shapes_of(mujoco, m, geom, body), pairs_of(m, geom), m.opt.impratio
    out["fluid_bodies"] = sorted({body[m.geom_bodyid[k]] for k in range(m.ngeom) if m.geom_fluid[k][0] > 0.0})
    out["plugins"] = names(obj.mjOBJ_PLUGIN, m.nplugin, "plugin")
    out["flexes"] = names(obj.mjOBJ_FLEX, m.nflex, "flex")
    return out


def main():
    path, out = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    try:
        import mujoco
    except ImportError:
        result = {"error": f"MuJoCo's own compiler reads this format, and {sys.executable} has no package mujoco; "
                           f"install it once: {sys.executable} -m pip install mujoco (or set TILLER_PYTHON to an "
                           "interpreter that has it)"}
    else:
        try:
            result = describe(mujoco, compiled(mujoco, path), path.stem)
        except (ValueError, OSError) as refusal:  # what MuJoCo's compiler says, in its own words
            result = {"error": "MuJoCo does not compile it: " + " ".join(str(refusal).split())}
    out.write_text(json.dumps(result), encoding="utf-8")


if __name__ == "__main__":
    main()
