#!/usr/bin/env python3
"""z3 for Why3 (./dev prove): tries with fewer hypotheses first, because what follows from fewer follows from all.

Why3 hands over every goal with axioms that tie doubles to real numbers and with those of the memory model. Beside them
z3 finds nothing; without them it decides most goals in a second. In this order, until one is unsatisfiable:

    alone     the goal and its predicates as macros: no quantifier is left, z3 decides by the bits of the doubles
    folded    the memory's axioms; a double is a thing of which only the laws below are known, and what a rate allows
              is a name
    unfolded  the same with the definitions of these names
    doubles   all axioms but those about real numbers
    whole     the goal as it came

A hypothesis is left out, or an operation is made an unknown function: neither makes a goal provable that is not.
Whoever adds one must state it in LAWS; ./dev prove has z3 decide each of them by the bits. Arguments are z3's own.
"""

import os
import re
import subprocess
import sys

Z3 = os.environ.get("TILLER_Z3", "z3")

# (names, hypothesis, conclusion), of doubles whatever they are
LAWS = [("a b", "(leq a b)", "(and (leq a a) (leq b b))"),
        ("a b c", "(and (leq a b) (leq b c))", "(leq a c)"),
        ("a", "(leq a a)", "(eq a a)")]

REALS = re.compile(r"\bReal\b|fp\.to_real|to_f(32|64)|Float32|\(sort ")
# What a statement about arrays needs: the memory, the ranges of integers and the predicates of the contracts.
MEMORY = re.compile(r"(base|offset|shift|included|separated|valid_rw|valid_rd|is_uint32_chunk|null|global)'def$|"
                    r"(addr_inversion|havoc_access|valid_rw_rd|separated_\w+|included_trans|Bridge[LR])$|"
                    r"is_[us]int(8|32|64)_def$|is_to_\w+$|id_[us]int(8|32|64)$|is_bool|Goal|[PLQA]_")
FOLDED = re.compile(r"P_(allows|near|product|admits)'def|addr_inversion")
LITERAL = re.compile(r"\(fp #b([01]+) #b([01]+) #b([01]+)\)")
OPERATIONS = {"add": 2, "sub": 2, "mul": 2, "div": 2, "neg": 1}
RELATIONS = {"leq": 2, "lt": 2, "eq": 2}


def forms_of(text):
    """(name, form) of every form at the top; the name stands in the comment before it."""
    name, depth, start, i = "", 0, 0, 0
    while i < len(text):
        c = text[i]
        if c == ";":
            end = (text + "\n").index("\n", i)
            if depth == 0:
                name = text[i:end].strip("; ")
            i = end
        elif c in '|"':
            i = text.index(c, i + 1)
        elif c == "(":
            start = i if depth == 0 else start
            depth += 1
        elif c == ")":
            depth -= 1
            if depth == 0:
                yield name, text[start:i + 1]
        i += 1


def parse(text):
    """A form as nested lists of words."""
    stack = [[]]
    for token in re.findall(r'\(|\)|"[^"]*"|\|[^|]*\||[^\s()]+', text):
        if token == "(":
            stack.append([])
        elif token == ")":
            done = stack.pop()
            stack[-1].append(done)
        else:
            stack[-1].append(token)
    return stack[0][0]


def show(tree):
    return tree if isinstance(tree, str) else "(" + " ".join(map(show, tree)) + ")"


def macro(form, sorts):
    """(assert (forall (xs) (= (F xs) value))) as (define-fun F (xs) sort value); None where it is not of that form."""
    body, xs, lets = parse(form)[1], [], []
    if body[0] == "forall":
        xs, body = body[1], body[2]
    while body[0] == "let":
        lets.insert(0, body[1])
        body = body[2]
    if body[0] != "=" or not isinstance(body[1], list):
        return None
    name, value = body[1][0], body[2]
    if body[1][1:] != [x[0] for x in xs] or name not in sorts:
        return None
    for bound in lets:
        value = ["let", bound, value]
    return name, show(["define-fun", name, xs, sorts[name], value])


