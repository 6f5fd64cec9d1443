#include "tools/gap/report/robot_writer.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <sstream>
#include <string_view>

#include "effects/effect_info.hpp"
#include "effects/effect_roles.hpp"
#include "tools/base/interval_text.hpp"
#include "tools/base/text.hpp"
#include "tools/base/toml.hpp"
#include "tools/gap/report/outputs.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools::gap {
namespace {

constexpr double kWider = 2.0;        // than the fit's deviation: the robot is not the same every day
constexpr double kLeastShare = 0.02;  // of the value
constexpr double kDelayReach = 8.0;   // deviations that an input delay may have beyond its mean: the bound sizes memory

// Text in the place of a value of the file.
struct Replacement {
  std::size_t from = 0, to = 0;  // bytes
  std::string text;
};

/// Byte at which a toml++ position (line and column from 1, columns in code points) stands.
std::size_t offset_of(const std::string& text, const toml::source_position& at) {
  std::size_t offset = 0;
  for (std::size_t line = 1; line < at.line; ++line) offset = text.find('\n', offset) + 1;
  for (std::size_t column = 1; column < at.column && offset < text.size(); ++column) {
    ++offset;
    while (offset < text.size() && (static_cast<unsigned char>(text[offset]) & 0xC0u) == 0x80u) ++offset;
  }
  return offset;
}

std::string bounds_text(double low, double high) {
  std::string text;
  if (std::isfinite(low)) text += ", low = " + format("%.6g", low);
  if (std::isfinite(high)) text += ", high = " + format("%.6g", high);
  return text;
}

/// The prior of the next run; a plain number where the fit says nothing of the deviation.
std::string prior_text(double mean, double sd, double low, double high, bool log_normal) {
  mean = as_written(std::clamp(mean, low, high));
  if (!(sd > 0) || !std::isfinite(sd)) return format("%.6g", mean);
  sd = std::max(kWider * sd, kLeastShare * std::fabs(mean));
  if (log_normal && mean > 0)
    return "{ log_normal = [" + format("%.6g, %.3g", mean, sd / mean) + "]" + bounds_text(low, high) + " }";
  return "{ normal = [" + format("%.6g, %.3g", mean, sd) + "]" + bounds_text(low, high) + " }";
}

const toml::node* node_of(const toml::table& root, const RobotFile& robot, std::uint32_t param) {
  if (param < robot.config.model->param_count) {
    const toml::table* table = root["parameters"].as_table();
    return table ? table->get(robot.names.params[param]) : nullptr;
  }
  std::uint32_t first = robot.config.model->param_count;
  for (std::uint32_t e = 0; e < robot.config.effect_count; ++e) {
    const EffectInfo& info = effect_info(robot.config.effects[e].kind);
    const auto count = static_cast<std::uint32_t>(info.param_count);
    if (param < first + count) {
      const toml::array* list = root["effects"].as_array();
      const toml::table* table = list && e < list->size() ? list->get(e)->as_table() : nullptr;
      return table ? table->get(info.params[param - first].name) : nullptr;
    }
    first += count;
  }
  return nullptr;
}

// Bounds of the next run's prior: the old ones, but for a parameter that changed, which they were of before.
void bounds_of(const RobotFile& robot, std::uint32_t param, const Explanation& found, double& low, double& high) {
  low = robot.config.priors[param].low;
  high = robot.config.priors[param].high;
  const EffectAt changed = {kChangedParameter, param};
  if (std::find(found.effects.begin(), found.effects.end(), changed) == found.effects.end()) return;
  const PhysicalRange range = physical_range(robot.config, robot.names.params, param);
  low = range.least;
  high = range.most;
}

std::vector<Replacement> prior_changes(const RobotFile& robot, const std::string& old_text, const toml::table& root,
                                       const Explanation& found) {
  std::vector<Replacement> changes;
  for (std::uint32_t i = 0; i < robot.config.param_count && i < found.params.size(); ++i) {
    const Estimate& e = found.params[i];
    const toml::node* node = node_of(root, robot, i);
    if (e.fixed || !node || !(e.sd > 0)) continue;
    double low, high;
    bounds_of(robot, i, found, low, high);
    const bool log_normal = robot.config.priors[i].kind == tiller_prior_log_normal;
    const toml::source_region region = node->source();
    changes.push_back({offset_of(old_text, region.begin), offset_of(old_text, region.end),
                       prior_text(e.mean, e.sd, low, high, log_normal)});
  }
  std::sort(changes.begin(), changes.end(), [](const Replacement& a, const Replacement& b) { return a.from > b.from; });
  return changes;
}

std::string effects_blocks(const RobotFile& robot, const Explanation& found, const std::string& data_hash) {
  std::string text;
  std::size_t param = robot.config.param_count;
  for (const EffectAt& effect : found.effects) {
    if (effect.kind == kChangedParameter) continue;  // in its place
    const EffectInfo& info = effect_info(effect.kind);
    text += "\n# Found by tiller gap in logs " + data_hash + ".";
    if (info.equation) text += " " + std::string(info.equation);
    text += "\n[[effects]]\nkind = \"" + std::string(info.name) + "\"\nport = \"" +
            port_name(info.port, *robot.config.model, effect.port) + "\"\n";
    for (int i = 0; i < info.param_count && param < found.params.size(); ++i, ++param) {
      const Estimate& e = found.params[param];
      double high = info.params[i].high;
      if (has_role(effect.kind, kDelay | kLate))
        high = std::min(TILLER_MAX_DELAY_STEPS * robot.config.period_s,
                        e.mean + std::max(kDelayReach * e.sd, robot.config.period_s));
      text += std::string(info.params[i].name) + " = " + prior_text(e.mean, e.sd, info.params[i].low, high, false);
      if (e.sd > 0)
        text += format("  # %s +- %.2g %s, 95 %%: %s", mean_text(e.mean, e.sd).c_str(), e.sd, e.unit.c_str(),
                       interval_text(e.low, e.high).c_str());
      text += "\n";
    }
  }
  return text;
}

/// [posterior] kind = "filter", which takes every effect.
std::string with_filter(const std::string& text) {
  const toml::table root = toml::parse(text);
  if (const toml::node* kind = root["posterior"]["kind"].node()) {
    const std::size_t from = offset_of(text, kind->source().begin), to = offset_of(text, kind->source().end);
    return text.substr(0, from) + "\"filter\"" + text.substr(to);
  }
  return text;
}

}  // namespace

