#include <cinttypes>
#include <cstdio>
#include <filesystem>

#include "harness/gap_worlds/gap_worlds.hpp"
#include "tools/base/output_file.hpp"

namespace tiller::bench {
namespace {

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.17g", value);
  return text;
}

/// {"a": 1, "b": 2}
template <class Pairs>
std::string object(const Pairs& pairs) {
  std::string out = "{";
  for (const auto& [name, value] : pairs) out += (out.size() > 1 ? ", \"" : "\"") + name + "\": " + number(value);
  return out + "}";
}

std::string list(const std::vector<double>& values) {
  std::string out = "[";
  for (const double v : values) out += (out.size() > 1 ? ", " : "") + number(v);
  return out + "]";
}

}  // namespace

std::string series_csv(const World& world, const Series& series) {
  std::string out = "time_s";
  for (const std::string& name : world.measured) out += "," + name;
  for (const std::string& name : world.inputs) out += "," + name;
  out += "\n";
  for (std::size_t k = 0; k < series.time_s.size(); ++k) {
    char text[32];
    std::snprintf(text, sizeof text, "%.3f", series.time_s[k]);
    out += text;
    for (const auto& column : series.measured) out += "," + number(column[k]);
    for (const auto& column : series.input) out += "," + number(column[k]);
    out += "\n";
  }
  return out;
}

std::string sealed_json(const Sealed& answer, const std::string& name) {
  const WorldCase& w = answer.world;
  std::string out = "{\n  \"case\": \"" + name + "\",\n  \"plant\": \"" + w.plant + "\",\n  \"effects\": [";
  for (std::size_t i = 0; i < w.effects.size(); ++i) {
    out += std::string(i ? ",\n" : "\n") + "    {\"kind\": \"" + w.effects[i].kind + "\", \"port\": \"" +
           w.effects[i].port + "\", \"parameters\": " + object(w.effects[i].parameters) + "}";
  }
  std::vector<std::pair<std::string, double>> truth;
  for (std::size_t i = 0; i < answer.names.size(); ++i) truth.emplace_back(answer.names[i], answer.values[i]);
  out += "],\n  \"noise_sd\": " + number(w.noise_sd) + ",\n  \"excitation\": \"" + excitation_name(w.excitation) +
         "\",\n  \"encoder_step\": " + number(w.encoder_step) + ",\n  \"process_sd\": " + number(w.process_sd) +
         ",\n  \"seed\": " + std::to_string(w.seed) + ",\n  \"true_parameters\": " + object(truth) +
         ",\n  \"r\": " + number(answer.r) + ",\n  \"r_by_channel\": " + list(answer.r_by_channel) + "\n}\n";
  return out;
}

bool write_world(const World& world, const std::string& folder, const std::string& name, std::string& error) {
  namespace fs = std::filesystem;
  std::error_code failed;
  fs::create_directories(fs::path(folder) / "sealed", failed);
  if (failed) {
    error = folder + ": cannot be made: " + failed.message();
    return false;
  }
  const auto put = [&](const std::string& file, const std::string& bytes) {
    return tools::replace_file((fs::path(folder) / file).string(), bytes, error);
  };
  if (!put("robot.toml", world.robot_toml)) return false;
  for (const auto* group : {&world.work, &world.score}) {
    for (const Series& series : *group) {
      if (!put(series.name + ".csv", series_csv(world, series))) return false;
    }
  }
  return put("sealed/" + name + ".json", sealed_json(world.answer, name));
}

}  // namespace tiller::bench
