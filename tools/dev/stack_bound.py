"""stack_bound.py IMAGE DUMPS: how deep the stack of a Cortex-M image can get, from the image's own instructions.

Each function's instructions are followed along every branch, with what they take from the stack pointer; each call
adds what the called function needs. Unlike a measured depth this covers paths that no test takes. Calls through
pointers go to
  - virtual functions: the same slot of every table (vtable) in the image,
  - the rest: every function whose address is taken in the image and whose parameters have the types of the call.
Types are those of GCC's dumps (-fdump-tree-optimized, CMake option TILLER_CALL_GRAPH), which are looked for below
DUMPS.

Refuses what it cannot bound: recursion, a stack pointer that is computed, a call through a pointer in code without a
dump. Calls that no function in the image can answer (hooks, a model's own cost: the application's) are listed; what
stands behind them comes on top. Interrupts, too: 104 bytes for each level with floating-point registers.
"""
import argparse
import bisect
import collections
import pathlib
import re
import struct
import subprocess
import sys
import tempfile

LINE = re.compile(r"^ *([0-9a-f]+):\t(\S+)(?:\t([^@]*))?")
LABEL = re.compile(r"^([0-9a-f]+) <(.+)>:$")
TARGET = re.compile(r"\b([0-9a-f]+) <[^>]*>")
CONDITIONS = "eq|ne|cs|cc|mi|pl|vs|vc|hi|ls|ge|lt|gt|le|hs|lo"
BRANCH = re.compile(rf"^b(?:(?:{CONDITIONS})(?:\.[nw])?|\.[nw])?$")
CALL_BY_SSA = re.compile(r"(?:^\s+|= |\) )([\w.]*_\d+)(?:\(D\))? \(")
VIRTUAL = re.compile(r"OBJ_TYPE_REF\([^;]*;\([^)]*\)\w+(?:\.\w+)*(?:\(D\))?->(\d+)B\)")


def refuse(message):
    sys.exit(f"stack_bound.py: {message}")


def run(*command):
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


# How often a function stands on the stack at most where it calls itself. Each for its reason; a new one is refused.
BOUNDED = {
    "tiller::portable::erfc(double)": 2,  # of the negative argument, which is positive
    "tiller::(anonymous namespace)::cut_normal_quantile(double, double, double)": 2,  # of the mirrored interval
    "reset_handler": 1,  # calls the image's constructors, which have its type
}

# Files whose functions no call through a pointer of the first one reaches, though the types fit.
NEVER = {
    ("policy.cpp", "policy.cpp"),  # its fallback is another planner, or none
    ("hybrid.cpp", "policy.cpp"), ("hybrid.cpp", "hybrid.cpp"),  # goes through the table of mppi
}

# ---- the image -------------------------------------------------------------------------------------


class Function:
    def __init__(self, address, name):
        self.address, self.name = address, name
        self.code = {}  # address: (mnemonic, operands)
        self.frame = 0
        self.calls = collections.defaultdict(int)  # called address: bytes on the stack there
        self.pointer_calls = 0  # number of them
        self.pointer_depth = 0


def register_count(operands):
    count = 0
    for part in operands[operands.index("{") + 1:operands.index("}")].split(","):
        ends = [re.sub(r"^[rsd]", "", end.strip()) for end in part.split("-")]
        count += int(ends[1]) - int(ends[0]) + 1 if len(ends) == 2 else 1
    return count


def taken(mnemonic, operands):
    """Bytes that an instruction takes off the stack pointer; None where it does not leave a known one."""
    base = mnemonic.split(".")[0]
    if base in ("push", "vpush", "pop", "vpop"):
        bytes_each = 8 if re.search(r"\{d", operands) else 4
        return (1 if base.endswith("push") else -1) * bytes_each * register_count(operands)
    if re.match(r"v?(stmdb|ldmia)", base) and operands.startswith("sp!"):
        bytes_each = 8 if re.search(r"\{d", operands) else 4
        return (1 if "stm" in base else -1) * bytes_each * register_count(operands)
    moved = re.search(r"\[sp, #(-?\d+)\]!|\[sp\], #(-?\d+)", operands)
    if moved:
        return -int(moved[1] or moved[2])
    if re.match(r"(sub|add)w?$", base) and re.match(r"sp,", operands):
        step = re.match(r"sp, (?:sp, )?#(\d+)", operands)
        return (int(step[1]) if base.startswith("sub") else -int(step[1])) if step else None
    if re.match(r"sp(,|$|!)", operands) and not re.match(r"(str|vstr|cmp|tst|stm|vstm)", base):
        return None
    return 0


