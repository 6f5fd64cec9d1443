#pragma once

#include <string>

#include "sim/mechanism.hpp"
#include "sim/options.hpp"

namespace tiller::sim {

/// Refuses options that the mechanism cannot honour. True: every name is known, every number usable; else
/// error says which is not and what would be. Checked in one place so that the plant can trust its options.
bool check_options(const PlantOptions& options, const MechanismInfo& info, std::string& error);

/// Index of the joint or command that the effect acts on; an empty port means the actuated one. -1: none of
/// that name.
int find_port(const HiddenEffect& effect, const MechanismInfo& info);

/// All parameters: the defaults, then what the options say.
std::map<std::string, double> merged_parameters(const PlantOptions& options, const MechanismInfo& info);

}  // namespace tiller::sim
