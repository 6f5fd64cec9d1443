#include "bench/learned/dynamics_export.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

#include "tools/base/output_file.hpp"

namespace tiller::bench {
namespace {

using Json = nlohmann::ordered_json;

/// JSON has no NaN: null.
Json column(const std::vector<double>& values) {
  Json out = Json::array();
  for (const double v : values) out.push_back(std::isfinite(v) ? Json(v) : Json());
  return out;
}
Json columns(const std::vector<std::vector<double>>& rows) {
  Json out = Json::array();
  for (const std::vector<double>& row : rows) out.push_back(column(row));
  return out;
}
Json runs(const std::vector<Series>& all, bool truth) {
  Json out = Json::array();
  for (const Series& series : all) {
    Json run;
    run["measured"] = columns(series.measured);
    run["input"] = columns(series.input);
    if (truth) run["truth"] = columns(series.truth);
    out.push_back(run);
  }
  return out;
}

}  // namespace

bool export_world(const World& world, double period_s, double before_sigma, const std::string& path,
                  std::string& error) {
  Json json;
  json["states"] = world.states;
  json["measured"] = world.measured;
  json["inputs"] = world.inputs;
  json["period_s"] = period_s;
  json["sensor_sd"] = world.sensor_sd;
  json["before_sigma"] = before_sigma;
  json["work"] = runs(world.work, false);
  json["score"] = runs(world.score, true);
  return tools::replace_file(path, json.dump() + "\n", error);
}

}  // namespace tiller::bench
