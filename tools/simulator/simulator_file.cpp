#include "tools/simulator/simulator_file.hpp"

#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tools/base/toml.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/robot/robot_sections.hpp"
#include "tools/robot/units.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kLargestSeed = 9007199254740992.0;  // 2^53: JSON's numbers hold it

const Words kSections = {"simulator", "parameters", "measurements", "log"};
const Words kKeys = {"command", "robot",   "name",      "inputs",   "period_s", "timeout_s",
                     "start_s", "piece_s", "processes", "restarts", "ahead",    "seed"};

/// The table of a model that has no equations, and the names that it points to.
struct NameTable {
  std::string name;
  RobotNames names;
  std::vector<const char*> pointers[3];
  tiller_model_t model{};

  void fill() {
    auto point = [k = pointers](const Words& words, const char* const*& to, std::uint32_t& count) mutable {
      for (const std::string& word : words) k->push_back(word.c_str());
      count = static_cast<std::uint32_t>(words.size());
      to = (k++)->data();
    };
    model.size = sizeof model;
    model.version = TILLER_MODEL_VERSION;
    model.name = name.c_str();
    point(names.states, model.state_names, model.state_count);
    point(names.inputs, model.input_names, model.input_count);
    point(names.params, model.param_names, model.param_count);
  }
};

class Reader {
 public:
  Reader(FileErrors& errors, const toml::table& root, SimulatorFile& file)
      : errors_(errors), root_(root), file_(file), table_(section_table(errors, root, "simulator")) {}

  void read() {
    refuse_unknown();
    if (!table_) return errors_.missing(nullptr, "[simulator]", "write [simulator] with command = [\"program\", ...]");
    read_setup();
    if (table_->contains("robot"))
      take_robot();
    else
      make_robot();
    if (errors_.empty()) take_names();
  }

 private:
  void refuse_unknown() {
    for (auto&& [name, node] : root_)
      if (index_of(kSections, std::string(name.str())) < 0)
        errors_.at_table(node, "[" + std::string(name.str()) + "]", "unknown section",
                         remedy_for_unknown(std::string(name.str()), kSections));
    if (!table_) return;
    for (auto&& [name, node] : *table_)
      if (index_of(kKeys, std::string(name.str())) < 0)
        errors_.at(node, "simulator." + std::string(name.str()), "unknown key",
                   remedy_for_unknown(std::string(name.str()), kKeys));
  }

  void number(const char* key, double low, double high, double& out) {
    const toml::node* node = table_->get(key);
    if (!node) return;
    const auto value = node->value<double>();
    if (value && *value >= low && *value <= high)
      out = *value;
    else
      errors_.at(*node, std::string("simulator.") + key,
                 "is no number in " + number_text(low) + " .. " + number_text(high), "correct it");
  }

  void count(const char* key, double low, double high, unsigned& out) {
    double value = out;
    number(key, low, high, value);
    if (value == std::floor(value))
      out = static_cast<unsigned>(value);
    else
      errors_.at(*table_->get(key), std::string("simulator.") + key, "is no whole number", "write one");
  }

  /// A list of texts; empty after an error, or where it is missing and may be.
  Words words(const char* key, bool required, const char* remedy) {
    const toml::node* node = table_->get(key);
    if (!node) {
      if (required) errors_.missing(table_, std::string("simulator.") + key, remedy);
      return {};
    }
    Words list;
    const toml::array* array = node->as_array();
    for (std::size_t i = 0; array && i < array->size(); ++i)
      if (const auto word = array->get(i)->value<std::string>()) list.push_back(*word);
    if (array && list.size() == array->size() && (!required || !list.empty())) return list;
    errors_.at(*node, std::string("simulator.") + key, "is no list of texts", remedy);
    return {};
  }

  void read_setup() {
    SimulatorSetup& s = file_.setup;
    s.command = words("command", true, "write command = [\"program\", \"argument\"]");
    s.folder = fs::path(file_.path).parent_path().string();
    number("timeout_s", 1e-3, 1e6, s.timeout_s);
    number("start_s", 1e-3, 1e6, s.start_s);
    number("piece_s", 0.0, 1e6, file_.piece_s);
    count("processes", 1, 1024, s.processes);
    count("restarts", 0, 1e6, s.restarts);
    unsigned ahead = 0;
    count("ahead", 1, 1024, ahead);  // of older files: requests were given out ahead of answers
  }

  void take_robot() {
    for (const char* key : {"name", "inputs", "period_s"})
      if (const toml::node* node = table_->get(key))
        errors_.at(*node, std::string("simulator.") + key, "the robot file has it", "leave it out, or leave robot out");
    for (const char* section : {"parameters", "measurements", "log"})
      if (const toml::node* node = root_.get(section))
        errors_.at_table(*node, std::string("[") + section + "]", "the robot file has it",
                         "leave the section out, or leave robot out");
    const toml::node& node = *table_->get("robot");
    const std::string name = node.value<std::string>().value_or("");
    std::string problem;
    const auto robot = read_robot_file((fs::path(file_.setup.folder) / name).string(), problem);
    if (!robot) return errors_.at(node, "simulator.robot", "cannot be read", "correct this first:\n" + problem);
    file_.robot = *robot;
    read_seed();
  }

  void read_seed() {
    double seed = static_cast<double>(file_.robot.config.seed);
    number("seed", 1, kLargestSeed, seed);
    file_.robot.config.seed = static_cast<std::uint64_t>(seed);
  }

