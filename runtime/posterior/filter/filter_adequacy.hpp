#pragma once

#include <cstdint>

#include "posterior/adequacy.hpp"
#include "posterior/filter/filter_start.hpp"
#include "posterior/filter/response.hpp"
#include "posterior/posterior.hpp"

namespace tiller {

/// Whether the model explains what the filters see: what the adequacy test is fed with, and when its alarm is a change
/// of the robot.
class FilterAdequacy {
 public:
  /// A posterior that has only begun, and has not taken all of its data in yet, predicts with a bias that is its own.
  static constexpr std::uint32_t kEarly = 64;

  /// Null where the configuration does not ask for it.
  static FilterAdequacy* lay_out(Arena& arena, const tiller_config_t& config, const DisturbanceStates& disturbances);

  const AdequacyTest* test() const { return test_; }
  void clear();
  void reset();
  /// The state estimate starts again.
  void begin();
  /// The posterior starts again.
  void restart();

  /// After the prediction and before the correction, with what the chunks predict.
  void test_innovation(const LaneFilter& filter, const FilterChunk* chunks, const FilterParticles& particles,
                       const Observation& seen, double noise_scale, bool tempered);
  /// After the tick, of a posterior that is not tempered: whether a force that the model lacks goes with the velocity
  /// or its sign (friction_evidence.cpp). Not on trial, when it is open whether the null explains the data at all.
  void test_friction(const FilterParticles& particles, const ScaleEvidence& evidence, const FilterStart& start,
                     double elapsed_s);
  /// After test_innovation(): the alarm says that the robot has changed.
  bool sees_change();

 private:
  void respond(const LaneFilter& filter, const FilterChunk* chunks, const FilterParticles& particles,
               const Observation& seen, const double* speed, const double* place, Innovation& now);

  AdequacyTest* test_ = nullptr;
  DisturbanceResponse* response_ = nullptr;
  double* scratch_ = nullptr;               // (nx + nx * nx + nx * nu x kLanes)
  std::uint32_t trial_ = 0;                 // ticks left of kTrial, begun again by every alarm
  std::uint32_t wait_ = 0, next_wait_ = 0;  // ticks until an alarm is a change again; after the next change
  std::uint32_t early_ = 0;                 // ticks left in which a tempered posterior is not tested
};

}  // namespace tiller