def read_functions(disassembly):
    functions, current = {}, None
    for line in disassembly.splitlines():
        label = LABEL.match(line)
        if label:
            current = functions.setdefault(int(label[1], 16), Function(int(label[1], 16), label[2]))
            continue
        instruction = LINE.match(line)
        if instruction and current and not instruction[2].startswith("."):
            current.code[int(instruction[1], 16)] = (instruction[2], (instruction[3] or "").strip())
    return {at: f for at, f in functions.items() if at in f.code}


def guarded(code, order, at):
    """True for an instruction within an IT block: it may be passed over."""
    index = bisect.bisect_left(order, at)
    for back in range(1, min(4, index) + 1):
        mnemonic = code[order[index - back]][0]
        if re.match(r"it[te]{0,3}$", mnemonic):
            return back < len(mnemonic)
    return False


def leaves(base, operands):
    """True for what does not go on with the next instruction."""
    if base in ("b", "bx", "tbb", "tbh", "udf"):
        return True
    return base in ("pop", "ldmia") and re.search(r"\bpc\b", operands) or base == "ldr" and operands.startswith("pc")


def follow(function, functions, code, order):
    """Along every branch: the deepest stack at each instruction, and at each call. Shared ends of functions of the
    compiler's library are followed into where they stand."""
    depth, waiting, tables = {}, [(function.address, 0)], []
    while waiting or tables:
        if not waiting:  # what only a table of branches leads to
            missed = [at for at in function.code if at not in depth]
            waiting = [(missed[0], max(tables))] if missed else []
            tables = tables if missed else []
            continue
        at, here = waiting.pop()
        if at != function.address and at in functions:  # goes on in another function, as its own last step
            function.calls[at] = max(function.calls[at], here)
            continue
        if depth.get(at, -1) >= here:
            continue
        if here > 1 << 20:
            refuse(f"{function.name}: the stack grows in a loop at {at:#x}")
        depth[at] = here
        mnemonic, operands = code[at]
        step = taken(mnemonic, operands)
        if step is None:
            refuse(f"{function.name}: {mnemonic} {operands} at {at:#x} computes the stack pointer")
        base = mnemonic.split(".")[0]
        target = TARGET.search(operands)
        to = int(target[1], 16) if target else None
        if base in ("tbb", "tbh"):
            tables.append(here)
        if base in ("bl", "blx") and target:
            function.calls[to] = max(function.calls[to], here)
        elif base in ("blx", "bx") and operands != "lr" or base == "ldr" and re.match(r"pc, (?!\[sp\])", operands):
            function.pointer_calls += 1
            function.pointer_depth = max(function.pointer_depth, here)
        elif target and (BRANCH.match(mnemonic) or base in ("cbz", "cbnz")):
            if to == function.address:
                function.calls[to] = max(function.calls[to], here)
            elif to in code:
                waiting.append((to, here))
            else:
                refuse(f"{function.name}: a branch at {at:#x} to where no instruction is")
        function.frame = max(function.frame, here + max(step, 0))
        passed_over = guarded(code, order, at)
        index = bisect.bisect_left(order, at) + 1
        if (not leaves(base, operands) or passed_over) and index < len(order) and order[index] - at <= 4:
            waiting.append((order[index], max(here + step, 0)))
            if passed_over and step < 0:
                waiting.append((order[index], here))


# ---- types of calls through pointers ---------------------------------------------------------------

WORDS = {"unsigned int": "int", "long unsigned int": "int", "long int": "int", "uint32_t": "int", "int32_t": "int",
         "size_t": "int", "std::size_t": "int", "unsigned char": "int", "bool": "int", "uint8_t": "int",
         "uint64_t": "wide", "int64_t": "wide", "long long int": "wide", "long long unsigned int": "wide"}


def kind_of(text):
    """A parameter's type, told apart where two that differ can never be the same type."""
    text = re.sub(r"\b(const|volatile|struct|union|enum|class|__restrict__)\b", "", text)
    text = re.sub(r"<T[0-9a-f]+>", "", text).strip()
    if "(*" in text or "(&" in text:
        return "pointer to a function"
    if "*" in text or "&" in text or "[" in text:
        pointee = re.sub(r"[*&\[\]\d]", "", text).strip().split("::")[-1]
        return "pointer to " + WORDS.get(pointee, pointee)
    return WORDS.get(text, text)


def split(parameters):
    depth, parts, now = 0, [], ""
    for char in parameters:
        depth += (char in "(<[{") - (char in ")>]}")
        if char == "," and depth == 0:
            parts.append(now)
            now = ""
        else:
            now += char
    parts = [part.strip() for part in parts + [now]]
    return [] if parts in ([""], ["void"]) else parts


