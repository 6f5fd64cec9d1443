#include "tools/robot/network_file.hpp"

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "effects/effect_info.hpp"
#include "networks/network_check.hpp"
#include "tools/base/output_file.hpp"
#include "tools/robot/robot_sections.hpp"

namespace tiller::tools {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kVersion = 1;
constexpr const char* kNetworkFormat = "tiller network";
constexpr const char* kPolicyFormat = "tiller policy";
constexpr const char* kAnew = "write the file again (tiller learn, tiller distill, tiller policy)";
const Words kKinds = {"tanh", "gaussian"};
const Words kSquashes = {"cut", "sine"};
const Words kReads = {"state", "goal", "belief_mean", "belief_spread", "last_command"};

bool is_angle(const RobotFile& robot, std::uint32_t i) { return ((robot.config.model->angle_mask >> i) & 1u) != 0; }

void add_state(const RobotFile& robot, std::uint32_t i, Words& names) {
  const std::string& name = robot.names.states[i];
  if (!is_angle(robot, i)) return names.push_back(name);
  names.push_back("sin " + name);
  names.push_back("cos " + name);
}

Json json_of(const StoredNetwork& n) {
  Json json;
  json["kind"] = kKinds[n.kind];
  json["inputs"] = n.inputs;
  json["outputs"] = n.outputs;
  json["members"] = n.members;
  json["hidden"] = {n.hidden[0], n.hidden[1]};
  json["weights"] = n.weights;
  return json;
}

Json with_format(const char* format, const Json& body) {
  Json json;
  json["format"] = format;
  json["version"] = kVersion;
  for (const auto& item : body.items()) json[item.key()] = item.value();
  return json;
}

/// Reads the values of one object; the first that is wrong stays in `error`.
class Fields {
 public:
  Fields(const Json& json, std::string prefix, std::string& error)
      : json_(json), prefix_(std::move(prefix)), error_(error) {}

  bool good() const { return error_.empty(); }
  void refuse(const char* key, const std::string& problem) {
    if (good()) error_ = prefix_ + key + ": " + problem + "; " + kAnew;
  }
  const Json* find(const char* key) {
    const auto found = json_.find(key);
    if (found != json_.end()) return &*found;
    refuse(key, "is missing");
    return nullptr;
  }
  std::uint32_t word(const char* key, const Words& known) {
    const Json* value = find(key);
    const int index = value && value->is_string() ? index_of(known, value->get<std::string>()) : -1;
    if (value && index < 0) refuse(key, "is none of " + join(known));
    return static_cast<std::uint32_t>(std::max(index, 0));
  }
  std::uint32_t count(const char* key, const Json* value, std::uint32_t most) {
    if (!value) return 0;
    if (!value->is_number_unsigned() || value->get<std::uint64_t>() > most) {
      refuse(key, "is no whole number up to " + std::to_string(most));
      return 0;
    }
    return value->get<std::uint32_t>();
  }
  Words words(const char* key) {
    Words out;
    const Json* list = find(key);
    if (!list) return out;
    if (!list->is_array()) refuse(key, "is no list of names");
    for (std::size_t i = 0; good() && i < list->size(); ++i) {
      if (!(*list)[i].is_string()) return refuse(key, "is no list of names"), out;
      out.push_back((*list)[i].get<std::string>());
    }
    return out;
  }
  std::vector<float> numbers(const char* key, const Json* list) {
    std::vector<float> out;
    if (!list) return out;
    if (!list->is_array()) refuse(key, "is no list of numbers");
    for (std::size_t i = 0; good() && i < list->size(); ++i) {
      const Json& one = (*list)[i];
      const float value = one.is_number() ? one.get<float>() : NAN;
      if (!(std::fabs(value) <= static_cast<float>(TILLER_LARGEST_VALUE)))
        return refuse(key, "number " + std::to_string(i + 1) + " is " + one.dump() + ", no finite number up to 1e9"),
               out;
      out.push_back(value);
    }
    return out;
  }
  const Json& json() const { return json_; }

