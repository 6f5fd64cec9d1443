#include <cstdio>

#include "tools/cli/infer_logs.hpp"
#include "tools/command/commands.hpp"
#include "tools/likelihood_free/summary.hpp"

namespace tiller::tools {
namespace {

int infer_command(InferArguments& a) {
  std::string errors;
  const auto file = read_simulator_file(a.simulator, errors);
  if (file) return infer_logs(*file, a);
  std::fputs(errors.c_str(), stderr);
  return kExitBadInput;
}

std::string methods_help() {
  std::string text = "Methods (docs/theory/likelihood_free.md):\n";
  for (const InferenceMethod& method : inference_methods())
    text += format("  %-15s %s\n  %-15s [%s]\n", method.name, method.help, "", method.citation);
  return text;
}

Words method_names_of_inference() {
  Words names;
  for (const InferenceMethod& method : inference_methods()) names.emplace_back(method.name);
  return names;
}

}  // namespace

void add_infer_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("infer", "learn the parameters of a simulator of your own from logs of the robot");
  auto a = std::make_shared<InferArguments>();
  InferenceOptions& o = a->options;
  command->add_option("SIMULATOR", a->simulator, "simulator file (.toml): command, priors, sensors")->required();
  command->add_option("LOGS", a->logs, "to learn from: CSV, ROS bags, ULog, as `tiller identify` takes them")
      ->required();
  command->add_option("-o,--out", a->folder, "folder for infer.json, infer.html and posterior.json");
  command->add_option("--method", o.method, "how to learn (default bayes_sim)")
      ->check(CLI::IsMember(method_names_of_inference()));
  command
      ->add_option("--summary", o.summary,
                   "what simulations and logs are compared by: linear (default), cross_correlation (by hand, as "
                   "BayesSim), recurrent (learnt; bayes_sim alone)")
      ->check(CLI::IsMember(summary_names()));
  command->add_option("--simulations", o.simulations, "parameter vectors in all (default 5000)")
      ->check(CLI::Range(50, 10000000));
  command->add_option("--rounds", o.rounds, "of bayes_sim (default 5)")->check(CLI::Range(1, 100));
  command->add_option("--components", o.components, "of bayes_sim's mixture (default 3)")->check(CLI::Range(1, 16));
  command->add_option("--particles", o.particles, "of smc_abc (default 200)")->check(CLI::Range(50, 100000));
  command->add_option("--accept", o.accept, "share that abc and abc_regression keep (default 0.01)")
      ->check(number_between(1e-6, 1));
  command->add_option("--processes", a->processes, "simulators side by side (default: as the file says)")
      ->check(CLI::Range(1, 1024));
  command->add_option("--problem", a->problem,
                      "only write what would be learnt from into this file: python -m tiller.labs infer reads it");
  command->footer(
      methods_help() +
      "\nThe simulator is any program that answers lines on stdin with lines on stdout: docs/guide/simulator.md has\n"
      "one of fifteen lines. No likelihood and no derivative of it is needed.\n\n"
      "Examples:\n"
      "  tiller infer puck.toml run1.csv run2.csv -o out/puck\n"
      "      the posterior of what puck.toml has a prior for, with a page and posterior.json for a run\n"
      "  tiller infer puck.toml run1.csv --method smc_abc --simulations 20000 --processes 8\n"
      "      the same by another way, as a check");
  command->callback([a, &exit_code] { exit_code = infer_command(*a); });
}

}  // namespace tiller::tools
