#pragma once

// The parts of a run in lockstep: random numbers, the true system, and a controller behind its C interface.

#include <cstdint>
#include <memory>
#include <new>
#include <random>
#include <string>
#include <vector>

#include "rollout/rollout.hpp"
#include "tiller/config.hpp"

namespace tiller::bench {

/// Uniform and normal numbers that every standard library makes alike.
class RandomStream {
 public:
  explicit RandomStream(std::uint64_t seed) : engine_(seed * 0x9e3779b97f4a7c15ull + 1) {}
  double uniform() { return (static_cast<double>(engine_() >> 11) + 0.5) * 0x1p-53; }
  double normal();

 private:
  std::mt19937_64 engine_;
};

/// The true system: the model itself at the true parameters, RK4 in double at ten steps a period.
class Plant {
 public:
  Plant(const tiller_config_t& c, const std::vector<double>& params);
  void advance(const double* u);
  /// A period's process noise: an acceleration that is white in time, of joints with a position.
  void disturb(RandomStream& random);
  void set_params(const std::vector<double>& params) { params_ = params; }
  /// The measured states with the sensors' noise.
  tiller_measurement_t measure(std::int64_t now_us, std::uint32_t sequence, RandomStream& random) const;
  double x[TILLER_MAX_STATES] = {};

 private:
  tiller::Config config_;
  StepSetup setup_;
  std::vector<double> params_;
};

/// A controller in a block of its own. A configuration that is refused ends the program, with the reason.
class LockstepController {
 public:
  LockstepController(const std::string& name, const tiller_config_t& config);
  tiller_t* get() const { return controller_; }

 private:
  struct AlignedFree {
    void operator()(void* p) const { ::operator delete (p, std::align_val_t{TILLER_ALIGNMENT}); }
  };
  std::unique_ptr<void, AlignedFree> memory_;
  tiller_t* controller_ = nullptr;
};

/// The task's cost of a state and an input: target, weights; no bounds.
double step_cost(const tiller_config_t& c, const double* x, const double* u);

}  // namespace tiller::bench
