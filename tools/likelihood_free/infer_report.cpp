#include "tools/likelihood_free/infer_report.hpp"

#include <nlohmann/json.hpp>

#include "tools/base/interval_text.hpp"
#include "tools/base/json_number.hpp"
#include "tools/identify/coordinates.hpp"
#include "tools/identify/identify_method.hpp"
#include "tools/robot/posterior_file.hpp"
#include "tools/robot/units.hpp"

namespace tiller::tools {
namespace {

using nlohmann::json;

constexpr std::uint32_t kSamples = 512;

/// One parameter before and after.
struct Row {
  std::string name;
  bool fixed;
  double prior_low, prior_high, mean, sd, low, median, high;
};

std::vector<double> prior_rows(const tiller_config_t& config) {
  const Coordinates coordinates(config);
  std::vector<double> rows(std::size_t{kSamples} * config.param_count), v(coordinates.count());
  for (std::uint32_t k = 0; k < kSamples; ++k) {
    coordinates.draw(k, v.data());
    coordinates.to_params(v.data(), rows.data() + std::size_t{k} * config.param_count);
  }
  return rows;
}

std::vector<Row> rows_of(const RobotFile& robot, const Inferred& result) {
  const std::size_t np = robot.config.param_count;
  const std::vector<double> before = prior_rows(robot.config), equal(kSamples, 1.0 / kSamples);
  MethodIteration moments;
  weighted_moments(result.found.params, result.found.weight, np, moments);
  std::vector<Row> rows;
  for (std::size_t i = 0; i < np; ++i) {
    const auto after = [&](double q) { return weighted_quantile(result.found.params, result.found.weight, np, i, q); };
    rows.push_back({robot.params[i], robot.config.priors[i].kind == tiller_prior_fixed,
                    weighted_quantile(before, equal, np, i, 0.05), weighted_quantile(before, equal, np, i, 0.95),
                    moments.mean[i], moments.sd[i], after(0.05), after(0.5), after(0.95)});
  }
  return rows;
}

json samples_json(const RobotFile& robot, const std::vector<double>& rows) {
  const std::size_t np = robot.config.param_count;
  json list = json::array();
  for (std::size_t s = 0; s * np < rows.size(); ++s) {
    json row = json::array();
    for (std::size_t i = 0; i < np; ++i)
      if (robot.config.priors[i].kind != tiller_prior_fixed) row.push_back(number(rows[s * np + i]));
    list.push_back(row);
  }
  return list;
}

json rounds_json(const Inferred& result) {
  json list = json::array();
  for (const MethodIteration& i : result.found.history)
    list.push_back({{"mean", numbers(i.mean)},
                    {"sd", numbers(i.sd)},
                    {"effective_samples", number(i.effective_samples)},
                    {"discrepancy", number(i.discrepancy)},
                    {"smallest_discrepancy", number(i.best)}});
  return list;
}

}  // namespace

std::string infer_text(const InferFacts& facts, const Inferred& result) {
  const InferenceMethod& method = *find_inference_method(facts.options->method);
  std::string text = format("%s by %s, summary %s: %llu simulations of %zu pieces, %llu periods, %.3g s\n\n",
                            facts.file->robot.name.c_str(), method.name, facts.options->summary.c_str(),
                            static_cast<unsigned long long>(result.found.simulations), facts.pieces,
                            static_cast<unsigned long long>(result.found.transitions), facts.seconds);
  text += format("  %-26s %21s %10s %9s %21s\n", "parameter", "prior 5 .. 95 %", "mean", "sd", "90 % interval");
  for (const Row& row : rows_of(facts.file->robot, result))
    text += row.fixed ? format("  %-26s %21s %10.4g\n", row.name.c_str(), "known", row.mean)
                      : format("  %-26s %21s %10s %9.2g %21s\n", row.name.c_str(),
                               interval_text(row.prior_low, row.prior_high).c_str(),
                               mean_text(row.mean, row.sd).c_str(), row.sd, interval_text(row.low, row.high).c_str());
  text += format("  effective sample size %.0f; mind: %s\n", result.found.effective_samples, method.caveat);
  return text;
}

std::string infer_json(const InferFacts& facts, const Inferred& result) {
  const InferenceMethod& method = *find_inference_method(facts.options->method);
  const RobotFile& robot = facts.file->robot;
  const Words units = parameter_units(robot.config, robot.params);
  json params = json::array();
  std::size_t at = 0;
  for (const Row& row : rows_of(robot, result)) {
    params.push_back({{"name", row.name}, {"unit", units[at++]}, {"fixed", row.fixed}, {"mean", number(row.mean)}});
    if (row.fixed) continue;
    json& p = params.back();
    p["sd"] = number(row.sd);
    p["median"] = number(row.median);
    p["interval_90"] = {number(row.low), number(row.high)};
    p["prior"] = {{"interval_90", {number(row.prior_low), number(row.prior_high)}}};
  }
  const std::vector<double> draws = resample(result.found.params, result.found.weight, robot.config.param_count);
  const json out = {{"tiller", tiller_version()},
                    {"simulator", robot.name},
                    {"simulator_file", facts.file->path},
                    {"command", facts.file->setup.command},
                    {"period_s", robot.config.period_s},
                    {"method", {{"name", method.name}, {"citation", method.citation}, {"caveat", method.caveat}}},
                    {"summary", facts.options->summary},
                    {"simulations", result.found.simulations},
                    {"failed", result.found.diverged},
                    {"pieces", facts.pieces},
                    {"periods", result.found.transitions},
                    {"seconds", number(facts.seconds)},
                    {"effective_samples", number(result.found.effective_samples)},
                    {"warnings", result.warnings},
                    {"logs", facts.logs},
                    {"parameters", params},
                    {"rounds", rounds_json(result)},
                    {"samples", samples_json(robot, draws)},
                    {"prior_samples", samples_json(robot, prior_rows(robot.config))}};
  return out.dump(1) + "\n";
}

bool write_inferred_posterior(const std::string& path, const RobotFile& robot, const Inferred& result,
                              std::string& error) {
  const std::vector<double> draws = resample(result.found.params, result.found.weight, robot.config.param_count);
  StoredPosterior stored = store_posterior(robot.config, robot.params, {draws, {}});
  stored.robot = robot.name;
  stored.transitions = result.found.transitions;
  stored.effective_samples = result.found.effective_samples;
  stored.noise_scale = stored.exponent = 1.0;  // no method here knows of either
  return save_posterior(path, stored, error);
}

}  // namespace tiller::tools
