"""What one more of something takes: a planner's setting, an engine, a transport, an effect, a CAN protocol, a log
format, a term of the cost.

    extend_test.py SOURCE WORK VENV [--count]

copies the tree to WORK, adds one of each, counts the files that each one touches and compares the counts with the table
of docs/project/extending.md. Then it builds the command with one model and one planner, and looks for all of them in
what it reads, writes and says. --count: without the build.
"""

import math
import pathlib
import shutil
import subprocess
import sys

# The files that each one touches, new and changed.
TOUCHED = {"setting of a planner": 2, "engine of the posterior": 3, "transport": 2, "effect": 2, "CAN protocol": 3,
           "log format": 2, "term of the cost": 2}
FOLDERS = ["cmake", "runtime", "sim", "tools", "harness", "bench", "robots"]
ENGINE = """#include "posterior/filter/filter_posterior.hpp"

namespace tiller {
namespace {
Posterior* lay_out_engine(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                          const RolloutTable& table, const tiller_hooks_t* hooks) {
  return FilterPosterior::lay_out(arena, config, setup, table, hooks);
}
}  // namespace
extern const PosteriorTable dummy_posterior;
const PosteriorTable dummy_posterior = {lay_out_engine};
}  // namespace tiller
"""
TRANSPORT = """#include "tools/links/transport_link.hpp"

namespace tiller::tools {
namespace {
constexpr tiller_transport_t kTable = {};

class Dummy final : public TransportLink {
 public:
  Dummy(const RobotFile& robot, const TransportLinkOptions& options) : TransportLink(robot, options, kTable, this) {}
  tiller_status_t open(OpenError& problem) override {
    std::snprintf(problem.text, sizeof problem.text, "the dummy is nobody's robot");
    return tiller_status_transport_closed;
  }
};
}  // namespace
std::unique_ptr<TransportLink> make_dummy_link(const RobotFile& robot, const TransportLinkOptions& options) {
  return std::make_unique<Dummy>(robot, options);
}
}  // namespace tiller::tools
"""

EFFECT = """#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {
template <class S>
struct Dummy {
  static constexpr Hook hook = Hook::force;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "dummy";
    i.param_count = 1;
    i.params[0] = {"push_SI", "N or N m", 0.0, __builtin_huge_val(), Scale::force, 1, {0.3}};
    i.help = "a push that nobody needs";
    i.equation = "f += push";
    return i;
  }();
  static S force(const JointStep<S>&, const S* p) { return p[0]; }
};
}  // namespace tiller
"""
COST_TERM = """#pragma once

#include "costs/cost_term_info.hpp"

namespace tiller {
struct Ceiling {
  static constexpr CostTermInfo info = [] {
    CostTermInfo i;
    i.name = "ceiling";
    i.help = "A state that nobody needs above a value.";
    i.equation = "max(0, state - highest)";
    i.weight_unit = "1/SI^2";
    i.penalty = true;
    i.state_count = 1;
    i.states[0] = {"state", "which state"};
    i.param_count = 1;
    i.params[0] = {"highest_SI", "SI", -9.0, 9.0, "the value", 0};
    return i;
  }();
  template <class S>
  static S residual(const S* x, const S* p) {
    return max(x[0] - p[0], S(0.0));
  }
};
}  // namespace tiller
"""
DRIVE = """#include "sim/devices/mit_axis.hpp"

namespace tiller::sim {
std::unique_ptr<DriveAxis> make_dummy_axis(const DriveOptions& options);
std::unique_ptr<DriveAxis> make_dummy_axis(const DriveOptions& options) { return std::make_unique<MitAxis>(options); }
}  // namespace tiller::sim
"""

LOG_FORMAT = """#include <fstream>

#include "tools/logs/log_readers.hpp"

namespace tiller::tools {
bool read_dummy_format(const std::string& path, const RobotFile& robot, const std::vector<int>& measured, Log& log,
                       std::string& error);
bool read_dummy_format(const std::string& path, const RobotFile& robot, const std::vector<int>& measured, Log& log,
                       std::string& error) {
  std::ifstream file(path);
  std::string first;
  std::getline(file, first);
  return read_csv_log(file, path, robot.log, *robot.config.model, measured, log, error);
}
}  // namespace tiller::tools
"""


def add_line(path, before, line):
    text = path.read_text()
    if before not in text:
        sys.exit(f"{path} has no '{before}'")
    path.write_text(text.replace(before, line + before, 1))


def add_setting(work):
    """Its field and its line, side by side in one folder."""
    api = work / "runtime/include/tiller"
    add_line(api / "tiller.h", "} tiller_planner_config_t;", "  uint32_t dummy_count; uint32_t dummy_reserved;\n")
    add_line(api / "config.def", "TILLER_STATES(cost, target",
             'TILLER_COUNT(planner, dummy_count, planner.dummy_count, 4, 2, 9, 1, "", "", "what nobody needs")\n')


