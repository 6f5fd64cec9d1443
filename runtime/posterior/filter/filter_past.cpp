#include "posterior/filter/filter_past.hpp"

#include <cmath>
#include <cstring>

#include "rollout/attitude.hpp"

namespace tiller {

namespace {

/// Transitions that leave between two looks at whether the design still lies where the cloud is, which does not move
/// far within a few ticks.
constexpr std::uint32_t kLook = 8;

}  // namespace

FilterPast FilterPast::lay_out(Arena& arena, const tiller_config_t& config, std::uint32_t d, std::uint32_t states,
                               std::uint32_t effect_states) {
  FilterPast p;
  p.nf_ = states;
  p.ns_ = effect_states;
  p.ny_ = config.measurement_count;
  p.summary_ = FilterSummary::lay_out(arena, d, states, effect_states);
  p.innovation_ = arena.take<double>(std::size_t{p.ny_ + 1} * p.summary_.design().points());
  return p;
}

void FilterPast::clear() {
  summary_.clear();
  leaves_ = 0;
}

/// Filters from the polynomials, which do not keep a quaternion's length.
void FilterPast::begin_filters(const LaneFilter& filter, const FilterChunk& chunk) const {
  summary_.read_filters(kLanes, chunk.coordinate, kLanes, chunk.filter);
  for_quaternions(filter.quaternions(), [&](std::uint32_t first) {
    for (std::uint32_t l = 0; l < kLanes; ++l) {
      double* q = chunk.filter.state + first * chunk.filter.stride + l;
      write_quaternion(normalised(read_quaternion(q, chunk.filter.stride)), q, chunk.filter.stride);
    }
  });
}

void FilterPast::retire(FilterWindow& window, std::uint64_t keep, const RerunTools& tools) {
  while (window.size() > keep) leave(window, tools);
}

/// Points are worked on in the first chunk, kLanes at a time: visit(first point, chunk).
template <class Visit>
void FilterPast::for_each_point_chunk(const RerunTools& tools, const Visit& visit) const {
  const PolynomialDesign& design = summary_.design();
  const FilterChunk& chunk = tools.chunks[0];
  for (std::uint32_t at = 0; at < design.points(); at += kLanes) {
    for (std::uint32_t l = 0; l < kLanes; ++l) {
      double coordinate[kMaxCoordinates];
      for (std::uint32_t j = 0; j < tools.particles.cloud.d; ++j)
        coordinate[j] = design.at()[j * design.points() + at + l];
      tools.particles.place(chunk, l, coordinate);
    }
    visit(at, chunk);
  }
}

FilterRows FilterPast::point_lanes(std::uint32_t at) const {
  const FilterRows& f = summary_.filters();
  return {f.state + at, f.covariance + at, f.effect_state != nullptr ? f.effect_state + at : nullptr, f.stride};
}

void FilterPast::begin_points(const RerunTools& tools) {
  for_each_point_chunk(tools, [&](std::uint32_t at, const FilterChunk& chunk) {
    tools.start.begin_filters(tools.filter, chunk, point_lanes(at), {chunk.params, kLanes}, {chunk.law, kLanes});
  });
  summary_.fit_filters();
}

/// The oldest transition leaves: its innovations at the design's points go into the summary, the window's start moves
/// on. A new design has a filter at each point as the polynomials have it, or exact while the window is.
void FilterPast::leave(FilterWindow& window, const RerunTools& tools) {
  const bool look = ++leaves_ >= kLook;
  const PolynomialDesign& design = summary_.design();
  if (look) leaves_ = 0;
  if (!design.laid() || (look && !design.covers(tools.particles.cloud))) {
    summary_.centre_on(tools.particles.cloud);
    leaves_ = 0;
  }
  if (window.exact()) begin_points(tools);
  const Observation seen = window.at(window.begin());
  step_points(seen, tools);
  if (mend_points()) {
    if (seen.weight > 0.0) summary_.add(seen.weight, ny_, innovation_, log_variance());
    summary_.fit_filters();
  } else {
    ++lost_;
  }
  window.drop_oldest();
}

/// One transition at all points. Points that have no finite step keep their filters and are marked by a log variance
/// that is not a number.
void FilterPast::step_points(const Observation& seen, const RerunTools& tools) {
  const std::uint32_t points = summary_.design().points();
  Observation whole = seen;
  whole.weight = 1.0;
  for_each_point_chunk(tools, [&](std::uint32_t at, const FilterChunk& chunk) {
    chunk.clear_sums();
    tools.filter.step_own(chunk, whole, point_lanes(at));
    for (std::uint32_t k = 0; k < ny_; ++k)
      std::memcpy(innovation_ + k * points + at, chunk.normalised + k * kLanes, sizeof(double) * kLanes);
    const double *squared = chunk.sums + ScaleEvidence::kSquared * kLanes,
                 *logs = chunk.sums + ScaleEvidence::kLogs * kLanes;
    for (std::uint32_t l = 0; l < kLanes; ++l) log_variance()[at + l] = std::isfinite(squared[l]) ? logs[l] : NAN;
  });
}

/// Points without a finite step get what the innermost one has that took it. False where there is none: then the
/// transition leaves no trace.
bool FilterPast::mend_points() {
  const std::uint32_t points = summary_.design().points();
  const double* logs = log_variance();
  std::uint32_t inner = 0;
  while (inner < points && std::isnan(logs[inner])) ++inner;
  if (inner == points) return false;
  const FilterRows& f = summary_.filters();
  const auto copy = [&](double* data, std::uint32_t rows, std::uint32_t to) {
    for (std::uint32_t i = 0; i < rows; ++i) data[i * points + to] = data[i * points + inner];
  };
  for (std::uint32_t k = 0; k < points; ++k) {
    if (!std::isnan(logs[k])) continue;
    copy(f.state, nf_, k);
    copy(f.covariance, triangle_rows(nf_), k);
    copy(f.effect_state, ns_, k);
    copy(innovation_, ny_ + 1, k);
  }
  return true;
}

}  // namespace tiller
