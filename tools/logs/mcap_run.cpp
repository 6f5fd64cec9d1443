#include "tools/logs/mcap_run.hpp"

#include <cmath>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tools/base/whole_file.hpp"
#include "tools/logs/mcap_reader.hpp"
#include "tools/logs/run_log.hpp"

namespace tiller::tools {
namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kTopics[] = {"/measurement", "/command", "/tick"};
constexpr const char* kSchemas[] = {"tiller.Measurement", "tiller.Command", "tiller.Tick"};
constexpr const char* kControllerAttachment = "controller";
constexpr const char* kRobotAttachment = "robot.toml";

// ---- numbers -----------------------------------------------------------------------------------------------------

Json exact(double v) {
  if (std::isnan(v)) return nullptr;
  if (std::isinf(v)) return v > 0 ? "inf" : "-inf";
  return v;  // the shortest text that reads back as the same double
}

bool take(const Json& json, double& v) {
  if (json.is_number()) {
    v = json.get<double>();
  } else if (json.is_null()) {
    v = std::numeric_limits<double>::quiet_NaN();
  } else if (json.is_string() && (json == "inf" || json == "-inf")) {
    v = json == "inf" ? std::numeric_limits<double>::infinity() : -std::numeric_limits<double>::infinity();
  } else {
    return false;
  }
  return true;
}

void put(Json& json, const Words& names, const double* values) {
  for (std::size_t i = 0; i < names.size(); ++i) json[names[i]] = exact(values[i]);
}

bool take(const Json& json, const Words& names, double* values) {
  for (std::size_t i = 0; i < names.size(); ++i)
    if (!json.contains(names[i]) || !take(json[names[i]], values[i])) return false;
  return true;
}

template <class Integer>
bool take(const Json& json, const char* name, Integer& v) {
  if (!json.contains(name) || !json[name].is_number_integer()) return false;
  v = json[name].get<Integer>();
  return true;
}

// ---- schemas -----------------------------------------------------------------------------------------------------

Json object_schema(const Words& integers, const Words& numbers) {
  Json properties = Json::object();
  for (const std::string& name : integers) properties[name] = {{"type", "integer"}};
  for (const std::string& name : numbers) properties[name] = {{"type", "number"}};  // null: missing
  return {{"type", "object"}, {"properties", properties}};
}

Json tick_schema(const RobotFile& robot) {
  Words numbers = robot.names.states;
  numbers.insert(numbers.end(), robot.names.params.begin(), robot.names.params.end());
  Json schema = object_schema({"tick", "now_us", "status_code", "state_code", "planner_iterations", "calls",
                               "stop_status", "tick_ns", "has_measurement"},
                              {"plan_cost", "effective_samples", "noise_scale"});
  for (const char* name : {"state", "status"}) schema["properties"][name] = {{"type", "string"}};
  schema["properties"]["mean"] = object_schema({}, numbers);
  schema["properties"]["sd"] = object_schema({}, robot.names.params);
  if (robot.config.probe.weight > 0.0)
    schema["properties"]["probe"] =
        object_schema({"probing", "calibration_left"}, {"value", "cost", "spent", "allowed", "information"});
  const Words forces = felt_forces(robot.config);
  if (forces.empty()) return schema;
  Json force = object_schema({"touched"}, {});
  for (const char* name : {"mean", "sd"}) force["properties"][name] = object_schema({}, forces);
  schema["properties"]["force"] = force;
  return schema;
}

// ---- a tick ------------------------------------------------------------------------------------------------------

std::string measurement_json(const RobotFile& robot, const tiller_measurement_t& m) {
  Json json = {{"stamp_us", m.stamp_us}, {"sequence", m.sequence}, {"command_latency_us", m.command_latency_us}};
  put(json, robot.names.measurements, m.value);
  return json.dump();
}

std::string command_json(const RobotFile& robot, const tiller_command_t& c) {
  Json json = {{"stamp_us", c.stamp_us}, {"sequence", c.sequence}, {"plan_sequence", c.plan_sequence}};
  put(json, robot.names.inputs, c.value);
  return json.dump();
}

Json force_json(const Words& forces, const RecordEntry& entry) {
  Json mean = Json::object(), sd = Json::object();
  put(mean, forces, entry.force_mean);
  put(sd, forces, entry.force_sd);
  return {{"mean", mean}, {"sd", sd}, {"touched", entry.touched}};
}

Json probe_json(const ProbeAccount& p) {
  return {{"probing", p.probing},
          {"calibration_left", p.calibration_left},
          {"value", exact(p.value)},
          {"cost", exact(p.cost)},
          {"spent", exact(p.spent)},
          {"allowed", exact(p.allowed)},
          {"information", exact(p.information)}};
}

std::string tick_json(const RobotFile& robot, const RecordEntry& entry) {
  const tiller_record_t& r = entry.record;
  Json json = {{"tick", r.tick},
               {"now_us", r.now_us},
               {"state", tiller_state_name(static_cast<tiller_state_t>(r.command.state))},
               {"state_code", r.command.state},
               {"status", tiller_status_name(static_cast<tiller_status_t>(r.status))},
               {"status_code", r.status},
               {"has_measurement", r.has_measurement},
               {"planner_iterations", r.planner_iterations},
               {"calls", r.calls},
               {"stop_status", entry.stop_status},
               {"tick_ns", r.tick_ns},
               {"plan_cost", exact(r.plan_cost)},
               {"effective_samples", exact(r.effective_samples)},
               {"noise_scale", exact(r.noise_scale)}};
  Json mean = Json::object(), sd = Json::object();
  put(mean, robot.names.states, r.state_mean);
  put(mean, robot.names.params, r.param_mean);
  put(sd, robot.names.params, r.param_sd);
  json["mean"] = mean;
  json["sd"] = sd;
  if (const Words forces = felt_forces(robot.config); !forces.empty()) json["force"] = force_json(forces, entry);
  if (robot.config.probe.weight > 0.0) json["probe"] = probe_json(entry.probe);
  if (entry.goal != 0) {
    Json goal = Json::object();
    if ((entry.goal & kGoalStates) != 0) put(goal, robot.names.states, entry.target);
    if ((entry.goal & kGoalOutputs) != 0) put(goal, robot.names.outputs, entry.output_target);
    json["goal"] = goal;
  }
  return json.dump();
}

bool take_measurement(const RobotFile& robot, const Json& json, tiller_measurement_t& m) {
  return take(json, "stamp_us", m.stamp_us) && take(json, "sequence", m.sequence) &&
         take(json, "command_latency_us", m.command_latency_us) && take(json, robot.names.measurements, m.value);
}

bool take_command(const RobotFile& robot, const Json& json, tiller_command_t& c) {
  return take(json, "stamp_us", c.stamp_us) && take(json, "sequence", c.sequence) &&
         take(json, "plan_sequence", c.plan_sequence) && take(json, robot.names.inputs, c.value);
}

/// What was set before the tick; nothing in ticks without a new goal.
bool take_goal(const RobotFile& robot, const Json& json, RecordEntry& entry) {
  if (!json.contains("goal")) return true;
  const Json& goal = json["goal"];
  if (!goal.is_object()) return false;
  if (goal.contains(robot.names.states[0])) {
    entry.goal |= kGoalStates;
    if (!take(goal, robot.names.states, entry.target)) return false;
  }
  if (robot.names.outputs.empty() || !goal.contains(robot.names.outputs[0])) return true;
  entry.goal |= kGoalOutputs;
  return take(goal, robot.names.outputs, entry.output_target);
}

/// Forces beyond the model; nothing in a log from before it had them.
bool take_forces(const RobotFile& robot, const Json& json, RecordEntry& entry) {
  const Words forces = felt_forces(robot.config);
  if (forces.empty() || !json.contains("force")) return true;
  const Json& force = json["force"];
  entry.force_joints = static_cast<std::uint32_t>(forces.size());
  const auto holds = [&](const char* name, double* values) {
    return force.contains(name) && force[name].is_object() && take(force[name], forces, values);
  };
  return force.is_object() && take(force, "touched", entry.touched) && holds("mean", entry.force_mean) &&
         holds("sd", entry.force_sd);
}

/// What was done to find out; nothing in a log from before it was told.
bool take_probe(const Json& json, ProbeAccount& p) {
  if (!json.contains("probe")) return true;
  const Json& probe = json["probe"];
  const auto number = [&](const char* name, double& value) { return probe.contains(name) && take(probe[name], value); };
  return probe.is_object() && take(probe, "probing", p.probing) &&
         take(probe, "calibration_left", p.calibration_left) && number("value", p.value) && number("cost", p.cost) &&
         number("spent", p.spent) && number("allowed", p.allowed) && number("information", p.information);
}

bool take_tick(const RobotFile& robot, const Json& json, RecordEntry& entry) {
  tiller_record_t& r = entry.record;
  const auto is_object = [&](const char* name) { return json.contains(name) && json[name].is_object(); };
  return take(json, "tick", r.tick) && take(json, "now_us", r.now_us) && take(json, "state_code", r.command.state) &&
         take(json, "status_code", r.status) && take(json, "has_measurement", r.has_measurement) &&
         take(json, "planner_iterations", r.planner_iterations) && take(json, "calls", r.calls) &&
         take(json, "stop_status", entry.stop_status) && take(json, "tick_ns", r.tick_ns) && is_object("mean") &&
         is_object("sd") && take(json["mean"], robot.names.states, r.state_mean) &&
         take(json["mean"], robot.names.params, r.param_mean) && take(json["sd"], robot.names.params, r.param_sd) &&
         json.contains("plan_cost") && take(json["plan_cost"], r.plan_cost) && json.contains("effective_samples") &&
         take(json["effective_samples"], r.effective_samples) && json.contains("noise_scale") &&
         take(json["noise_scale"], r.noise_scale) && take_goal(robot, json, entry) && take_forces(robot, json, entry) &&
         take_probe(json, entry.probe);
}

}  // namespace

