#pragma once

#include <string>
#include <vector>

#include "tools/gap/result/result.hpp"
#include "tools/logs/identify_data.hpp"

namespace tiller::tools::gap {

/// Adds a reason where one column in another unit or with another sign explains nearly all of the forces that the model
/// leaves with every parameter that its priors allow.
/// `stop`: ends it without a reason, once set; nullable. Cost: on machines of more than kFewJoints joints, some hundred
/// rollouts of kMostUnitPoints points; on others, least_unexplained for each column and unit.
void check_units(const tiller_config_t& config, const std::vector<Grid>& grids, const std::string& paths,
                 const volatile int* stop, Result& result);

/// Least share of the forces' square that the model leaves with parameters that its priors allow: 0 for a perfect
/// model, about 1 for one that tells nothing. Cost: some ten times a rollout of the data for each parameter.
/// `stop` as above; `params`, nullable: those of the least.
double least_unexplained(const tiller_config_t& config, const std::vector<Grid>& grids,
                         const volatile int* stop = nullptr, std::vector<double>* best = nullptr);

}  // namespace tiller::tools::gap