def parameters_of(line, printed):
    """(types, names): what the function `printed` gives back and takes, and its parameters' names, by its first line in
    a dump."""
    close = len(line.rstrip()) - 1
    depth = 0
    for at in range(close, -1, -1):
        depth += (line[at] == ")") - (line[at] == "(")
        if depth == 0:
            break
    if not line[:at].rstrip().endswith(printed):
        refuse(f"a dump does not tell what {printed} gives back: {line}")
    types, names = [kind_of(re.sub(r"\b(static|virtual)\b", "", line[:at].rstrip().removesuffix(printed)))], []
    for part in split(line[at + 1:close]):
        name = re.search(r" ((?:D\.|ISRA\.)?\w+)$", part)
        types.append(kind_of(part[:name.start()] if name else part))
        names.append((name[1] if name else "", part))
    return tuple(types), names


def type_of_pointer(declaration):
    inner = re.match(r"(.*?)\(\*[^)]*\) ?\((.*)\)", declaration)
    return (kind_of(inner[1]), *(kind_of(part) for part in split(inner[2]))) if inner else None


class Dump:
    """Of one function: the parameters' types, the virtual slots and the types of pointers it calls."""

    def __init__(self):
        self.types, self.slots, self.pointers, self.unknown = set(), set(), set(), set()


def read_dump(text, source, dumps):
    for body in re.split(r"^;; Function ", text, flags=re.MULTILINE)[1:]:
        printed, name = re.match(r"(.*?) \((\S+), funcdef_no", body).groups()
        dump = dumps[name][source]
        start = body.index(")\n{\n") + 1
        head = body[:start].splitlines()
        first = max(i for i, line in enumerate(head) if f"{printed} (" in line)
        types, names = parameters_of(" ".join(head[first:]), printed)
        dump.types.add(types)
        declared = {key: part for key, part in names}
        for line in body[start:].splitlines():
            declaration = re.match(r"^  (.*\S) ([\w.]+);$", line)
            if declaration and "(*" in declaration[1]:
                declared[declaration[2]] = declaration[1]
            elif declaration:
                declared.setdefault(declaration[2], declaration[1])
            for slot in VIRTUAL.findall(line):
                dump.slots.add(int(slot))
            for variable in CALL_BY_SSA.findall(line):
                if variable.startswith("__atomic_"):  # instructions, or a direct call that the disassembly has
                    continue
                text_of = declared.get(variable) or declared.get(re.sub(r"_\d+$", "", variable))
                called = type_of_pointer(text_of) if text_of else None
                if called is None:
                    dump.unknown.add(f"{variable}: {text_of}")
                else:
                    dump.pointers.add(called)


# ---- the longest path ------------------------------------------------------------------------------


def sources_of_locals(symbols):
    """{address: source file} of functions that other files cannot see: two files may use one name."""
    source, sources = None, {}
    for line in symbols.splitlines():
        file = re.search(r" df \*ABS\*\s+\S+ ?(.*)$", line)
        if file:
            source = file[1]
        local = re.match(r"([0-9a-f]+) l .* F ", line)
        if local:
            sources[int(local[1], 16)] = source
    return sources


