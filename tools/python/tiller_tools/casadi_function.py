"""A CasADi function as a plain list of its instructions, as JSON that `tiller import` reads.

    python -m tiller_tools.casadi_function FUNCTION OUT

FUNCTION is what casadi.Function.save has written. OUT holds names and shapes of its inputs and outputs, its scalar
instructions in CasADi's own words, and its values at random points, against which the import checks itself; or
{"error": ...} where there is no such list. Nothing of the equations is changed here.
"""

import json
import math
import pathlib
import random
import re
import sys

SAMPLES, SEED = 12, 18
RANGES = {"p": (0.5, 2.0)}  # parameters are mostly positive
OTHERWISE = (-2.0, 2.0)


class Refused(Exception):
    pass


def refuse_calls(casadi, function):
    """What cannot be expanded is mostly a call."""
    nodes = [function.instruction_MX(k) for k in range(function.n_instructions())
             if function.instruction_id(k) == casadi.OP_CALL]
    called = sorted({f"'{n.which_function().name()}' ({n.which_function().class_name()})" for n in nodes})
    if called:
        raise Refused(f"the function calls {', '.join(called)}, whose equations are not scalar instructions; write the "
                      "equations themselves")


def scalar(casadi, function):
    """The function in scalar instructions."""
    if function.has_free():
        raise Refused(f"free variables {', '.join(map(str, function.get_free()))}: make them elements of p")
    if function.is_a("SXFunction"):
        return function
    try:
        return function.expand()
    except Exception as why:  # what has no scalar form; CasADi has one class for all
        if function.is_a("MXFunction"):
            refuse_calls(casadi, function)
        reason = " ".join(str(why).split())
        raise Refused(f"CasADi cannot expand it into scalar instructions: {reason[:300]}") from why


def number(value):
    """JSON has no NaN and no infinity."""
    return value if math.isfinite(value) else str(value)


def port(name, sparsity, elements=None):
    rows, columns = list(sparsity.row()), list(sparsity.get_col())
    out = {"name": name, "shape": list(sparsity.shape), "rows": rows, "columns": columns}
    return dict(out, elements=elements) if elements is not None else out


def instructions(casadi, function):
    """[operation, result, operands ...]; of an input the operands are [input, element], of an output the result is."""
    names = {getattr(casadi, name): name[3:].lower() for name in dir(casadi) if name.startswith("OP_")}
    nodes = function.instructions_sx().nonzeros() if hasattr(function, "instructions_sx") else None
    for k in range(function.n_instructions()):
        kind, given, out = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
        if kind == casadi.OP_CONST:
            yield ["const", out[0], number(function.instruction_constant(k))]
        elif kind == casadi.OP_CALL:  # refused by the reader, which knows the outputs that need it
            inner = nodes[k].which_function() if nodes else None
            what = f"call of '{inner.name()}' ({inner.class_name()})" if inner else "call"
            for result in out:
                if result >= 0:
                    yield [what, result, *given]
        else:
            yield [names.get(kind, f"operation {kind}"), *out, *given]


def samples(casadi, function):
    """Values at random points, over the elements that are not structurally zero."""
    rng = random.Random(SEED)
    for _ in range(SAMPLES):
        given = []
        for i in range(function.n_in()):
            low, high = RANGES.get(function.name_in(i), OTHERWISE)
            given.append([round(rng.uniform(low, high), 4) for _ in range(function.nnz_in(i))])
        found = function.call([casadi.DM(function.sparsity_in(i), v) for i, v in enumerate(given)])
        yield {"in": given, "out": [[number(float(v)) for v in casadi.DM(d).nonzeros()] for d in found]}


def describe(casadi, path):
    function = casadi.Function.load(str(path))
    plain = scalar(casadi, function)
    ports = [port(plain.name_in(i), plain.sparsity_in(i), [e.name() for e in plain.sx_in(i).nonzeros()])
             for i in range(plain.n_in())]
    rows = list(instructions(casadi, plain))
    calls = any(row[0].startswith("call") for row in rows)
    return {"casadi": casadi.__version__, "name": path.stem, "function": function.name(), "inputs": ports,
            "outputs": [port(plain.name_out(i), plain.sparsity_out(i)) for i in range(plain.n_out())],
            "instructions": rows,
            "samples": [] if calls else list(samples(casadi, plain))}


def text(result):
    """One instruction a line."""
    rows = []
    for key, value in result.items():
        nested = isinstance(value, list) and value and isinstance(value[0], (list, dict))
        lines = ",\n".join("  " + json.dumps(v) for v in value) if nested else ""
        rows.append(f" {json.dumps(key)}: " + (f"[\n{lines}\n ]" if nested else json.dumps(value)))
    return "{\n" + ",\n".join(rows) + "\n}\n"


def main():
    path, out = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    try:
        import casadi
    except ImportError:
        result = {"error": f"CasADi itself reads this format, and {sys.executable} has no package casadi; install it "
                           f"once: {sys.executable} -m pip install casadi (or set TILLER_PYTHON to an interpreter that "
                           "has it)"}
    else:
        try:
            result = describe(casadi, path)
        except Refused as why:
            result = {"error": str(why)}
        except Exception as why:  # a damaged file, or one of a later version
            result = {"error": f"CasADi {casadi.__version__} does not load it ("
                               + re.sub(r"\S+\.[ch]pp:\d+: ", "", " ".join(str(why).split()))[:200] +
                               "); save it by this version, or as function.expand().save(FILE)"}
    out.write_text(text(result), encoding="utf-8")


if __name__ == "__main__":
    main()