def add_engine(work):
    """Its folder, and a line."""
    engine = work / "runtime/posterior/dummy"
    engine.mkdir()
    (engine / "dummy_posterior.cpp").write_text(ENGINE)
    (engine / "sources.cmake").write_text("set(sources dummy_posterior.cpp)\n")
    add_line(work / "runtime/include/tiller/posteriors.def", "#undef",
             'TILLER_POSTERIOR(dummy, "the filter by another name")\n')


def add_transport(work):
    """Its file in the folder of transports, and a line."""
    (work / "tools/links/transport_dummy.cpp").write_text(TRANSPORT)
    add_line(work / "tools/robot/transports.def", "#undef", 'TILLER_TRANSPORT(dummy, "nobody", "no robot at all")\n')


def add_effect(work):
    """Its header, and a line behind the last one."""
    (work / "runtime/effects/dummy.hpp").write_text(EFFECT)
    add_line(work / "runtime/include/tiller/effects.def", "// Append-only",
             'TILLER_EFFECT(dummy, Dummy, kLinear, "constant_offset")\n')


def add_protocol(work):
    """Its codec, its emulated drive, and a line: the MIT protocol by another name."""
    io = work / "runtime/io"
    codec = (io / "actuator_mit.cpp").read_text()
    (io / "actuator_dummy.cpp").write_text(codec.replace("mit_protocol", "dummy_protocol"))
    (work / "sim/devices/dummy_axis.cpp").write_text(DRIVE)
    add_line(io / "actuators.def", "#undef", 'TILLER_ACTUATOR(dummy, "a motor of nobody", 1, 9, "the MIT protocol")\n')


def add_log_format(work):
    """Its reader, and a line before CSV, which takes everything: a CSV behind one line of its own."""
    logs = work / "tools/logs"
    (logs / "dummy_format.cpp").write_text(LOG_FORMAT)
    add_line(logs / "log_formats.def", "TILLER_LOG_FORMAT(csv", 'TILLER_LOG_FORMAT(dummy, "DUMMY\\n")\n')


def add_cost_term(work):
    """Its header, and a line behind the last one."""
    (work / "runtime/costs/ceilings.hpp").write_text(COST_TERM)
    costs = work / "runtime/include/tiller/costs.def"
    costs.write_text(costs.read_text() + "TILLER_COST_TERM(ceilings, Ceiling)\n")


def files_of(work):
    return {path: path.read_bytes() for folder in FOLDERS for path in (work / folder).rglob("*") if path.is_file()}


def extend(work):
    """Adds one of each; the names of the files that each one touched."""
    touched, before = {}, files_of(work)
    for what, add in zip(TOUCHED, (add_setting, add_engine, add_transport, add_effect, add_protocol, add_log_format,
                               add_cost_term)):
        add(work)
        after = files_of(work)
        touched[what] = sorted(str(p.relative_to(work)) for p in after if after[p] != before.get(p))
        before = after
    return touched


def count(touched, page):
    """Whether each touched as many files as promised, here and on the page."""
    wrong = 0
    for what, files in touched.items():
        row = f"| {what} | {len(files)} |"
        told = row in page
        good = len(files) == TOUCHED[what] and told
        wrong += not good
        print(f"{'ok      ' if good else 'FAILED  '}{what}: {len(files)} files: {', '.join(files)}"
              + ("" if told else f"; docs/project/extending.md lacks '{row}'"))
    return wrong


def build(work, venv):
    options = ["-DTILLER_MODELS=pendulum", "-DTILLER_PLANNERS=cem", "-DTILLER_POSTERIORS=filter;dummy",
               "-DTILLER_BUILD_TESTS=OFF", "-DTILLER_BUILD_BENCHMARKS=OFF", "-DTILLER_ISA_ONLY=sse2",
               "-DTILLER_KERNEL_OPTIMISATION=-O1", "-DCMAKE_BUILD_TYPE=", "-DCMAKE_CXX_FLAGS=-O0",
               f"-DTILLER_VENV={venv}", "-G", "Ninja"]
    subprocess.run(["cmake", "-S", str(work), "-B", str(work / "build"), *options], check=True)
    subprocess.run(["cmake", "--build", str(work / "build"), "-j2", "--target", "tiller_command"], check=True)
    return next(p for p in (work / "build").rglob("tiller") if p.is_file() and p.stat().st_mode & 0o100)