std::string with_paths_from(const std::string& text, const std::string& from, const std::string& to) {
  namespace fs = std::filesystem;
  const auto names_files = [](std::string_view key) {  // robot_schema.cpp: "relative to the robot file"
    return key == "file" || key == "prior_file" || key == "key_file" || key == "reference" || key == "demonstration";
  };
  std::error_code none;
  if (fs::equivalent(from, to, none)) return text;
  std::vector<Replacement> changes;
  const auto visit = [&](const auto& self, const toml::node& node, bool is_file) -> void {
    if (const toml::table* table = node.as_table())
      for (auto&& [key, value] : *table) self(self, value, names_files(key.str()));
    if (const toml::array* array = node.as_array())
      for (const toml::node& value : *array) self(self, value, is_file);
    const auto path = node.value<std::string>();
    if (!is_file || !node.is_string() || path->empty() || fs::path(*path).is_absolute()) return;
    const fs::path moved = fs::relative(fs::path(from) / *path, to, none);
    if (!fs::is_regular_file(fs::path(from) / *path, none) || moved.empty()) return;
    const toml::source_region region = node.source();
    std::ostringstream quoted;
    quoted << toml::value<std::string>(moved.string());
    changes.push_back({offset_of(text, region.begin), offset_of(text, region.end), quoted.str()});
  };
  visit(visit, toml::parse(text), false);
  std::sort(changes.begin(), changes.end(), [](const Replacement& a, const Replacement& b) { return a.from > b.from; });
  std::string out = text;
  for (const Replacement& change : changes) out.replace(change.from, change.to - change.from, change.text);
  return out;
}

bool write_robot(const RobotFile& robot, const std::string& old_text, const Explanation& found,
                 const std::string& data_hash, std::string& text, std::string& error) {
  try {
    const toml::table root = toml::parse(old_text);
    text = old_text;
    for (const Replacement& change : prior_changes(robot, old_text, root, found))
      text.replace(change.from, change.to - change.from, change.text);
    if (!text.empty() && text.back() != '\n') text += '\n';
    text += effects_blocks(robot, found, data_hash);
    auto read_back = parse_robot_file(text, robot.path, error);
    if (!read_back && error.find("posterior.kind") != std::string::npos) {
      error.clear();
      text = with_filter(text);
      read_back = parse_robot_file(text, robot.path, error);
    }
    return read_back != nullptr;
  } catch (const toml::parse_error& problem) {
    error = robot.path + ": " + std::string(problem.description());
    return false;
  }
}

}  // namespace tiller::tools::gap
