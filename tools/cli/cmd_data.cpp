#include "tools/base/output_file.hpp"
#include "tools/cli/demonstrations.hpp"
#include "tools/cli/infer_logs.hpp"
#include "tools/command/commands.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools {
namespace {

int write_infer_data(InferArguments& a) {
  std::string errors;
  const auto file = read_simulator_file(a.simulator, errors);
  if (file) return infer_logs(*file, a);
  std::fputs(errors.c_str(), stderr);
  return kExitBadInput;
}

void add_infer_data(CLI::App& data, int& exit_code) {
  auto* command = data.add_subcommand("infer", "names, priors, sensors' noise, and the logs cut to pieces");
  auto a = std::make_shared<InferArguments>();
  command->add_option("SIMULATOR", a->simulator, "simulator file (.toml): command, priors, sensors")->required();
  command->add_option("LOGS", a->logs, "CSV, ROS bags, ULog, as `tiller identify` takes them")->required();
  command->add_option("-o,--out", a->problem, "file to write")->required();
  command->add_option("--processes", a->processes, "simulators side by side (default: as the file says)")
      ->check(CLI::Range(1, 1024));
  command->footer("Example:\n  tiller data infer puck.toml run1.csv run2.csv -o problem.json");
  command->callback([a, &exit_code] { exit_code = write_infer_data(*a); });
}

struct ImitateData {
  std::string robot, out;
  Words logs;
  std::uint32_t least = 10;
};

int write_imitate_data(const ImitateData& a) {
  const auto robot = read_robot_or_complain(a.robot);
  if (!robot) return kExitBadInput;
  std::string json, error;
  if (!imitation_problem_json(*robot, a.logs, a.least, json, error)) return complain(error);
  if (replace_file(a.out, json, error)) return kExitOk;
  complain(error);
  return kExitLogIncomplete;
}

void add_imitate_data(CLI::App& data, int& exit_code) {
  auto* command = data.add_subcommand("imitate", "states and inputs along demonstrations, as the model explains them");
  auto a = std::make_shared<ImitateData>();
  command->add_option("ROBOT", a->robot, "robot file (.toml)")->required();
  command->add_option("LOGS", a->logs, "demonstrations: CSV, records, ROS bags, ULog, as `tiller identify` takes them")
      ->required();
  command->add_option("-o,--out", a->out, "file to write")->required();
  command->add_option("--least", a->least, "periods without a gap that a demonstration has (default 10)")
      ->check(CLI::Range(2, 100000));
  command->footer("Example:\n  tiller data imitate my_robot.toml demos/*.csv -o problem.json");
  command->callback([a, &exit_code] { exit_code = write_imitate_data(*a); });
}

}  // namespace

void add_data_command(CLI::App& app, int& exit_code) {
  auto* data = app.add_subcommand("data", "what a laboratory learns from, as JSON: files read and logs cut by tiller");
  data->require_subcommand(1);
  add_infer_data(*data, exit_code);
  add_imitate_data(*data, exit_code);
  data->footer("A laboratory asks for this by itself; a script of your own may ask for it too.");
}

}  // namespace tiller::tools
