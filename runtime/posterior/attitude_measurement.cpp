#include "posterior/attitude_measurement.hpp"

#include <algorithm>
#include <cmath>

#include "rollout/attitude.hpp"
#include "rollout/rollout.hpp"

namespace tiller {
namespace {

constexpr Quaternion<double> kNone = {1.0, 0.0, 0.0, 0.0};

/// f(k) for each measured value that is the first of a quaternion's four.
template <class F>
void for_measured(const tiller_config_t& config, F&& f) {
  const std::uint32_t mask = config.model->quaternion_mask;
  for (std::uint32_t k = 0; mask != 0 && k + 3 < config.measurement_count; ++k)
    if ((mask >> config.measured_state[k]) & 1u) f(k);
}

}  // namespace

void take_attitudes(const tiller_config_t& config, double* measured) {
  for_measured(config, [&](std::uint32_t k) {
    const Vector3<double> z = attitude_difference(read_quaternion(measured + k), kNone);
    write_quaternion({NAN, z.x, z.y, z.z}, measured + k);
  });
}

void drop_parts(const tiller_config_t& config, double* measured) {
  for_measured(config, [&](std::uint32_t k) {
    if (std::isnan(measured[k + 1] + measured[k + 2] + measured[k + 3])) std::fill(measured + k, measured + k + 4, NAN);
  });
}

double innovation_of(const tiller_config_t& config, const double* measured, std::uint32_t k, const double* state,
                     std::uint32_t stride, const MeasurementMap& reading) {
  const std::uint32_t i = config.measured_state[k], mask = config.model->quaternion_mask;
  if (((quaternion_states(mask) >> i) & 1u) == 0)
    return state_difference(*config.model, i, measured[k], reading.of(state[i * stride]));
  std::uint32_t part = 0;
  while (!((mask >> (i - part)) & 1u)) ++part;
  if (part == 0) return NAN;
  const double* z = measured + k - part;
  const Quaternion<double> seen = attitude_sum<double>(kNone, {z[1], z[2], z[3]});
  const Vector3<double> off = attitude_difference(seen, read_quaternion(state + (i - part) * stride, stride));
  return part == 1 ? off.x : part == 2 ? off.y : off.z;
}

}  // namespace tiller