  void make_robot() {
    auto table = std::make_shared<NameTable>();
    RobotFile& robot = file_.robot;
    robot.path = file_.path;
    table->name = fs::path(file_.path).stem().string();
    if (const toml::node* name = table_->get("name")) table->name = name->value<std::string>().value_or(table->name);
    robot.name = table->name;
    robot.config.seed = 1;
    table->names.inputs = words("inputs", false, "write inputs = [\"force_N\"]; [] where nothing drives it");
    robot.config.period_s = 0.0;
    number("period_s", 1e-6, 1e3, robot.config.period_s);
    if (!table_->contains("period_s")) errors_.missing(table_, "simulator.period_s", "write the control period in s");
    read_seed();
    read_measurements(table->names);
    read_parameters(table->names);
    if (table->names.inputs.size() > TILLER_MAX_INPUTS)
      errors_.at(*table_->get("inputs"), "simulator.inputs", "are too many",
                 "keep at most " + std::to_string(TILLER_MAX_INPUTS));
    if (!errors_.empty()) return;
    table->fill();
    robot.config.model = &table->model;
    robot.names = table->names;
    file_.names = table;
    read_log_map(errors_, root_, robot);
  }

  void read_measurements(RobotNames& names) {
    const toml::table* table = section_table(errors_, root_, "measurements");
    const char* remedy = "write position_m = { sd = 0.001 }: the sensor's deviation, 0 where it has none";
    if (!table || table->empty()) return errors_.missing(table, "[measurements]", remedy);
    if (table->size() > TILLER_MAX_MEASUREMENTS || table->size() > TILLER_MAX_STATES)
      return errors_.at_table(*table, "[measurements]", "are too many",
                              "keep at most " + std::to_string(std::min(TILLER_MAX_MEASUREMENTS, TILLER_MAX_STATES)));
    tiller_config_t& config = file_.robot.config;
    for (const Entry& entry : in_file_order(*table)) {
      const toml::table* one = entry.node->as_table();
      const auto sd = one && one->size() == 1 ? (*one)["sd"].value<double>() : std::nullopt;
      if (!sd || !(*sd >= 0.0) || !std::isfinite(*sd)) {
        errors_.at(*entry.node, "measurements." + entry.name, "has no deviation", remedy);
        continue;
      }
      config.measured_state[config.measurement_count] = static_cast<std::uint8_t>(config.measurement_count);
      config.measurement_sd[config.measurement_count++] = *sd;
      names.states.push_back(entry.name);
    }
    names.measurements = names.states;
  }

  void read_parameters(RobotNames& names) {
    const toml::table* table = section_table(errors_, root_, "parameters");
    const char* remedy =
        "write friction = { uniform = [0.1, 0.9] }, { normal = ... }, { log_normal = ... } or a number";
    if (!table || table->empty()) return errors_.missing(table, "[parameters]", remedy);
    if (table->size() > TILLER_MAX_PARAMS)
      return errors_.at_table(*table, "[parameters]", "are too many",
                              "keep at most " + std::to_string(TILLER_MAX_PARAMS));
    tiller_config_t& config = file_.robot.config;
    bool learns = false;
    for (const Entry& entry : in_file_order(*table)) {
      tiller_prior_t& prior = file_.robot.config.priors[config.param_count++];
      read_prior(errors_, *entry.node, "parameters." + entry.name, least_of_unit(entry.name), kInf, prior);
      learns = learns || prior.kind != tiller_prior_fixed;
      names.params.push_back(entry.name);
    }
    if (!learns && errors_.empty())
      errors_.at_table(*table, "[parameters]", "are all known", std::string("nothing is left to learn; ") + remedy);
  }

  void take_names() {
    SimulatorNames& names = file_.setup.names;
    names.parameters = file_.robot.names.params;
    names.inputs = file_.robot.names.inputs;
    names.measurements = file_.robot.names.measurements;
    names.period_s = file_.robot.config.period_s;
  }

  FileErrors& errors_;
  const toml::table& root_;
  SimulatorFile& file_;
  const toml::table* table_;
};

}  // namespace

std::unique_ptr<SimulatorFile> parse_simulator_file(const std::string& text, const std::string& path,
                                                    std::string& errors_out) {
  FileErrors errors(path, text);
  auto file = std::make_unique<SimulatorFile>();
  file->path = path;
  try {
    const toml::table root = toml::parse(std::string_view(text), std::string_view(path));
    Reader(errors, root, *file).read();
  } catch (const toml::parse_error& error) {
    errors.at_line(static_cast<int>(error.source().begin.line), "TOML", std::string(error.description()),
                   "correct the syntax (toml.io)");
  }
  if (errors.empty()) return file;
  errors_out = errors.text();
  return nullptr;
}

std::unique_ptr<SimulatorFile> read_simulator_file(const std::string& path, std::string& errors) {
  std::ifstream stream(path, std::ios::binary);
  std::stringstream text;
  if (stream && !fs::is_directory(path)) {
    text << stream.rdbuf();
    return parse_simulator_file(text.str(), path, errors);
  }
  errors = path + ": cannot be read: " + std::strerror(stream ? EISDIR : errno) + "; name a simulator file (.toml)\n";
  return nullptr;
}

std::unique_ptr<SimulatorFile> simulator_of_command(const std::string& command, const std::string& robot,
                                                    std::string& errors) {
  Words words;
  std::istringstream text(command);
  for (std::string word; text >> word;) words.push_back(word);
  // strings of JSON are strings of TOML
  const auto json = [](const nlohmann::json& value) {
    return value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  };
  return parse_simulator_file("[simulator]\ncommand = " + json(words) + "\nrobot = " + json(robot) + "\n",
                              "--simulator", errors);
}

}  // namespace tiller::tools
