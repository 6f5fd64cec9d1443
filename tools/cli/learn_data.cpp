// `tiller data learn`: what the laboratory of forces learns from, and how it is judged.
#include "tools/cli/learn_data.hpp"

#include <fstream>
#include <sstream>

#include "tools/base/output_file.hpp"
#include "tools/gap/pipeline/data.hpp"
#include "tools/learn/force_data.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools {
namespace {

struct LearnData {
  std::string robot, out, base, states_of, network;
  Words logs, starts;
  std::vector<double> force_sd;
  double hold_out = 0.25;
  unsigned threads = 1;
  bool catalogue = false, all = false;
};

bool read_text(const std::string& path, std::string& text) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream stream;
  stream << file.rdbuf();
  text = stream.str();
  if (file) return true;
  complain(path + ": cannot be read; name a file that `tiller data learn` wrote");
  return false;
}

bool read_ground_file(const std::string& path, learn::Ground& ground) {
  std::string text, error;
  if (!read_text(path, text)) return false;
  if (learn::read_ground(text, ground, error)) return true;
  complain(path + ": " + error);
  return false;
}

bool load(const RobotFile& robot, const Words& paths, std::vector<Grid>& grids) {
  std::vector<Log> logs;
  gap::Result scratch;
  if (gap::load_logs(robot, paths, kMostSteps, false, logs, grids, nullptr, scratch)) return true;
  for (const std::string& reason : scratch.reasons) complain(reason);
  return false;
}

/// From states that are known, such as those of a simulation: what a robot file is worth on logs.
bool judge(const LearnData& a, const RobotFile& robot, std::string& json) {
  std::vector<Grid> grids, known;
  RobotFile all = robot;  // with a sensor for each state
  all.config.measurement_count = robot.config.model->state_count;
  for (std::uint32_t i = 0; i < robot.config.model->state_count; ++i) {
    all.config.measured_state[i] = static_cast<std::uint8_t>(i);
    all.config.measurement_sd[i] = 1.0;
  }
  if (!load(robot, a.logs, grids) || !load(all, a.starts, known)) return false;
  if (known.size() != grids.size()) return complain("--starts: not as many stretches as the logs have"), false;
  std::vector<Eigen::MatrixXd> states;
  for (const Grid& grid : known) {
    states.push_back(Eigen::MatrixXd(grid.state.size(), grid.points()));
    for (std::size_t i = 0; i < grid.state.size(); ++i)
      for (std::size_t k = 0; k < grid.points(); ++k)
        states.back()(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = grid.state[i][k];
  }
  json = learn::held_out_json(learn::judge_robot(robot, grids, states));
  return true;
}

bool beside(const LearnData& a, const RobotFile& robot, const learn::Course& course, std::string& json,
            std::string& error) {
  learn::Ground ground, by;
  std::string text;
  StoredNetwork stored;
  if (!read_ground_file(a.base, ground) || !read_ground_file(a.states_of, by)) return false;
  if (!read_text(a.network, text) || !parse_network(text, stored, error)) return false;
  Eigen::VectorXd force_sd = ground.force_sd;
  for (std::size_t j = 0; j < a.force_sd.size() && a.force_sd.size() == static_cast<std::size_t>(force_sd.size()); ++j)
    force_sd(static_cast<Eigen::Index>(j)) = a.force_sd[j];
  learn::Beside out;
  if (!learn::smooth_beside(robot, ground, by, LoadedNetwork(stored), course, force_sd, !a.all, out, error))
    return false;
  json = learn::beside_json(out);
  return true;
}

bool ground(const LearnData& a, const RobotFile& robot, const learn::Course& course, std::string& json,
            std::string& error) {
  std::string text;
  learn::Ground plain, found;
  if (!read_text(robot.path, text)) return false;
  if (a.catalogue) {
    if (!read_ground_file(a.base, plain) ||
        !learn::find_catalogue(robot, text, course, plain, a.threads, gap::hash_of_files(a.logs), found, error))
      return false;
  } else if (!learn::lay_ground(robot, text, course, found, error)) {
    return false;
  }
  const auto with = parse_robot_file(found.text, robot.path, error);
  if (with) json = learn::ground_json(*with, course, found);
  return with != nullptr;
}

int write_learn_data(const LearnData& a) {
  const auto robot = read_robot_or_complain(a.robot);
  if (!robot) return kExitBadInput;
  std::string json, error;
  std::vector<Grid> grids;
  learn::Course course;
  bool good;
  if (!a.starts.empty()) {
    good = judge(a, *robot, json);
  } else {
    if (!load(*robot, a.logs, grids)) return kExitBadInput;
    good = learn::split(grids, a.hold_out, course, error);
    if (a.all) course.train = grids;
    good =
        good && (a.network.empty() ? ground(a, *robot, course, json, error) : beside(a, *robot, course, json, error));
  }
  if (good && replace_file(a.out, json, error)) return kExitOk;
  return error.empty() ? static_cast<int>(kExitBadInput) : complain(error);
}

}  // namespace

void add_learn_data(CLI::App& data, int& exit_code) {
  auto* command = data.add_subcommand("learn", "states, inputs and the forces that the model lacks, and judgements");
  auto a = std::make_shared<LearnData>();
  command->add_option("ROBOT", a->robot, "robot file (.toml)")->required();
  command->add_option("LOGS", a->logs, "logs, as `tiller identify` takes them")->required();
  command->add_option("-o,--out", a->out, "file to write")->required();
  command->add_option("--hold-out", a->hold_out, "last share of every log, which judges (default 0.25)")
      ->check(number_between(0.05, 0.8));
  auto* base = command->add_option("--base", a->base, "what this command wrote before, to stand on");
  auto* states =
      command->add_option("--states-of", a->states_of, "the same; judged rollouts begin where its filter is");
  auto* network = command->add_option("--network", a->network,
                                      "network file: the forces that are left beside it, and "
                                      "what rollouts with it come to on the held-out part");
  network->needs(base);
  network->needs(states);
  command->add_option("--force-sd", a->force_sd, "intensity of what is left, near which it is sought")
      ->delimiter(',')
      ->needs(network);
  command->add_flag("--all", a->all, "nothing is held out, and nothing judged")->needs(network);
  command->add_flag("--catalogue", a->catalogue, "the effects of the catalogue that explain most of what --base leaves")
      ->needs(base)
      ->excludes(network);
  command->add_option("--threads", a->threads, "of --catalogue (default 1)")->check(CLI::Range(1, 256));
  command->add_option("--starts", a->starts, "logs of true states, one for each of LOGS: ROBOT is judged from them");
  command->footer(
      "Example:\n"
      "  tiller data learn robot.toml run1.csv run2.csv -o ground.json\n"
      "  tiller data learn robot.toml run1.csv run2.csv --base ground.json --states-of ground.json --network net.json "
      "-o left.json");
  command->callback([a, &exit_code] { exit_code = write_learn_data(*a); });
}

}  // namespace tiller::tools
