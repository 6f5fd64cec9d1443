"""casadi_test.py TILLER FOLDER [--write]: CasADi functions through CasADi itself, and what the C++ tests store of that.

With casadi: what tiller_tools.casadi_function says of the function below is what function.json has, the values in
function_values.json are CasADi's, and the command imports saved functions or refuses them by name. Without it: exits
with 77, which is a skip. --write stores both files anew.
"""
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile

POINTS, SEED = 40, 11
NAMES = ["a_rad", "b_m", "a_rad_s", "b_m_s", "c"]


def function(casadi):
    """Every operation that an import takes, in equations that mean nothing."""
    ca = casadi
    a, b, va, vb, c = x = [ca.SX.sym(name) for name in NAMES]
    u, f = ca.SX.sym("u", 2), ca.SX.sym("f", 2)
    gains, k = ca.SX.sym("gains", 2, 2), [ca.SX.sym(name) for name in ("k_N", "idle")]
    bounded = 0.9 * ca.sin(b)
    waves = (ca.tan(0.5 * ca.sin(a)) + ca.asin(bounded) + ca.acos(bounded) + ca.atan(vb) + ca.atan2(va, vb) +
             ca.sinh(0.5 * b) + ca.cosh(0.5 * b) + ca.tanh(c) + ca.exp(-vb) + ca.log(2 + ca.cos(a)))
    powers = (b**7 + (2 + ca.sin(b))**-3 + (2 + ca.sin(b))**2.5 + (2 + ca.cos(b))**1.7 + ca.power(1.5 + ca.cos(c), vb) +
              ca.sqrt(1 + vb**2) + ca.hypot(va, c) + 1 / (3 + ca.cos(c)))
    steps = (ca.floor(2 * b) + ca.ceil(1.5 * c) + ca.fmod(5 * b, 2) + ca.remainder(7 * c, 2) + ca.sign(vb) +
             ca.fmin(b, c) + ca.fmax(va, vb) + ca.fabs(c) + ca.copysign(va, c))
    inside = ca.logic_and(b > -1, b <= 1)
    outside = ca.logic_or(ca.logic_not(c < 0), b != 0.5)
    branches = (ca.if_else(inside, c**2, 3 * vb) + ca.if_else(b > 0, ca.sqrt(b), -b) + (c >= vb) * u[1] +
                ca.conditional(ca.floor(c) == 0, [u[0]], va) + ca.if_else(outside, 0.5, b) + ca.if_else(c, 2 * b, 0))
    rate = ca.mtimes(gains, ca.vertcat(u[0] + f[0], f[1])) / (2 + ca.cos(a))
    return ca.Function("f", [ca.vertcat(*x), u, ca.vertcat(ca.vec(gains), *k), f],
                       [ca.vertcat(va, vb, rate[0] + waves, rate[1] + k[0] * powers, steps + branches),
                        ca.vertcat(b * ca.cos(a), k[0] + ca.fabs(b))],
                       ["x", "u", "p", "f"], ["xdot", "y"])


def values(casadi, fun):
    """Random points with the results there and the slopes of xdot along x and u."""
    import numpy as np

    rng, rows = np.random.default_rng(SEED), []
    x, u, p, f = (casadi.SX.sym(name, n) for name, n in (("x", 5), ("u", 2), ("p", 6), ("f", 2)))
    xdot = fun(x, u, p, f)[0]
    slopes = casadi.Function("s", [x, u, p, f], [casadi.jacobian(xdot, x), casadi.jacobian(xdot, u)])
    clean = lambda m: [[v if math.isfinite(v) else str(v) for v in row] for row in np.array(m).tolist()]
    for _ in range(POINTS):
        at = [rng.uniform(low, high, n).round(4).tolist()
              for low, high, n in ((-2, 2, 5), (-2, 2, 2), (0.5, 2, 6), (-2, 2, 2))]
        (by_x, by_u), (rates, told) = slopes(*at), fun(*at)
        rows.append(dict(zip("xupf", at), xdot=np.array(rates).ravel().tolist(), y=np.array(told).ravel().tolist(),
                         by_x=clean(by_x), by_u=clean(by_u)))
    return rows


def described(folder, saved):
    out = pathlib.Path(saved).with_suffix(".out.json")
    package = pathlib.Path(folder).parents[1] / "tools/python"
    subprocess.run([sys.executable, "-m", "tiller_tools.casadi_function", str(saved), str(out)], check=True,
                   env=dict(os.environ, PYTHONPATH=str(package), PYTHONDONTWRITEBYTECODE="1"))
    return out.read_text(encoding="utf-8")


def same(ours, theirs):
    """Equal but for rounding and CasADi's version."""
    if isinstance(ours, dict):
        return set(ours) == set(theirs) and all(same(ours[k], theirs[k]) for k in ours if k != "casadi")
    if isinstance(ours, list):
        return len(ours) == len(theirs) and all(map(same, ours, theirs))
    if isinstance(ours, float) and isinstance(theirs, (int, float)):
        return math.isclose(ours, theirs, rel_tol=1e-12, abs_tol=1e-13)
    return ours == theirs


def write(casadi, folder):
    with tempfile.TemporaryDirectory() as out:
        saved = pathlib.Path(out) / "function.casadi"
        function(casadi).save(str(saved))
        (folder / "function.json").write_text(described(folder, saved), encoding="utf-8")
    rows = ",\n".join(json.dumps(row) for row in values(casadi, function(casadi)))
    (folder / "function_values.json").write_text(f"[\n{rows}\n]\n", encoding="utf-8")


