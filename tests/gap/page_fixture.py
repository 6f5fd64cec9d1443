"""A gap.json as `tiller gap` writes it, of each verdict, without running anything."""

import numpy as np


def _map(joint: str, force: str, axis: str, label: str, z: float, values: np.ndarray) -> dict:
    rng = np.random.default_rng(len(axis))
    edges = np.linspace(-3, 3, len(values) + 1)
    bins = [{"low": a, "high": b, "mean": float(v), "sd": 0.01, "count": 20.0}
            for a, b, v in zip(edges[:-1], edges[1:], values)]
    null = list(0.1 + 0.04 * np.abs(rng.standard_normal(499)))
    return {"joint": joint, "force": force, "axis": axis, "axis_label": label, "statistic": 0.1 + 0.03 * z, "z": z,
            "p_value": 0.002 if z > 4 else 0.4, "bins": bins, "null": null}


def _explanation(kinds: list, gain: float, z_to_best: float, left: float, params: list) -> dict:
    return {"effects": [{"kind": kind, "port_kind": "joint", "port": "joint"} for kind in kinds], "parameters": params,
            "gain_nats": gain, "z": gain / 20, "z_to_best": z_to_best, "robust_z_to_best": z_to_best,
            "rollout_ratio": left, "remaining_sigma": left, "equivalent": z_to_best == 0}


def gap_result(verdict: str = "named", channels: int = 1) -> dict:
    x = np.linspace(-3, 3, 10)
    mass = {"name": "mass_kg", "unit": "kg", "of": "robot_file", "fixed": False, "before": 0.561, "before_sd": 0.004,
            "mean": 0.502, "sd": 0.002, "interval_95": [0.498, 0.506],
            "edge": {"at": "lower bound", "value": 0.5, "by": "prior",
                     "text": "mass_kg at its lower bound 0.5: widen the prior"}}
    length = {"name": "length_m", "unit": "m", "of": "robot_file", "fixed": True, "before": 0.4, "before_sd": 0.0,
              "mean": 0.4, "sd": 0.0, "interval_95": [0.4, 0.4]}
    friction = {"name": "joint.friction_SI", "unit": "N m", "of": "effect", "fixed": False, "before": None,
                "before_sd": None, "mean": 0.101, "sd": 0.001, "interval_95": [0.099, 0.103]}
    ranking = [_explanation(["coulomb_friction"], 812.0, 0.0, 1.01, [mass, length, friction]),
               _explanation(["stribeck_friction"], 810.0, 0.4, 1.01, [mass, length, friction]),
               _explanation(["viscous_friction"], 421.0, 9.1, 2.4, [mass, length, friction]),
               _explanation([], 0.0, 21.0, 5.2, [mass, length])]
    t = np.linspace(0, 2, 200)
    wave = np.sin(4 * t)
    gap = {"horizons": [{"seconds": s, "before_sigma": b, "after_sigma": 1.0 + 0.02 * s, "before_rms": [2e-3 * b] * channels,
                         "after_rms": [2e-3] * channels, "windows": 12} for s, b in ((0.5, 2.1), (1.0, 5.2), (2.0, 9.9))],
           "overlays": [{"log": log, "first_time_s": 3.0, "time_s": list(t), "measured": [list(wave)],
                         "before": [list(0.8 * wave)], "after": [list(wave)], "input": [list(np.sign(wave))]}
                        for log in ("runs/a.csv", "runs/b.csv")]}
    catalogue = {kind: {"help": f"{kind} in a line", "equation": "force = -friction sign(v)", "source": "a textbook",
                        "aliases": ["stribeck_friction"], "separation": "move slowly"}
                 for kind in ("coulomb_friction", "stribeck_friction", "viscous_friction")}
    found = verdict in ("named", "ambiguous", "partly_explained")
    result = {
        "format": "tiller-gap", "version": 1, "tiller": "0.1", "verdict": verdict,
        "exit_code": {"no_gap": 0, "named": 1, "unfit": 3}.get(verdict, 2), "interrupted": False,
        "sentence": f"A sentence about <{verdict}> that an engineer acts on.", "notes": ["the noise & the rest"],
        "reasons": [], "budget_sigma": 1.1, "seed": 1,
        "robot": {"name": "arm <1>", "file": "arm.toml", "model": "pendulum", "period_s": 0.01,
                  "inputs": ["torque_Nm"], "hash": "fnv1a-0123"},
        "data": {"logs": ["runs/a.csv", "runs/b.csv"], "hold_out": [], "hash": "fnv1a-4567", "seconds": 48.0,
                 "fit_windows": 40, "decide_windows": 40, "test_windows": 8,
                 "channels": [{"name": f"angle{k or ''}_rad", "unit": "rad", "sd": 0.002}
                              for k in range(channels)]},
        "gate": {"nominal_sigma": 5.45, "noise_ratio": 1.02, "whiteness_p": 0.001},
        "where": {"region": {"joint": "joint", "force": "joint_Nm", "axis": "velocity", "low": 0.0, "high": 3.0,
                             "mean": -0.1, "sd": 0.004, "z": 60.0},
                  "maps": [_map("joint", "joint_Nm", "velocity", "rate_rad_s", 61.0, -0.1 * np.sign(x)),
                           _map("joint", "joint_Nm", "position", "angle_rad", 1.0, 0.01 * np.cos(x)),
                           _map("joint", "joint_Nm", "input_rate", "d torque_Nm/dt", 0.3, 0.01 * x)],
                  "forces": [{"joint": "joint", "force": "joint_Nm", "log": "runs/a.csv", "time_s": list(t),
                              "mean": [None] + list(-0.1 * np.tanh(5 * wave[1:])), "sd": [0.01] * len(t)}],
                  "orders": [{"joint": "joint", "force": "joint_Nm",
                              "amplitude": list(0.02 + 0.2 * (np.arange(1, 80) == 72)), "chance": [0.05] * 78 + [None]}]},
        "ranking": ranking, "ambiguity": [0, 1] if verdict == "ambiguous" else [0] if found else [],
        "leading": 1 if verdict == "leading" else None, "more_s": 20.0 if verdict == "leading" else 0.0,
        "separation": "move slowly through standstill" if verdict in ("ambiguous", "leading") else "", "remaining_sigma": 1.02,
        "catalogue": catalogue, "robot_file": "out/arm_gap.toml" if found else None,
        "cost": {"cpu_s": 2.1, "memory_bytes": 12000000}, **gap}
    if verdict == "unfit":
        result.update(ranking=[], horizons=[], overlays=[], catalogue={}, robot_file=None,
                      where={"region": None, "maps": [], "forces": [], "orders": []},
                      reasons=["runs/a.csv:302: column 'time_s': 0.8 s are missing; cut the file there"])
    if verdict == "no_gap":
        result["where"]["region"] = None
    return result