// ---- writing -----------------------------------------------------------------------------------------------------

void McapRun::open(const std::string& path, const tiller_config_t& config, std::int64_t epoch_us) {
  epoch_us_ = epoch_us;
  writer_.open(path, std::string("tiller ") + tiller_version());
  const std::string texts[] = {
      object_schema({"stamp_us", "sequence", "command_latency_us"}, robot_.names.measurements).dump(),
      object_schema({"stamp_us", "sequence", "plan_sequence"}, robot_.names.inputs).dump(), tick_schema(robot_).dump()};
  std::uint16_t* ids[] = {&measurement_, &command_, &tick_};
  for (int i = 0; i < 3; ++i)
    *ids[i] = writer_.add_channel(kTopics[i], "json", writer_.add_schema(kSchemas[i], "jsonschema", texts[i]));
  writer_.add_metadata("tiller", {{"robot", robot_.name},
                                  {"model", robot_.config.model->name},
                                  {"version", tiller_version()},
                                  {"instruction_set", tiller_instruction_set()},
                                  {"seed", std::to_string(config.seed)}});
  writer_.add_attachment(kControllerAttachment, "application/octet-stream", record_header(config), 0);
  std::string toml, error;
  (void)read_whole_file(robot_.path, toml, error);  // without it, the log does not tell whose it is
  if (!toml.empty()) writer_.add_attachment(kRobotAttachment, "application/toml", toml, 0);
}

