#include "tools/robot/prior_json.hpp"

#include <vector>

#include "tools/robot/units.hpp"

namespace tiller::tools {
namespace {

using nlohmann::json;

/// R R' of a root R (d x d), row by row.
json covariance_json(const double* root, std::size_t d) {
  json rows = json::array();
  for (std::size_t i = 0; i < d; ++i) {
    std::vector<double> row(d, 0.0);
    for (std::size_t j = 0; j < d; ++j)
      for (std::size_t k = 0; k < d; ++k) row[j] += root[i * d + k] * root[j * d + k];
    rows.push_back(row);
  }
  return rows;
}

}  // namespace

const char* prior_kind_name(std::uint32_t kind) {
  switch (kind) {
    case tiller_prior_uniform: return "uniform";
    case tiller_prior_normal: return "normal";
    case tiller_prior_log_normal: return "log_normal";
    default: return "fixed";
  }
}

json parameters_json(const tiller_config_t& config, const Words& names) {
  const Words units = parameter_units(config, names);
  json list = json::array();
  for (std::uint32_t i = 0; i < config.param_count; ++i) {
    const tiller_prior_t& p = config.priors[i];
    list.push_back({{"name", names[i]},
                    {"unit", units[i]},
                    {"kind", prior_kind_name(p.kind)},
                    {"numbers", {p.a, p.b, p.low, p.high}}});  // what is infinite becomes null
  }
  return list;
}

json mixture_json(const tiller_mixture_t* mixture) {
  if (!mixture) return nullptr;
  const std::size_t d = mixture->dimension;
  json list = json::array();
  for (std::size_t c = 0; c < mixture->components; ++c) {
    const double* mean = mixture->mean + c * d;
    list.push_back({{"weight", mixture->weight[c]},
                    {"mean", std::vector<double>(mean, mean + d)},
                    {"covariance", covariance_json(mixture->root + c * d * d, d)}});
  }
  return list;
}

}  // namespace tiller::tools
