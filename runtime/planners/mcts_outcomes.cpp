#include "planners/mcts_outcomes.hpp"

#include <cmath>

#include "rollout/rollout.hpp"

namespace tiller {
namespace {

constexpr double kApart = 6.0;  // standard deviations
constexpr double kLeastVariance = 1e-30;
constexpr double kHalfTurn = 3.14;  // differences below need no wrapping

}  // namespace

void Outcomes::lay_out(Arena& arena, const tiller_config_t& config, std::uint32_t leaves, std::uint32_t knots) {
  if (!are_seen(config)) return;
  config_ = &config;
  knots_ = knots;
  particles_ = config.planner.particles;
  count_ = config.measurement_count;
  reading_ = arena.take<float>(std::size_t{leaves} * knots * count_ * particles_);
}

const float* Outcomes::readings(std::uint32_t leaf, std::uint32_t knot) const {
  return reading_ + (std::size_t{leaf} * knots_ + knot) * count_ * particles_;
}

void Outcomes::record(std::uint32_t leaf, std::uint32_t knot, std::uint32_t hypothesis, const float* state,
                      std::uint32_t stride) {
  float* to = const_cast<float*>(readings(leaf, knot));
  for (std::uint32_t y = 0; y < count_; ++y)
    to[y * particles_ + hypothesis] = state[std::size_t{config_->measured_state[y]} * stride];
}

void Outcomes::fill_inverse_variance(double ahead_s, double* inverse_variance) const {
  for (std::uint32_t y = 0; y < count_; ++y) {
    const double sensor = config_->measurement_sd[y], process = config_->process_sd[config_->measured_state[y]];
    inverse_variance[y] = 1.0 / std::fmax(sensor * sensor + process * process * ahead_s, kLeastVariance);
  }
}

double Outcomes::distance_squared(const float* readings, const double* inverse_variance, std::uint32_t i,
                                  std::uint32_t j) const {
  double sum = 0.0;
  for (std::uint32_t y = 0; y < count_; ++y) {
    const float* reading = readings + std::size_t{y} * particles_;
    double d = static_cast<double>(reading[i]) - static_cast<double>(reading[j]);
    if (std::fabs(d) > kHalfTurn) d = state_difference(*config_->model, config_->measured_state[y], d, 0.0);
    sum += d * d * inverse_variance[y];
  }
  return sum;
}

std::uint32_t Outcomes::partition(std::uint32_t leaf, std::uint32_t knot, double ahead_s, std::uint64_t hypotheses,
                                  std::uint64_t* groups) const {
  const float* const seen = readings(leaf, knot);
  double inverse_variance[TILLER_MAX_MEASUREMENTS];
  fill_inverse_variance(ahead_s, inverse_variance);
  std::uint32_t leader[kMostHypotheses], count = 0;
  for (std::uint64_t left = hypotheses; left != 0; left &= left - 1) {
    const std::uint32_t j = static_cast<std::uint32_t>(__builtin_ctzll(left));
    std::uint32_t nearest = count;
    double least = kApart * kApart;
    for (std::uint32_t g = 0; g < count; ++g) {
      const double d = distance_squared(seen, inverse_variance, leader[g], j);
      if (d >= least) continue;
      nearest = g;
      if (!(d < least)) break;  // not a number
      least = d;
    }
    if (nearest == count) {
      leader[count] = j;
      groups[count++] = 0;
    }
    groups[nearest] |= std::uint64_t{1} << j;
  }
  return count;
}

}  // namespace tiller