def main():
    source, work, venv = (pathlib.Path(a) for a in sys.argv[1:4])
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    for folder in FOLDERS:
        shutil.copytree(source / folder, work / folder)
    for name in ["CMakeLists.txt", "LICENSE"]:
        shutil.copy(source / name, work / name)
    page = (source / "docs/project/extending.md").read_text()
    if count(extend(work), page):
        sys.exit(1)
    if "--count" in sys.argv:
        shutil.rmtree(work)
        return
    tiller = build(work, venv)

    # a plant that draws hides the file's effects, and nobody has written this one for it
    text = (source / "robots/pendulum.toml").read_text().replace("draw = true", "draw = false")
    robot = work / "robot.toml"

    def say(*arguments):
        done = subprocess.run([str(tiller), *arguments], capture_output=True, text=True, check=False, cwd=work)
        return done.returncode, done.stdout + done.stderr

    def with_settings(count, transport=""):
        head, _, tail = text.partition("[planner]\n")
        head += "[posterior]\nkind = \"dummy\"\n\n"
        robot.write_text(f"{head}[planner]\ndummy_count = {count}\n{tail}{transport}")

    def expect(what, condition, told):
        print(("ok      " if condition else "FAILED  ") + what)
        if not condition:
            print(told)
            sys.exit(1)

    _, manual = say("help", "robot-file")
    expect("the manual has the setting, its range and default", "dummy_count" in manual and "2 .. 9" in manual, manual)
    with_settings(7)
    code, told = say("run", str(robot), "--sim", "--seconds", "1")
    expect("a run with the setting and the engine", code == 0, told)
    code, told = say("export", str(robot), "-o", str(work / "config.c"))
    exported = (work / "config.c").read_text() if code == 0 else told
    expect("exported C has both", ".dummy_count = 7u" in exported and "tiller_posterior_dummy" in exported, exported)
    with_settings(10)
    code, told = say("run", str(robot), "--sim", "--seconds", "1")
    expect("its range is kept", code != 0 and "dummy_count" in told and "at most 9" in told, told)
    with_settings(7)
    code, told = say("run", str(robot), "--transport", "nobody", "--seconds", "1")
    expect("the transport is opened", code != 0 and "nobody's robot" in told, told)

    _, effects = say("effects")
    expect("the effect is in the catalogue", "a push that nobody needs" in effects, effects)
    robot.write_text(text + '\n[[effects]]\nkind = "dummy"\nport = "joint"\npush_SI = { uniform = [0.0, 0.1] }\n')
    code, told = say("run", str(robot), "--sim", "--seconds", "1")
    expect("a run learns the effect's parameter", code == 0 and "joint.push_SI" in told, told)
    code, told = say("export", str(robot), "-o", str(work / "config.c"))
    exported = (work / "config.c").read_text() if code == 0 else told
    expect("exported C has the effect", "tiller_effect_dummy" in exported, exported)

    robot.write_text(text)
    rows = ["DUMMY", "time_s,angle_rad,torque_Nm", *(f"{k / 50},{0.1 * math.sin(k / 8):.6f},0.0" for k in range(200))]
    (work / "swing.dummy").write_text("\n".join(rows) + "\n")
    code, told = say("identify", str(robot), str(work / "swing.dummy"))
    expect("a log of the format is fitted", code in (0, 2) and "damping_Nms" in told, told)
    code, told = say("replay", str(robot), str(work / "swing.dummy"), "--tolerance", "10")
    expect("and replayed", "200 " in told and "cannot be read" not in told, told)

    expect("the manual has the term of the cost", "[[cost.ceilings]]" in manual and "highest_SI" in manual, manual)
    ceiling = '\n[[cost.ceilings]]\nstate = "angle_rad"\nhighest_SI = %g\nweight = 1e4\n'
    robot.write_text(text + ceiling % 99)
    code, told = say("check", str(robot))
    expect("its range is kept", code != 0 and "highest_SI = 99" in told and "at most 9" in told, told)
    highest = []
    raised = text.replace("target = { angle_rad = 3.141592653589793 }", "target = { angle_rad = 0.4 }")
    for limit in ("", ceiling % 0.1):
        robot.write_text(raised + limit)
        code, told = say("run", str(robot), "--sim", "--seconds", "2", "--log", "limited.csv")
        expect("a run to 0.4 rad", code == 0, told)
        lines = (work / "limited.csv").read_text().splitlines()
        column = lines[0].split(",").index("angle_rad")
        highest.append(max(float(line.split(",")[column]) for line in lines[1:]))
    expect("a plan keeps below the ceiling", highest[1] < 0.2 < highest[0], highest)

    expect("the manual has the protocol", "dummy" in manual.split("actuator", 1)[1].splitlines()[0], manual)
    can = '\n[transport]\nkind = "socketcan"\ninterface = "nowhere0"\nactuator = "dummy"\nnodes = { torque_Nm = %d }\n'
    robot.write_text(text + can % 12)
    code, told = say("run", str(robot), "--transport", "can", "--seconds", "1")
    expect("the protocol's nodes are kept", code != 0 and "a motor of nobody has a node from 1 to 9" in told, told)
    robot.write_text(text + can % 3)
    code, told = say("run", str(robot), "--transport", "can", "--seconds", "1")
    # a kernel without CAN says so before it looks for the interface
    reached = "nowhere0" in told or "AF_CAN" in told
    expect("the protocol is opened", code != 0 and reached and "unknown" not in told, told)
    code, told = say("sim", str(robot), "--serve", "can", "--seconds", "1")
    reached = "nowhere0" in told or "AF_CAN" in told
    expect("the drive is emulated", code != 0 and reached and "no drive speaks" not in told, told)


if __name__ == "__main__":
    main()