void McapRun::add(const RecordEntry& entry) {
  const tiller_record_t& r = entry.record;
  const auto time_ns = static_cast<std::uint64_t>(1000 * std::max<std::int64_t>(r.now_us + epoch_us_, 0));
  const auto sequence = static_cast<std::uint32_t>(r.tick);
  if (r.has_measurement != 0)
    writer_.add_message(measurement_, sequence, time_ns, measurement_json(robot_, r.measurement));
  writer_.add_message(command_, sequence, time_ns, command_json(robot_, r.command));
  writer_.add_message(tick_, sequence, time_ns, tick_json(robot_, entry));
}

bool McapRun::close(std::uint64_t ticks, std::uint64_t dropped_ticks, const std::vector<LogHole>& holes) {
  constexpr std::size_t kMostPlaces = 1000;  // a line of 20 kB; `tiller replay` finds all by the ticks' numbers
  writer_.close_chunk();
  writer_.add_metadata("recorder", {{"ticks", std::to_string(ticks)},
                                    {"dropped_ticks", std::to_string(dropped_ticks)},
                                    {"dropped", ticks_text(holes, kMostPlaces)},
                                    {"lost_messages", std::to_string(writer_.lost_messages())}});
  return writer_.close();
}

// ---- reading -----------------------------------------------------------------------------------------------------