class Image:
    def __init__(self, path, folder, prefix, without):
        self.functions = read_functions(run(prefix + "objdump", "-d", "--no-show-raw-insn", str(path)))
        code = {at: each for function in self.functions.values() for at, each in function.code.items()}
        order = sorted(code)
        for function in self.functions.values():
            follow(function, self.functions, code, order)
        self.dumps = collections.defaultdict(lambda: collections.defaultdict(Dump))
        found = sorted(folder.rglob("*.optimized"))
        if not found:
            refuse(f"{folder}: no dumps (*.optimized); configure with -DTILLER_CALL_GRAPH=ON and build")
        for dump in found:
            source = re.match(r".*?\.(?:cpp|c)(?=\.)", dump.name)[0]
            read_dump(dump.read_text(encoding="utf-8"), source, self.dumps)
        self.sources = sources_of_locals(run(prefix + "objdump", "-t", str(path)))
        self.read_data(path, prefix)
        self.unresolved, self.open = [], collections.defaultdict(set)
        self.names = dict(zip(self.functions, demangled([f.name for f in self.functions.values()])))
        left_out = {at for at, name in self.names.items() if short(name) in without}
        if len({short(self.names[at]) for at in left_out}) < len(without):
            refuse(f"--without: not every one of {', '.join(sorted(without))} is in {path}")
        edges = {at: self.edges_of(function) for at, function in self.functions.items()}
        self.edges = {at: {to: calls[to] for to in calls if to not in left_out} for at, calls in edges.items()}

    def dumps_of(self, function):
        """Of a function that several files may have, all: they are the same but for what was made inline."""
        by_source = self.dumps.get(function.name, {})
        source = self.sources.get(function.address)
        return [by_source[source]] if source in by_source else list(by_source.values())

    def read_data(self, path, prefix):
        with tempfile.NamedTemporaryFile() as binary:
            run(prefix + "objcopy", "-O", "binary", str(path), binary.name)
            data = pathlib.Path(binary.name).read_bytes()
        self.words = struct.unpack(f"<{len(data) // 4}I", data[:len(data) // 4 * 4])
        taken_at = {word - 1 for word in self.words if word & 1} & set(self.functions)
        halves = {"movw": set(), "movt": {0}}
        for function in self.functions.values():
            for mnemonic, operands in function.code.values():
                immediate = re.search(r"#(\d+)$", operands)
                if mnemonic in halves and immediate:
                    halves[mnemonic].add(int(immediate[1]))
        taken_at |= {at for at in self.functions if (at | 1) & 0xffff in halves["movw"] and at >> 16 in halves["movt"]}
        self.tables = []
        for line in run(prefix + "nm", "-S", str(path)).splitlines():
            parts = line.split()
            if len(parts) == 4 and parts[3].startswith("_ZTV"):
                table = self.words[int(parts[0], 16) // 4:(int(parts[0], 16) + int(parts[1], 16)) // 4]
                self.tables.append([word - 1 for word in table])
        self.by_type = collections.defaultdict(set)
        self.untyped = set()
        for at in taken_at:
            types = {each for dump in self.dumps_of(self.functions[at]) for each in dump.types}
            for each in types:
                self.by_type[each].add(at)
            if not types:
                self.untyped.add(at)

    def edges_of(self, function):
        edges = dict(function.calls)
        if not function.pointer_calls:
            return edges
        dumps = self.dumps_of(function)
        slots = {slot for dump in dumps for slot in dump.slots}
        pointers = {called for dump in dumps for called in dump.pointers}
        unknown = {what for dump in dumps for what in dump.unknown}
        if unknown or not (slots or pointers):
            why = "; ".join(sorted(unknown)) or "its dump has no such call"
            self.unresolved.append((function, why if dumps else "no dump"))
        targets = set()
        for slot in slots:
            for table in self.tables:
                targets |= {table[2 + slot]} & set(self.functions) if 2 + slot < len(table) else set()
        for called in pointers:
            found = self.by_type.get(called, set())
            if not found:
                self.open[called].add(function.address)
            targets |= found
        source = self.sources.get(function.address)
        for target in (each for each in targets if (source, self.sources.get(each)) not in NEVER):
            edges[target] = max(edges.get(target, 0), function.pointer_depth)
        return edges

    def deepest(self, root, known, above=()):
        """(bytes, path) of the deepest stack below `root`; refuses recursion, by the names of its circle."""
        if root in above:
            circle = above[above.index(root):] + (root,)
            names = [f"{self.names[at]} ({self.sources.get(at) or 'any file'})" for at in circle]
            refuse("recursion: " + " -> ".join(names))
        if root not in known:
            function = self.functions[root]
            again = 0
            if root in self.edges[root] and self.names[root] in BOUNDED:
                again = (BOUNDED[self.names[root]] - 1) * self.edges[root][root]
            best = (again + function.frame, [(root, again + function.frame)])
            for target, depth in sorted(self.edges[root].items()):
                if target == root and self.names[root] in BOUNDED:
                    continue
                below = self.deepest(target, known, above + (root,))
                if again + depth + below[0] > best[0]:
                    best = (again + depth + below[0], [(root, again + depth)] + below[1])
            known[root] = best
        return known[root]


def demangled(names):
    done = subprocess.run(["c++filt"], input="\n".join(names), capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def short(name):
    """Without parameters, what is given back, and arguments of templates."""
    text = name.replace("(anonymous namespace)::", "").replace("tiller::", "")
    text = re.sub(r"operator(<<?|>>?|\(\))", "operator", text)
    cut, depth = "", 0
    for char in text:
        depth += char == "<"
        if char == "(" and depth == 0:
            break
        if depth == 0:
            cut += char
        depth -= char == ">"
    return cut.split(" ")[-1] or name


def bound_of(image, name, known):
    root = next((at for at, each in image.names.items() if short(each) == name), None)
    return image.deepest(root, known) if root is not None else (0, [])


def print_bounds(image, known, paths):
    print("\n  deepest stack, by calls                bytes")
    for name in sorted(short(each) for each in image.names.values() if re.match(r"tiller_\w+$", each)):
        print(f"    {name:32} {bound_of(image, name, known)[0]:9}")
    for name in paths:
        print(f"\n  {name}\n    bytes from here, of them its own")
        left, path = bound_of(image, name, known)
        for at, own in path:
            print(f"    {left:9} {own:9}  {short(image.names[at])}")
            left -= own


def print_pointers(image):
    if image.open:
        print("\n  calls of types that no function of this image has; what the application gives comes on top")
    for called, callers in sorted(image.open.items()):
        print(f"    {called[0]} ({', '.join(called[1:])}): from "
              f"{', '.join(sorted({short(image.names[at]) for at in callers}))}")
    if image.untyped:
        print("\n  whose address is taken and whose type no dump has: not counted as called through pointers")
    for at in sorted(image.untyped):
        print(f"    {short(image.names[at])}")
    if image.unresolved:
        print("\n  calls through pointers that are not resolved: no bound")
    for function, why in image.unresolved:
        print(f"    {short(image.names[function.address])}: {why}")


def compare(image, known, command):
    """The image's own painted stack, as it tells it ("# stack_bytes_used 123"), is no deeper than the bound."""
    # by semihosting, on the standard error; whether the loop was a good one, other tests ask
    output = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                            stdin=subprocess.DEVNULL, check=False).stdout
    told = dict(re.findall(r"^# (\w*stack_bytes\w*) (\d+)$", output, re.MULTILINE))
    print("\n  painted in a run, and by calls         bytes")
    good = len(told) == 3
    for row, name in (("stack_bytes_used", "reset_handler"), ("tick_stack_bytes_used", "tiller_tick")):
        painted, bound = int(told.get(row, 0)), bound_of(image, name, known)[0]
        good = good and 0 < painted <= bound
        print(f"    {name:32} {painted:9} {bound:9}")
    fits = bound_of(image, "reset_handler", known)[0] <= int(told.get("stack_bytes", 0))
    print(f"    {'the stack there is':32} {told.get('stack_bytes', 'untold'):>9}"
          f"{'' if fits else '  less than the bound'}")
    return good and fits


def current(image, known, path):
    """The rows TILLER_STACK_BOUND(model, call, bytes) of the file hold what this image needs, with a tenth to spare at
    most."""
    rows = re.findall(r"^TILLER_STACK_BOUND\((\w+), (\w+), (\d+)\)", path.read_text(encoding="utf-8"), re.MULTILINE)
    wrong = [row for row in rows if not 0.9 * int(row[2]) <= bound_of(image, row[1], known)[0] <= int(row[2])]
    for _, call, bytes_ in wrong:
        print(f"{path}: {call} has {bytes_} bytes, the image needs {bound_of(image, call, known)[0]}")
    return bool(rows) and not wrong


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("image", type=pathlib.Path)
    parser.add_argument("dumps", type=pathlib.Path, help="build folder of the image")
    parser.add_argument("--prefix", default="arm-none-eabi-", help="of objdump, objcopy and nm")
    parser.add_argument("--path", action="append", metavar="FUNCTION",
                        help="show its deepest path (tiller_init, tiller_tick)")
    parser.add_argument("--without", action="append", default=[], metavar="FUNCTION",
                        help="one that the image's configurations never call, e.g. lqr_cost_to_go")
    parser.add_argument("--rows", type=pathlib.Path, metavar="FILE", 
                        help="fails where its rows do not hold these bounds")
    parser.add_argument("--run", nargs=argparse.REMAINDER, metavar="COMMAND",
                        help="runs the image, which tells its painted stack: fails where that is deeper than the "
                        "bound, or the bound than the stack")
    arguments = parser.parse_args()
    image = Image(arguments.image, arguments.dumps, arguments.prefix, set(arguments.without))
    known = {}
    print(f"{arguments.image}: {len(image.functions)} functions, "
          f"{sum(f.pointer_calls for f in image.functions.values())} calls through pointers")
    print_bounds(image, known, arguments.path or ["tiller_init", "tiller_tick"])
    print_pointers(image)
    good = not arguments.run or compare(image, known, arguments.run)
    good = (not arguments.rows or current(image, known, arguments.rows)) and good
    return 0 if good and not image.unresolved else 1


if __name__ == "__main__":
    sys.setrecursionlimit(10000)
    sys.exit(main())
