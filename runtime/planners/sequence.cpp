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

void limit_commands(const InputLimit* limits, const InputCones& cones, std::uint32_t inputs, const double* wish,
                    double* last) {
  double u[TILLER_MAX_INPUTS], step[TILLER_MAX_INPUTS] = {};
  for (std::uint32_t i = 0; i < inputs; ++i) {
    u[i] = limit_command(limits[i], wish[i], last[i]);
    step[i] = limits[i].step;
  }
  if (cones.count > 0) keep_cones(cones, inputs, last, step, u);
  for (std::uint32_t i = 0; i < inputs; ++i) last[i] = u[i];
}

void admit_commands(const InputLimit* limits, const InputCones& cones, std::uint32_t inputs, const double* last,
                    const double* fallback, double* out) {
  for (std::uint32_t i = 0; i < inputs; ++i)
    out[i] = admit_command(limits[i], last ? last[i] : fallback[i], fallback[i]);
  shrink_to_cones(cones, out);
}

void fill_grid(const KnotClock& clock, std::uint32_t* first_step, float* fraction) {
  const std::uint32_t steps = clock.steps(), last_segment = clock.knots - 2;
  std::uint32_t filled = 0;  // segments whose first step is known
  for (std::uint32_t t = 0; t < clock.horizon; ++t) {
    const std::uint32_t at = t * clock.spans() + clock.phase;  // in knots, times `steps`
    const std::uint32_t segment = at / steps < last_segment ? at / steps : last_segment;
    while (filled <= segment) first_step[filled++] = t;
    const double part = static_cast<double>(at - segment * steps) / steps;
    fraction[t] = static_cast<float>(part < 1.0 ? part : 1.0);
  }
  while (filled < clock.knots) first_step[filled++] = clock.horizon;
}

std::uint32_t advance_clock(KnotClock& clock, std::uint32_t periods) {
  const std::uint64_t at = clock.phase + std::uint64_t{periods} * clock.spans();
  clock.phase = static_cast<std::uint32_t>(at % clock.steps());
  return static_cast<std::uint32_t>(at / clock.steps());
}

void shift_knots(double* knots, std::uint32_t count, std::uint32_t gone) {
  for (std::uint32_t j = 0; j < count; ++j) knots[j] = knots[j + gone < count ? j + gone : count - 1];
}

namespace {

// Numbers' copy of lane_kernels.cpp, see there.
double knot_tangent(double a, double b) {
  const double steep = 3.0 * std::fmin(std::fmax(a, b), 0.0), flat = 3.0 * std::fmax(std::fmin(a, b), 0.0);
  return std::fmin(std::fmax(0.5 * (a + b), steep), flat);
}

struct Segment {
  double from, slope, square, cube, low, high;
  double at(double fraction) const {
    const double value = from + fraction * (slope + fraction * (square + fraction * cube));
    return std::fmin(std::fmax(value, low), high);
  }
};

/// Segment `j` of one input's knots.
Segment make_segment(const double* row, std::uint32_t count, std::uint32_t j, const double* before) {
  const double from = row[j], to = row[j + 1], secant = to - from;
  Segment s = {from, secant, 0.0, 0.0, std::fmin(from, to), std::fmax(from, to)};
  if (!before) return s;
  const double begin = knot_tangent(from - (j > 0 ? row[j - 1] : *before), secant);
  const double end = knot_tangent(secant, (j + 2 < count ? row[j + 2] : to) - to);
  s.slope = begin;
  s.square = 3.0 * secant - begin - begin - end;
  s.cube = begin + end - secant - secant;
  return s;
}

}  // namespace

void expand_sequence(const KnotGrid& grid, const InputLimit* limits, const InputCones& cones, const double* knots,
                     const double* start, float* sequence, double* command, const double* before, bool hold) {
  double u[TILLER_MAX_INPUTS], wish[TILLER_MAX_INPUTS];
  Segment line[TILLER_MAX_INPUTS];
  for (std::uint32_t i = 0; i < grid.inputs; ++i) u[i] = start[i];
  for (std::uint32_t segment = 0; segment + 1 < grid.knots; ++segment) {
    for (std::uint32_t i = 0; i < grid.inputs; ++i) {
      line[i] = make_segment(knots + i * grid.knots, grid.knots, segment, before ? before + i : nullptr);
      if (hold) line[i] = {line[i].from, 0.0, 0.0, 0.0, line[i].from, line[i].from};
    }
    for (std::uint32_t t = grid.first_step[segment]; t < grid.first_step[segment + 1]; ++t) {
      for (std::uint32_t i = 0; i < grid.inputs; ++i) wish[i] = line[i].at(static_cast<double>(grid.fraction[t]));
      limit_commands(limits, cones, grid.inputs, wish, u);
      for (std::uint32_t i = 0; i < grid.inputs; ++i) {
        sequence[t * grid.inputs + i] = static_cast<float>(u[i]);
        if (t == 0 && command) command[i] = u[i];
      }
    }
  }
}

}  // namespace tiller
