// What learns on the host is Python on JAX (python/tiller/labs): each of these commands becomes it.
#include "tools/cli/laboratories.hpp"

#include "tools/base/report.hpp"
#include "tools/command/commands.hpp"

namespace tiller::tools {
namespace {

struct Laboratory {
  const char* name;
  const char* what;
};

/// LABORATORIES of python/tiller/labs/__main__.py are the same.
constexpr Laboratory kLaboratories[] = {
    {"infer", "learn the parameters of a simulator of your own from logs of the robot"},
    {"imitate", "learn the weights of the cost, or a policy, from demonstrations"},
    {"policy", "search a feedback policy in few trials on the simulated plant"},
    {"distill", "teach a small network what a planner does, for small targets"},
    {"learn", "learn forces that no known effect explains, on top of the physics"},
    {"tune", "search settings of planner, cost and priors on the simulated plant"},
};

}  // namespace

int become_laboratory(const Words& words) {
  std::string error;
  become_python_tool("laboratory", words, error);
  return complain(error + "; install Python 3, or set TILLER_PYTHON");
}

void add_laboratory_commands(CLI::App& app, int& exit_code) {
  for (const Laboratory& laboratory : kLaboratories) {
    auto* command = app.add_subcommand(laboratory.name, laboratory.what);
    command->prefix_command();
    command->set_help_flag();  // the laboratory's own
    command->callback([command, &laboratory, &exit_code] {
      Words words = {laboratory.name};
      for (const std::string& word : command->remaining()) words.push_back(word);
      exit_code = become_laboratory(words);
    });
  }
}

}  // namespace tiller::tools
