#pragma once

#include <cstdint>

#include "harness/accuracy/accuracy_tasks.hpp"
#include "tools/identify/method.hpp"

namespace tiller::bench {

/// A method with settings.
struct Contender {
  const char* label;
  const char* method;
  std::uint32_t iterations;
  double rollout_s;    // 0: the whole episode
  bool norms = false;  // of SimOpt: --l1 1 --scale
};

/// A method's fit to the first `ticks` transitions; ends the program where the method fails.
tools::MethodResult learn(const AccuracyTask& task, const Episode& episode, std::uint32_t ticks, double sigma,
                          std::uint64_t seed, const Contender& contender, std::uint32_t simulations);

/// The online posterior's particles after so many transitions, in the form of a method's result.
tools::MethodResult learn_online(const AccuracyTask& task, const Episode& episode, std::uint32_t ticks,
                                 std::uint64_t seed);

}  // namespace tiller::bench
