#include "tools/robot/prior_edge.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

#include "effects/effect_info.hpp"
#include "posterior/prior.hpp"
#include "tools/base/json_number.hpp"
#include "tools/robot/units.hpp"

namespace tiller::tools {
namespace {

constexpr double kZone = 0.02;    // of the prior, next to a bound
constexpr double kShare = 0.3;    // of the posterior, in the zone
constexpr double kRise = 0.4;     // half of the draws over nine tenths of them, by their distance from the bound
constexpr double kNotTold = 0.5;  // the same, of a bound that may well be the truth
constexpr double kTail = 0.005;   // of the prior

/// The draws in an order, with the share of the weight up to and with each.
class Ordered {
 public:
  Ordered(std::vector<double> values, const std::vector<double>& weight) : value_(std::move(values)) {
    std::vector<std::size_t> order(value_.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return value_[a] < value_[b]; });
    std::vector<double> sorted;
    double sum = 0;
    for (const std::size_t i : order) {
      sorted.push_back(value_[i]);
      below_.push_back(sum += weight.empty() ? 1.0 : weight[i]);
    }
    for (double& share : below_) share /= sum;
    value_ = std::move(sorted);
  }
  double quantile(double u) const {
    const auto at = std::lower_bound(below_.begin(), below_.end(), u) - below_.begin();
    return value_[std::min(static_cast<std::size_t>(at), value_.size() - 1)];
  }
  double share_up_to(double value) const {
    const auto at = std::upper_bound(value_.begin(), value_.end(), value) - value_.begin();
    return at == 0 ? 0.0 : below_[static_cast<std::size_t>(at) - 1];
  }

 private:
  std::vector<double> value_, below_;
};

/// `v` in the parameter's coordinate.
bool piles_up(const tiller_prior_t& prior, const PriorEdge& edge, const std::vector<double>& v,
              const std::vector<double>& weight) {
  const bool low = edge.side == EdgeSide::low;
  const double bound = low ? coordinate_low(prior) : coordinate_high(prior);
  if (!std::isfinite(bound)) return false;
  std::vector<double> distance = v;
  for (double& at : distance) at = std::max(0.0, low ? at - bound : bound - at);
  const Ordered ordered(std::move(distance), weight);
  const double zone = std::fabs(prior_quantile(prior, low ? kZone : 1.0 - kZone) - bound);
  const double rise = edge.by_physics ? kNotTold : kRise;
  return ordered.share_up_to(zone) > kShare && ordered.quantile(0.5) <= rise * ordered.quantile(0.9);
}

bool has_tails(const tiller_prior_t& prior) {
  return prior.kind == tiller_prior_normal || prior.kind == tiller_prior_log_normal;
}

PriorEdge edge_at(const tiller_prior_t& prior, const PhysicalRange& physical, bool low) {
  const double bound = low ? prior.low : prior.high;
  return {low ? EdgeSide::low : EdgeSide::high, true, low ? bound <= physical.least : bound >= physical.most, bound};
}

const char* side_name(const PriorEdge& edge) { return edge.side == EdgeSide::low ? "lower" : "upper"; }

}  // namespace

PhysicalRange physical_range(const tiller_config_t& config, const Words& names, std::uint32_t i) {
  PhysicalRange range;
  if (i < config.model->param_count) {
    range.least = config.priors[i].low == 0 ? 0.0 : least_of_unit(names[i]);
    return range;
  }
  std::uint32_t first = config.model->param_count;
  for (std::uint32_t e = 0; e < config.effect_count; ++e) {
    const EffectInfo& info = effect_info(config.effects[e].kind);
    const auto count = static_cast<std::uint32_t>(info.param_count);
    if (i < first + count) return {info.params[i - first].low, info.params[i - first].high};
    first += count;
  }
  return range;
}

PriorEdge find_prior_edge(const tiller_prior_t& prior, const PhysicalRange& physical, const std::vector<double>& values,
                          const std::vector<double>& weight) {
  if (prior.kind == tiller_prior_fixed || values.empty()) return {};
  std::vector<double> v = values;
  for (double& at : v) at = to_coordinate(prior, at);
  for (const bool low : {true, false}) {
    const PriorEdge edge = edge_at(prior, physical, low);
    if (piles_up(prior, edge, v, weight)) return edge;
  }
  if (!has_tails(prior)) return {};
  const double median = Ordered(std::move(v), weight).quantile(0.5);
  const double low = prior_quantile(prior, kTail), high = prior_quantile(prior, 1.0 - kTail);
  if (median < low) return {EdgeSide::low, false, false, from_coordinate(prior, low)};
  if (median > high) return {EdgeSide::high, false, false, from_coordinate(prior, high)};
  return {};
}

std::vector<PriorEdge> find_prior_edges(const tiller_config_t& config, const Words& names, const Particles& posterior) {
  const std::size_t np = config.param_count, n = posterior.params.size() / std::max<std::size_t>(np, 1);
  std::vector<PriorEdge> edges(np);
  std::vector<double> values(n);
  for (std::uint32_t i = 0; i < np; ++i) {
    for (std::size_t k = 0; k < n; ++k) values[k] = posterior.params[k * np + i];
    edges[i] = find_prior_edge(config.priors[i], physical_range(config, names, i), values, posterior.weight);
    if (config.prior_mixture && !edges[i].at_bound) edges[i] = {};
  }
  return edges;
}

std::string edge_text(const std::string& name, const PriorEdge& edge) {
  if (edge.side == EdgeSide::none) return "";
  const std::string value = format("%.4g", edge.bound);
  if (!edge.at_bound)
    return name + (edge.side == EdgeSide::low ? " below " : " above ") + value +
           ", beyond 99.5 % of its prior: widen "
           "the prior";
  if (!edge.by_physics) return name + " at its " + side_name(edge) + " bound " + value + ": widen the prior";
  return name + " at " + value + ", its bound by physics" + (edge.bound == 0 ? ": the data show none of it" : "");
}

nlohmann::json edge_json(const std::string& name, const PriorEdge& edge) {
  if (edge.side == EdgeSide::none) return nullptr;
  return {{"at", std::string(side_name(edge)) + (edge.at_bound ? " bound" : " tail")},
          {"value", number(edge.bound)},
          {"by", edge.by_physics ? "physics" : "prior"},
          {"text", edge_text(name, edge)}};
}

}  // namespace tiller::tools