bool is_mcap_run(const std::string& bytes) {
  McapContent content;
  if (!read_mcap_bytes(bytes, content)) return false;
  for (const auto& [id, channel] : content.channels)
    if (channel.schema == kSchemas[2] && channel.message_encoding == "json") return true;
  return false;
}

std::string robot_text_of(const std::string& mcap_bytes) {
  McapContent content;
  if (!read_mcap_bytes(mcap_bytes, content)) return "";
  const auto found = content.attachments.find(kRobotAttachment);
  return found != content.attachments.end() ? found->second : "";
}

bool read_mcap_run(const std::string& bytes, const std::string& path, const RobotFile& robot, RecordedRun& run,
                   std::string& error) {
  run = {};
  McapContent content;
  if (!read_mcap_bytes(bytes, content)) {
    error = path + ": is no MCAP file\n";
    return false;
  }
  RecordEntry entry;
  bool has_command = false;
  for (const McapMessage& message : content.messages) {
    const McapChannel& channel = content.channels[message.channel];
    if (channel.message_encoding != "json") continue;
    const Json json = Json::parse(message.data, nullptr, false);
    bool good = json.is_object();
    if (channel.schema == kSchemas[0]) {
      entry = {};  // the first of a tick's messages
      good = good && take_measurement(robot, json, entry.record.measurement);
    } else if (channel.schema == kSchemas[1]) {
      good = good && take_command(robot, json, entry.record.command);
      has_command = true;
    } else if (channel.schema == kSchemas[2]) {
      good = good && has_command && take_tick(robot, json, entry);
      if (good) run.entries.push_back(entry);
      entry = {};
      has_command = false;
    } else {
      continue;
    }
    if (good) continue;
    error = path + ": a message of " + channel.topic + " at " +
            format("%.6f s", 1e-9 * static_cast<double>(message.time_ns)) + " is not what " + robot.path +
            " expects; use the robot file that was run\n";
    return false;
  }
  run.cut_off = !content.stopped.empty();
  if (run.cut_off)
    run.note = format("%zu ticks in whole chunks could be read; the rest of the file is %s", run.entries.size(),
                      content.stopped.c_str());
  if (content.compressed) run.note = "compressed chunks were left out: write them again with `mcap compress -c none`";
  if (run.entries.empty())
    error = path + ": holds no whole chunk with a tick of tiller" + (run.note.empty() ? "" : "; " + run.note) + "\n";
  const auto header = content.attachments.find(kControllerAttachment);
  if (header != content.attachments.end()) {
    std::istringstream stream(header->second);
    std::string ignored;
    run.has_config = read_record_header(stream, path, run.config, run.joint, ignored);
  }
  return !run.entries.empty();
}

}  // namespace tiller::tools