def imported(tiller, file, folder, *options):
    done = subprocess.run([tiller, "import", str(file), "-o", str(folder), *options], capture_output=True, text=True,
                          check=False, env=dict(os.environ, TILLER_PYTHON=sys.executable))
    return done.returncode, done.stdout + done.stderr


def refused(casadi, tiller, out, inputs, results, *parts):
    names = ["x", "u", "p"][:len(inputs)]
    casadi.Function("f", inputs, [casadi.vertcat(*results)], names, ["xdot"]).save(str(out / "refused.casadi"))
    code, told = imported(tiller, out / "refused.casadi", out / "refused")
    assert code == 1 and not (out / "refused").exists(), told
    for part in parts:
        assert part in told, told


def with_casadi(casadi, tiller, folder, out):
    fun = function(casadi)
    fun.save(str(out / "function.casadi"))
    stored = json.loads((folder / "function.json").read_text(encoding="utf-8"))
    same_version = stored["casadi"] == casadi.__version__  # another one has the same equations in other instructions
    if same_version:
        assert same(json.loads(described(folder, out / "function.casadi")), stored), "not what is stored"
    compared = None if same_version else ("xdot", "y")  # where a slope is not finite is a matter of the version
    rows = [values(casadi, fun), json.loads((folder / "function_values.json").read_text(encoding="utf-8"))]
    ours, theirs = ([{k: row[k] for k in compared or row} for row in side] for side in rows)
    assert same(ours, theirs), "not the values that are stored"
    details = ["--details", str(folder / "function.details.toml")]
    for name in ("function.casadi", "function.json"):  # the function, and what is stored of it
        where = out if name.endswith("casadi") else folder
        code, told = imported(tiller, where / name, out / name.replace(".", "_"), *details)
        assert code == 0 and "parameters idle change nothing" in told, told
    texts = [(out / folder_name / "function.hpp").read_text(encoding="utf-8").replace(".json", ".casadi")
             for folder_name in ("function_casadi", "function_json")]
    assert not same_version or texts[0] == texts[1], "the stored list is another function"
    # MX, whose elements have no names; expanded here
    x, u, p = casadi.MX.sym("x", 2), casadi.MX.sym("u"), casadi.MX.sym("P", 2, 2)
    casadi.Function("f", [x, u, p], [p @ x + u], ["x", "u", "p"], ["ode"]).save(str(out / "mx.casadi"))
    code, told = imported(tiller, out / "mx.casadi", out / "mx")
    assert code == 1 and "parameters without a value: p_0, p_1, p_2, p_3; give them with --value" in told, told
    values_of_p = ["--value", "p_0=1,p_1=2,p_2=3,p_3=4", "--unknown", "p_1"]
    code, told = imported(tiller, out / "mx.casadi", out / "mx", *values_of_p)
    assert code == 0 and "states x_0, x_1 have no names of their own" in told, told
    code, told = imported(tiller, out / "mx/mx.json", out / "again")  # with the values that were given
    assert code == 0, told
    refused(casadi, tiller, out, [x, u], [x[1], casadi.erf(x[0]) * u], "xdot[1] needs operation 'erf'")
    table = casadi.interpolant("table", "bspline", [[0, 1, 2, 3, 4]], [0, 1, 4, 9, 16])
    refused(casadi, tiller, out, [x, u], [x[1], table(x[0]) + u], "'table' (BSplineInterpolant)")
    newton = casadi.rootfinder("newton", "newton", {"x": x, "p": u, "g": x * x - u})
    refused(casadi, tiller, out, [x, u], [newton(x0=x, p=u)["x"]], "'newton'")
    refused(casadi, tiller, out, [x, u], [x[1] * math.nan, u], "xdot[0] needs a constant NaN")
    (out / "cut.casadi").write_bytes((out / "mx.casadi").read_bytes()[:200])
    code, told = imported(tiller, out / "cut.casadi", out / "cut")
    assert code == 1 and "cut.casadi: CasADi" in told and "does not load it" in told, told
    example = folder.parents[1] / "examples/from_casadi"
    subprocess.run([sys.executable, str(example / "cart_pole.py")], cwd=out, check=True)
    details = ["--details", str(example / "cart_pole.details.toml")]
    code, told = imported(tiller, out / "cart_pole.casadi", out / "cart_pole", *details)
    assert code == 0 and "4 states, 1 inputs, 2 joints, 4 parameters, 2 outputs" in told, told
    print("with casadi", casadi.__version__)


def main():
    tiller, folder = sys.argv[1], pathlib.Path(sys.argv[2]).resolve()
    try:
        import casadi
    except ImportError:
        with tempfile.TemporaryDirectory() as out:
            saved = pathlib.Path(out) / "f.casadi"
            saved.write_text("jhpnnagiieahaaaadaaaaaaaaaaaaaaaaafaegaa", encoding="utf-8")
            code, told = imported(tiller, saved, pathlib.Path(out) / "f")
        assert code == 1 and f"{sys.executable} -m pip install casadi" in told, told
        sys.exit(77)
    if sys.argv[3:] == ["--write"]:
        write(casadi, folder)
    with tempfile.TemporaryDirectory() as out:
        with_casadi(casadi, tiller, folder, pathlib.Path(out))


if __name__ == "__main__":
    main()