 private:
  const Json& json_;
  const std::string prefix_;
  std::string& error_;
};

void read_body(Fields& f, StoredNetwork& out) {
  out.kind = static_cast<tiller_network_kind_t>(f.word("kind", kKinds));
  out.inputs = f.words("inputs");
  out.outputs = f.words("outputs");
  out.members = f.count("members", f.find("members"), TILLER_MAX_NETWORK_MEMBERS);
  const Json* hidden = f.find("hidden");
  if (hidden && (!hidden->is_array() || hidden->size() != 2)) f.refuse("hidden", "is no list of two counts");
  for (std::size_t i = 0; f.good() && i < 2; ++i)
    out.hidden[i] = f.count("hidden", &(*hidden)[i], TILLER_MAX_NETWORK_FEATURES);
  out.weights = f.numbers("weights", f.find("weights"));
  if (!f.good()) return;
  const LoadedNetwork loaded(out);
  if (const char* defect = network_defect(loaded.network))
    f.refuse(defect, std::string(defect) == "weight_count"
                         ? "holds " + std::to_string(out.weights.size()) + " weights, and its shape wants " +
                               std::to_string(network_weight_count(loaded.network))
                         : "is beyond the limits of networks (docs/reference/networks.md)");
}

/// The file's JSON, of the right format and version; discarded with an error otherwise.
Json open_json(const std::string& text, const char* format, std::string& error) {
  Json json = Json::parse(text, nullptr, false);
  if (!json.is_object()) {
    error = std::string("the file: is no JSON object; ") + kAnew;
  } else if (json.value("format", Json()) != format) {
    error = "format: is not \"" + std::string(format) + "\"; name the right file";
  } else if (json.value("version", Json()) != kVersion) {
    error = "version: is not " + std::to_string(kVersion) + ", which this tiller reads; " + kAnew;
  }
  return json;
}

bool same_names(const char* key, const Words& got, const Words& wanted, std::string& error) {
  if (got == wanted) return true;
  for (std::size_t i = 0; i < std::max(got.size(), wanted.size()); ++i) {
    const std::string a = i < got.size() ? got[i] : "nothing", b = i < wanted.size() ? wanted[i] : "nothing";
    if (a == b) continue;
    error = std::string(key) + ": number " + std::to_string(i + 1) + " is " + a + ", and the robot has " + b +
            " there; learn it for this robot";
    break;
  }
  return false;
}

/// An effect's `member` without a prior in the robot file has all that the format allows: now those that there are.
void bound_members(std::uint32_t members, RobotFile& robot) {
  std::uint32_t param = robot.config.model->param_count;
  for (std::uint32_t e = 0; e < robot.config.effect_count; ++e) {
    const EffectInfo& info = effect_info(robot.config.effects[e].kind);
    tiller_prior_t& prior = robot.config.priors[param];
    if (info.learnt && prior.kind == tiller_prior_uniform && prior.high > members) {
      prior.b = prior.high = members;
      if (members == 1) prior = {tiller_prior_fixed, 0, 0.0, 0.0, 0.0, 0.0};
    }
    param += static_cast<std::uint32_t>(info.param_count);
  }
}

}  // namespace

Words network_inputs(const RobotFile& robot) {
  Words names;
  for (std::uint32_t j = 0; j < robot.config.model->joint_count; ++j) {
    const tiller_joint_t& joint = robot.config.model->joints[j];
    if (joint.position != TILLER_NO_POSITION) add_state(robot, joint.position, names);
    names.push_back(robot.names.states[joint.velocity]);
  }
  names.insert(names.end(), robot.names.inputs.begin(), robot.names.inputs.end());
  return names;
}

Words network_outputs(const RobotFile& robot) {
  return Words(robot.config.model->force_names, robot.config.model->force_names + robot.config.model->joint_count);
}

Words policy_inputs(const RobotFile& robot, std::uint32_t reads) {
  Words names, free;
  for (std::uint32_t p = 0; p < robot.config.param_count; ++p)
    if (robot.config.priors[p].kind != tiller_prior_fixed) free.push_back(robot.names.params[p]);
  if (reads & tiller_policy_state)
    for (std::uint32_t i = 0; i < robot.config.model->state_count; ++i) add_state(robot, i, names);
  if (reads & tiller_policy_goal)
    for (const std::string& state : robot.names.states) names.push_back("error " + state);
  if (reads & tiller_policy_belief_mean)
    for (const std::string& param : free) names.push_back("mean " + param);
  if (reads & tiller_policy_belief_spread)
    for (const std::string& param : free) names.push_back("sd " + param);
  if (reads & tiller_policy_last_command)
    for (const std::string& input : robot.names.inputs) names.push_back("last " + input);
  return names;
}

LoadedNetwork::LoadedNetwork(StoredNetwork given) : stored(std::move(given)), network{} {
  network.size = sizeof network;
  network.version = TILLER_CONFIG_VERSION;
  network.kind = stored.kind;
  network.inputs = static_cast<std::uint32_t>(stored.inputs.size());
  network.outputs = static_cast<std::uint32_t>(stored.outputs.size());
  network.members = stored.members;
  network.hidden[0] = stored.hidden[0];
  network.hidden[1] = stored.hidden[1];
  network.weights = stored.weights.data();
  network.weight_count = static_cast<std::uint32_t>(stored.weights.size());
}

