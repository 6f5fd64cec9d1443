#pragma once

#include <optional>
#include <string>

#include "effects/effect_info.hpp"
#include "tools/base/text.hpp"
#include "tools/base/unit_names.hpp"

namespace tiller::tools {

/// The unit of an effect's parameter at a port: of the catalogue's "N or N m" the first where the port slides, the
/// second where it turns; "1" without a dimension.
std::string unit_of_effect(const EffectInfo& info, int param, std::uint32_t port, const tiller_model_t& model);

/// Of every parameter of the configuration (param_count), called `names`: the model's, then each effect's.
Words parameter_units(const tiller_config_t& config, const Words& names);

/// The port of an effect by its name: the joint's, the input's or the state's, "all" (TILLER_EVERY_PORT); nothing where
/// the model has none of that name.
std::optional<std::uint32_t> find_port(const EffectInfo& info, const tiller_model_t& model, const std::string& name);
/// What find_port() knows.
Words port_names(const EffectInfo& info, const tiller_model_t& model);

/// Whether an effect makes the input a goal of its joint's position: then it is no force.
bool is_goal(const tiller_config_t& config, std::uint32_t input);

/// Physical bounds of a parameter of the model, by its name: masses, inertias and lengths are not negative.
double least_of_unit(const std::string& name);

}  // namespace tiller::tools
