#pragma once

#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "tiller/tiller.h"
#include "tools/base/text.hpp"
#include "tools/robot/posterior_file.hpp"

namespace tiller::tools {

/// Where a posterior is held back by its prior, or contradicts it.
enum class EdgeSide { none, low, high };
struct PriorEdge {
  EdgeSide side = EdgeSide::none;
  bool at_bound = false;    ///< it piles up at a bound of the prior; else it lies in the prior's tail
  bool by_physics = false;  ///< nothing lies beyond the bound: a friction of 0, a mass of 0
  double bound = 0;         ///< in the parameter's unit; of a tail the quantile where it begins
};

/// Physical bounds of a parameter; infinite: none.
struct PhysicalRange {
  double least = -std::numeric_limits<double>::infinity(), most = std::numeric_limits<double>::infinity();
};

/// Of parameter i of a configuration whose parameters are called `names` (param_count): an effect's by the catalogue, a
/// model's mass, length or inertia by its unit. A model says nothing of the others (its frictions, its gains), but who
/// lets a prior begin at exactly 0 says that there is nothing below.
PhysicalRange physical_range(const tiller_config_t& config, const Words& names, std::uint32_t i);

/// Whether the posterior's draws `values` of one parameter (`weight` empty: all equal) stand on the edge of its prior.
///
/// At a bound: more than 30 % of the draws lie in the 2 % of the prior next to the bound, and their density rises up to
/// it: half of the draws are less than 0.4 times as far from the bound as nine tenths of them. A likelihood whose
/// optimum is inside by its own deviation gives 0.5, one whose optimum is the bound 0.41, one whose optimum lies far
/// beyond 0.30 (an exponential). So the first condition says that the data are sharp enough to be cut by the bound, the
/// second that they ask for more; a wide posterior whose truth happens to be near a bound meets neither.
///
/// In a tail (normal and log-normal priors): half of the draws lie beyond the prior's quantile of 0.5 or 99.5 %.
/// Nothing cuts there, but the prior draws the estimate back.
///
/// At a bound that is `physical` there is nothing to widen, and the truth may well be the bound itself: there 0.5 in
/// the place of 0.4 says that the data do not tell it from the bound.
PriorEdge find_prior_edge(const tiller_prior_t& prior, const PhysicalRange& physical, const std::vector<double>& values,
                          const std::vector<double>& weight);

/// Of every parameter of a configuration whose parameters are called `names` (param_count); none of fixed ones. With a
/// joint prior the bounds are looked at alone: they stay the robot file's, the tails are not.
std::vector<PriorEdge> find_prior_edges(const tiller_config_t& config, const Words& names, const Particles& posterior);

/// "mass_kg at its upper bound 0.15: widen the prior"; empty where there is no edge.
std::string edge_text(const std::string& name, const PriorEdge& edge);
/// {"at": "upper bound", "value": 0.15, "by": "prior" or "physics", "text": ...}; null where there is no edge.
nlohmann::json edge_json(const std::string& name, const PriorEdge& edge);

}  // namespace tiller::tools
