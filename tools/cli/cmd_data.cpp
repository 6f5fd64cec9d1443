#include <cstdio>

#include "tools/base/output_file.hpp"
#include "tools/cli/demonstrations.hpp"
#include "tools/cli/learn_data.hpp"
#include "tools/command/commands.hpp"
#include "tools/logs/log_formats.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/simulator/inference_data.hpp"

namespace tiller::tools {
namespace {

/// What `tiller data infer` is asked for.
struct InferArguments {
  Words files;             ///< the simulator file, where no command is given, and the logs
  std::string command;     ///< of a simulator without a file
  std::string robot;       ///< what that is asked for
  std::string out;         ///< file to write
  unsigned processes = 0;  ///< 0: as the file says
};

/// Every log on the simulator's grid; false after a complaint about each that cannot be read.
bool read_grids(const SimulatorFile& file, const Words& paths, std::vector<Grid>& grids) {
  bool good = true;
  for (const std::string& path : paths) {
    Log log;
    std::string error;
    if (!read_any_log(path, file.robot, log, error)) {
      complain(error);
      good = false;
      continue;
    }
    for (Grid& grid : make_grids(log, log.map, file.robot.config)) grids.push_back(std::move(grid));
  }
  return good;
}

/// Takes the simulator file from in front of the logs. Null after a complaint.
std::unique_ptr<SimulatorFile> take_simulator(InferArguments& a) {
  std::string errors;
  std::unique_ptr<SimulatorFile> file;
  if (!a.command.empty()) {
    file = simulator_of_command(a.command, a.robot, errors);
  } else if (a.files.size() < 2) {
    complain("a simulator file and at least one log; give both");
    return nullptr;
  } else {
    file = read_simulator_file(a.files[0], errors);
    a.files.erase(a.files.begin());
  }
  if (!file) std::fputs(errors.c_str(), stderr);
  if (file && a.processes > 0) file->setup.processes = a.processes;
  return file;
}

int write_infer_data(InferArguments& a) {
  const auto file = take_simulator(a);
  std::vector<Grid> grids;
  if (!file || !read_grids(*file, a.files, grids)) return kExitBadInput;
  const std::vector<Piece> pieces = make_pieces(grids, file->robot.config, file->piece_s);
  std::string error;
  if (replace_file(a.out, inference_data_json(*file, file->robot, a.files, pieces), error)) return kExitOk;
  return complain(error);
}

void add_infer_data(CLI::App& data, int& exit_code) {
  auto* command = data.add_subcommand("infer", "names, priors, sensors' noise, and the logs cut to pieces");
  auto a = std::make_shared<InferArguments>();
  command
      ->add_option("FILES", a->files,
                   "simulator file (.toml: command, priors, sensors), then the logs: CSV, ROS "
                   "bags, ULog, as `tiller identify` takes them")
      ->required();
  command->add_option("-o,--out", a->out, "file to write")->required();
  auto* box = command->add_option("--command", a->command,
                                  "in the simulator file's place: the simulator's command, words between spaces");
  auto* robot = command->add_option("--robot", a->robot, "robot file with its names, priors and sensors");
  box->needs(robot);
  robot->needs(box);
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
  add_learn_data(*data, exit_code);
  data->footer("A laboratory asks for this by itself; a script of your own may ask for it too.");
}

}  // namespace tiller::tools