def alone(forms):
    declared = {parse(form)[1]: form for _, form in forms if form.startswith("(declare-fun")}
    sorts = {name: show(parse(form)[3]) for name, form in declared.items()}
    lines, defined = [], set()
    for name, form in forms:
        if form.startswith("(define-fun fp."):
            lines.append(form)
        elif re.match(r"[PL]_.*'def$", name) and form.startswith("(assert") and "to_real" not in form:
            made = macro(form, sorts)
            if made:
                defined.add(made[0])
                lines.append(made[1])
        elif form.startswith("(assert") and name.startswith("Goal"):
            body = parse(form)[1][1]
            while body[0] == "forall":
                lines += [f"(declare-fun {x[0]} () {show(x[1])})" for x in body[1]]
                body = body[2]
            used = set(re.findall(r"\b[LP]_\w+", show(body)))
            lines += [declared[name] for name in sorted(used - defined) if name in declared]
            lines.append(show(["assert", ["not", body]]))
    return lines + ["(check-sat)"]


def without_reals(forms):
    return [form for name, form in forms
            if name.startswith("Goal") or not (form.startswith("(assert") and REALS.search(form))]


def word(literal):
    return "double" + "_".join(literal.groups())


def opaque(forms, folded):
    """Doubles as things without properties, but for the laws."""
    lines = ["(declare-sort Double 0)"]
    for names, sort in ((OPERATIONS, "Double"), (RELATIONS, "Bool")):
        lines += [f"(declare-fun d.{name} ({' '.join(['Double'] * arity)}) {sort})" for name, arity in names.items()]
    for names, given, follows in LAWS:
        law = re.sub(r"\((leq|eq) ", r"(d.\1 ", f"(=> {given} {follows})")
        lines.append(f"(assert (forall ({' '.join(f'({n} Double)' for n in names.split())}) {law}))")
    kept = [(name, form) for name, form in forms if not form.startswith("(assert") or
            (MEMORY.match(name) and not (folded and FOLDED.match(name)))]
    literals = set()
    for form in without_reals(kept):
        form = re.sub(r"\s+", " ", form)
        if form.startswith("(define-fun fp.") or "Float32" in form:
            continue
        found = {word(literal) for literal in LITERAL.finditer(form)}
        lines += [f"(declare-fun {name} () Double)" for name in sorted(found - literals)]
        literals |= found
        form = LITERAL.sub(word, form).replace("Float64", "Double")
        form = re.sub(r"\(fp\.(add|sub|mul|div) RNE ", r"(d.\1 ", form)
        form = re.sub(r"\bfp\.(leq|lt|eq|neg)\b", r"d.\1", form)
        if "fp." not in form and "to_f64" not in form:
            lines.append(form)
    return lines


def run(arguments, path, seconds, lines=None):
    part = path
    if lines is not None:
        part = path + ".part.smt2"
        with open(part, "w", encoding="utf-8") as out:
            out.write("\n".join(lines) + "\n")
    here = [f"-T:{max(1, int(seconds))}" if a.startswith("-T:") else part if a == path else a for a in arguments]
    done = subprocess.run([Z3, *here], capture_output=True, text=True, check=False)
    if lines is not None:
        os.unlink(part)
    return done.stdout


def laws_hold():
    """Has z3 decide every law by the bits of the doubles."""
    for names, given, follows in LAWS:
        law = re.sub(r"\((leq|eq) ", r"(fp.\1 ", f"(not (=> {given} {follows}))")
        text = "\n".join([f"(declare-fun {n} () Float64)" for n in names.split()] + [f"(assert {law})", "(check-sat)"])
        done = subprocess.run([Z3, "-in", "-T:60"], input=text, capture_output=True, text=True, check=False)
        if done.stdout.strip() != "unsat":
            return False
    return True


def main(arguments):
    path = next((a for a in arguments if a.endswith(".smt2")), None)
    if path is None:
        os.execvp(Z3, [Z3, *arguments])
    limit = next((int(a[3:]) for a in arguments if a.startswith("-T:")), 10)
    with open(path, encoding="utf-8") as source:
        forms = list(forms_of(source.read()))
    answer = ""
    for share, make in ((0.3, alone), (0.2, lambda f: opaque(f, True)), (0.2, lambda f: opaque(f, False)),
                        (0.15, without_reals)):
        answer = run(arguments, path, limit * share, make(forms))
        if answer.startswith("unsat"):
            break
    else:
        answer = run(arguments, path, limit * 0.15)
    sys.stdout.write(answer)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
