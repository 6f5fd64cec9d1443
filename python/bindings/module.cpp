// tiller._core: the runtime and the tools as a Python module. The package around it is python/tiller.
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "robot.hpp"
#include "tiller/tiller.h"

int tiller_main(int argc, char** argv);  // tools/cli/main.cpp

namespace tiller::python {
namespace {

using namespace nb::literals;

/// The `tiller` command in this process. Signals are the command's own until it ends.
int run_command(const std::vector<std::string>& arguments) {
  std::vector<std::string> words = arguments;
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  const nb::gil_scoped_release others;
  return tiller_main(static_cast<int>(words.size()), argv.data());
}

void bind_names(nb::module_& m) {
  nb::enum_<tiller_status_t>(m, "Status", nb::is_arithmetic(), "Why a command is what it is; 0 is ok.")
#define TILLER_STATUS(code, name, band, text) .value(#name, tiller_status_##name, text)
#include "tiller/status.def"
#undef TILLER_STATUS
      ;
  nb::enum_<tiller_state_t>(m, "State", nb::is_arithmetic(), "Of a controller.")
      .value("INIT", tiller_state_init, "no measurement yet: safe command")
      .value("STANDBY", tiller_state_standby, "measuring, not learning; waits for arm()")
      .value("ACTIVE", tiller_state_active, "planning")
      .value("HOLD", tiller_state_hold, "planner unusable, sensors fresh: HOLD feedback")
      .value("SAFE", tiller_state_safe, "latched safe command until reset()");
  nb::enum_<tiller_adequacy_t>(m, "Adequacy", nb::is_arithmetic(), "Whether the model can explain what is measured.")
      .value("UNTESTED", tiller_adequacy_untested)
      .value("ADEQUATE", tiller_adequacy_adequate)
      .value("INADEQUATE", tiller_adequacy_inadequate);
  m.def(
      "instruction_set", [] { return std::string(tiller_instruction_set()); },
      "Name of the instruction set that this process runs.");
  m.def("version", [] { return std::string(tiller_version()); });
  m.def(
      "model_names", [] { return std::string(tiller_model_names()); }, "Names of the built-in models.");
}

}  // namespace

NB_MODULE(_core, m) {
  nb::set_leak_warnings(false);  // views that outlive the interpreter's last look are no leak of ours
  bind_names(m);
  bind_robot(m);
  bind_controller(m);
  bind_plant(m);
  bind_rollout(m);
  bind_training(m);
#ifdef TILLER_XLA_FFI
  bind_jax(m);
#endif
  m.def("run_command", &run_command, "arguments"_a, "The tiller command; arguments[0] is its name.");
}

}  // namespace tiller::python
