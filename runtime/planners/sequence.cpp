#include "planners/sequence.hpp"

#include <cmath>

namespace tiller {

double limit_command(const InputLimit& limit, double wish, double last) {
  double u = std::fmin(std::fmax(wish, limit.low), limit.high);
  if (!(std::fabs(u - last) > limit.step)) return u;
  u = u > last ? last + limit.step : last - limit.step;
  // the sum is rounded; where that went outwards, the next number towards `last` is inside
  while (std::fabs(u - last) > limit.step) u = std::nextafter(u, last);
  return u;
}

double admit_command(const InputLimit& limit, double last, double fallback) {
  const double u = std::isnan(last) ? fallback : last;
  return std::fmin(std::fmax(std::isnan(u) ? 0.0 : u, limit.low), limit.high);
}

void fill_grid(std::uint32_t horizon, std::uint32_t knots, std::uint32_t* first_step, float* fraction) {
  // step t stands at t (knots - 1) / (horizon - 1); integers, so that a step on a knot is not lost to rounding
  const std::uint32_t spans = knots - 1, steps = horizon - 1;
  std::uint32_t filled = 0;  // segments whose first step is known
  for (std::uint32_t t = 0; t < horizon; ++t) {
    std::uint32_t segment = t * spans / steps;
    if (segment >= spans) segment = spans - 1;
    while (filled <= segment) first_step[filled++] = t;
    fraction[t] = static_cast<float>(static_cast<double>(t * spans - segment * steps) / steps);
  }
  while (filled < knots) first_step[filled++] = horizon;
}

void shift_knots(double* knots, std::uint32_t count, std::uint32_t horizon, std::uint32_t periods) {
  const double last = knots[count - 1];
  const double shift = static_cast<double>(periods) * (count - 1) / (horizon - 1);  // in knots
  for (std::uint32_t j = 0; j < count; ++j) {
    const double at = j + shift;
    const double whole = std::floor(at);
    // ascending j reads only at or ahead of what it writes
    if (whole + 1.0 >= count) {
      knots[j] = last;
    } else {
      const std::uint32_t k = static_cast<std::uint32_t>(whole);
      knots[j] = knots[k] + (knots[k + 1] - knots[k]) * (at - whole);
    }
  }
}

void expand_sequence(const KnotGrid& grid, const InputLimit* limits, const double* knots, const double* start,
                     float* sequence, double* command) {
  for (std::uint32_t i = 0; i < grid.inputs; ++i) {
    const double* row = knots + i * grid.knots;
    double u = start[i];
    for (std::uint32_t segment = 0; segment + 1 < grid.knots; ++segment)
      for (std::uint32_t t = grid.first_step[segment]; t < grid.first_step[segment + 1]; ++t) {
        const double wish = row[segment] + (row[segment + 1] - row[segment]) * static_cast<double>(grid.fraction[t]);
        u = limit_command(limits[i], wish, u);
        sequence[t * grid.inputs + i] = static_cast<float>(u);
        if (t == 0 && command) command[i] = u;
      }
  }
}

}  // namespace tiller
