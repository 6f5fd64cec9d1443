#pragma once

#include <nlohmann/json.hpp>

#include "tiller/config.hpp"
#include "tools/base/text.hpp"

namespace tiller::tools {

/// "fixed", "uniform", "normal" or "log_normal": the words of a robot file.
const char* prior_kind_name(std::uint32_t kind);
/// Names, units and priors of the parameters (param_count), called `names`, as laboratories read them
/// (python/tiller/labs/problem.py).
nlohmann::json parameters_json(const tiller_config_t& config, const Words& names);
/// A joint prior in the place of their marginals: weight, mean and covariance of each component. Null where there is
/// none.
nlohmann::json mixture_json(const tiller_mixture_t* mixture);

}  // namespace tiller::tools
