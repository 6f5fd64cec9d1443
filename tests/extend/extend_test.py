"""What it takes to add a setting, an engine and a transport: one folder and one line of a table each.

    extend_test.py SOURCE WORK VENV

copies the tree to WORK, adds a planner's setting `dummy_count`, an engine `dummy` and a transport `dummy`, builds the
command with one model and one planner, and looks for the three in what it reads, writes and says.
"""

import pathlib
import shutil
import subprocess
import sys

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
TRANSPORT = """#include "tools/links/transport.hpp"

namespace tiller::tools {
namespace {
class Dummy final : public HostTransport {
 public:
  tiller_status_t open(const RobotFile&, const TransportLinkOptions&, OpenError& problem) override {
    std::snprintf(problem.text, sizeof problem.text, "the dummy is nobody's robot");
    return tiller_status_transport_closed;
  }
  const tiller_transport_t& table() const override { return table_; }
  void* self() override { return this; }

 private:
  tiller_transport_t table_ = {};
};
}  // namespace
std::unique_ptr<HostTransport> make_dummy_transport();
std::unique_ptr<HostTransport> make_dummy_transport() { return std::make_unique<Dummy>(); }
}  // namespace tiller::tools
"""


def add_line(path, before, line):
    text = path.read_text()
    if before not in text:
        sys.exit(f"{path} has no '{before}'")
    path.write_text(text.replace(before, line + before, 1))


def extend(work):
    api = work / "runtime/include/tiller"
    # a setting: its field and its line, side by side in one folder
    add_line(api / "tiller.h", "} tiller_planner_config_t;", "  uint32_t dummy_count; uint32_t dummy_reserved;\n")
    add_line(api / "config.def", "TILLER_STATES(cost, target",
             'TILLER_COUNT(planner, dummy_count, planner.dummy_count, 4, 2, 9, 1, "", "", "what nobody needs")\n')
    # an engine: its folder, and a line
    engine = work / "runtime/posterior/dummy"
    engine.mkdir()
    (engine / "dummy_posterior.cpp").write_text(ENGINE)
    (engine / "sources.cmake").write_text("set(sources dummy_posterior.cpp)\n")
    add_line(api / "posteriors.def", "#undef", 'TILLER_POSTERIOR(dummy, "the filter by another name")\n')
    # a transport: its file in the folder of transports, and a line
    (work / "tools/links/transport_dummy.cpp").write_text(TRANSPORT)
    add_line(work / "tools/robot/transports.def", "#undef", 'TILLER_TRANSPORT(dummy, "nobody", "no robot at all")\n')


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
    extend(work)
    tiller = build(work, venv)

    text = (source / "robots/pendulum.toml").read_text()
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


if __name__ == "__main__":
    main()
