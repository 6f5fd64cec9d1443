#pragma once

#include <map>
#include <string>
#include <vector>

#include "sim/mechanisms/mechanism.hpp"
#include "sim/mechanisms/options.hpp"

namespace tiller::sim {

/// Refuses options that the mechanism cannot honour. True: every name is known, every number usable; else
/// error says which is not and what would be. Checked in one place so that the plant can trust its options.
bool check_options(const PlantOptions& options, const MechanismInfo& info, std::string& error);

/// Indices of the states that sensors measure.
std::vector<std::size_t> measured_states(const PlantOptions& options, const MechanismInfo& info);

/// Index of the joint, command or sensor that the effect acts on; an empty port means the actuated one, or the first
/// sensor. -1: none of that name.
int find_port(const HiddenEffect& effect, const PlantOptions& options, const MechanismInfo& info);

/// All parameters: the defaults, then what the options say.
std::map<std::string, double> merged_parameters(const PlantOptions& options, const MechanismInfo& info);

}  // namespace tiller::sim
