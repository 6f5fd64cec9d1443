#pragma once

// What tasks with exact posteriors are made of, for those beside accuracy_tasks().

#include <functional>
#include <initializer_list>
#include <vector>

#include "harness/accuracy/accuracy_tasks.hpp"

namespace tiller::bench {

/// A task of `model` with every state measured, one prior for each parameter (those of the effects behind the model's),
/// and the nominal noise of step_rms. Semi-implicit Euler, one step of 20 ms, no excitation: the caller's to change.
AccuracyTask measured_task(const char* name, const tiller_model_t& model,
                           std::initializer_list<tiller_effect_t> effects, std::initializer_list<tiller_prior_t> priors,
                           std::initializer_list<double> step_rms);
/// Sets the period, and the nominal noise that goes with it.
void set_period(AccuracyTask& task, double period_s);

/// Writes the input u (nu) of a tick in state x (nx).
using CommandSource = std::function<void(std::uint32_t tick, const double* x, double* u)>;

/// One run of the task at `sigma` under inputs from elsewhere.
Episode make_episode(const AccuracyTask& task, double sigma, std::uint32_t ticks, std::uint64_t seed,
                     const CommandSource& command);
/// measure_step_rms() under inputs from elsewhere; `commands` makes those of a seed.
std::vector<double> measure_step_rms(const AccuracyTask& task, std::uint32_t draws,
                                     const std::function<CommandSource(std::uint64_t seed)>& commands);

}  // namespace tiller::bench
