#pragma once

#include <string>

#include "tools/identify/method.hpp"

namespace tiller::tools {

/// Whether Python has what the methods need (python/tiller/labs); else a sentence that tells how it gets there. Python
/// is asked once a process.
bool laboratory_is_ready(std::string& error);

/// True with a sentence in `error` where a step from a measured state cannot be simulated: an effect with memory has a
/// state that no log shows.
bool refuse_hidden_states(const tiller_config_t& config, std::string& error);

/// Fits by a method of methods.def other than the posterior. The laboratory (python/tiller/labs/methods) proposes
/// parameters and weighs them in a process of its own; simulated is here, by the rollout kernel, where the logs are. A
/// process that has ended one fit serves the next. False with a sentence in `error`. Same problem, same bits on one
/// machine. Any thread. Cost: options.simulations times the transitions of the grids, and a second for the first fit.
bool run_in_laboratory(const std::string& method, const MethodProblem& problem, MethodResult& result,
                       std::string& error);

}  // namespace tiller::tools