LoadedPolicy::LoadedPolicy(StoredPolicy given) : stored(std::move(given)), loaded(stored.network), policy{} {
  policy.size = sizeof policy;
  policy.version = TILLER_CONFIG_VERSION;
  policy.reads = stored.reads;
  policy.squash = stored.squash;
  policy.network = &loaded.network;
  policy.input_low = stored.low.empty() ? nullptr : stored.low.data();
  policy.input_high = stored.high.empty() ? nullptr : stored.high.data();
}

std::string network_text(const StoredNetwork& network) {
  return with_format(kNetworkFormat, json_of(network)).dump(1) + "\n";
}

std::string policy_text(const StoredPolicy& policy) {
  Json body, reads = Json::array();
  for (std::size_t i = 0; i < kReads.size(); ++i)
    if ((policy.reads >> i) & 1u) reads.push_back(kReads[i]);
  body["reads"] = reads;
  body["squash"] = kSquashes[policy.squash];
  body["input_low"] = policy.low;
  body["input_high"] = policy.high;
  body["network"] = json_of(policy.network);
  return with_format(kPolicyFormat, body).dump(1) + "\n";
}

bool parse_network(const std::string& text, StoredNetwork& out, std::string& error) {
  error.clear();
  const Json json = open_json(text, kNetworkFormat, error);
  if (!error.empty()) return false;
  Fields fields(json, "", error);
  read_body(fields, out);
  return error.empty();
}

bool parse_policy(const std::string& text, StoredPolicy& out, std::string& error) {
  error.clear();
  const Json json = open_json(text, kPolicyFormat, error);
  if (!error.empty()) return false;
  Fields fields(json, "", error);
  out.squash = fields.word("squash", kSquashes);
  out.reads = 0;
  for (const std::string& name : fields.words("reads")) {
    const int index = index_of(kReads, name);
    if (index < 0) fields.refuse("reads", "\"" + name + "\" is none of " + join(kReads));
    if (index >= 0) out.reads |= 1u << index;
  }
  out.low = fields.numbers("input_low", fields.find("input_low"));
  out.high = fields.numbers("input_high", fields.find("input_high"));
  const Json* network = fields.find("network");
  if (network && !network->is_object()) fields.refuse("network", "is no object");
  if (!error.empty()) return false;
  Fields body(*network, "network.", error);
  read_body(body, out.network);
  if (!error.empty()) return false;
  if (out.low.size() != out.high.size() || (!out.low.empty() && out.low.size() != out.network.inputs.size()))
    fields.refuse("input_low", "and input_high do not have a number for each input");
  return error.empty();
}

bool take_network(const StoredNetwork& network, RobotFile& robot, std::string& error) {
  if (!same_names("inputs", network.inputs, network_inputs(robot), error)) return false;
  if (!same_names("outputs", network.outputs, network_outputs(robot), error)) return false;
  bound_members(network.members, robot);
  robot.memory.network = std::make_shared<const LoadedNetwork>(network);
  robot.config.network = &robot.memory.network->network;
  return true;
}

bool take_policy(const StoredPolicy& policy, RobotFile& robot, std::string& error) {
  if (!same_names("network.inputs", policy.network.inputs, policy_inputs(robot, policy.reads), error)) return false;
  if (!same_names("network.outputs", policy.network.outputs, robot.names.inputs, error)) return false;
  robot.memory.policy = std::make_shared<const LoadedPolicy>(policy);
  robot.config.policy = &robot.memory.policy->policy;
  return true;
}

namespace {

template <class Stored, class Parse, class Take>
void read_file(FileErrors& errors, const toml::table& root, const char* name, RobotFile& robot, Parse parse,
               Take take) {
  const toml::table* table = section_table(errors, root, name);
  if (!table) return;
  SectionReader section(errors, name, name, table);
  const auto file = section.text("file");
  if (!section.has("file")) section.missing("file", "write file = \"name.json\"");
  section.refuse_unknown();
  if (!file) return;
  const std::filesystem::path given = *file;
  const std::string path = (given.is_absolute() ? given : robot.model_request.robot_dir / given).string();
  std::ifstream in(path, std::ios::binary);
  std::stringstream text;
  if (in) text << in.rdbuf();
  if (!in) return section.error("file", path + " cannot be read", "name a file beside the robot file");
  Stored stored;
  std::string error;
  if (parse(text.str(), stored, error) && take(stored, robot, error)) return;
  const std::size_t remedy = error.rfind("; ");
  section.error("file", path + ": " + error.substr(0, remedy), error.substr(remedy + 2));
}

}  // namespace

void read_networks(FileErrors& errors, const toml::table& root, RobotFile& robot) {
  if (errors.has_below("parameters") || errors.has_below("effects")) return;
  read_file<StoredNetwork>(errors, root, "network", robot, parse_network, take_network);
  read_file<StoredPolicy>(errors, root, "policy", robot, parse_policy, take_policy);
}

}  // namespace tiller::tools
