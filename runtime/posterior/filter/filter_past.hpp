#pragma once

#include <cstdint>

#include "posterior/filter/filter_start.hpp"
#include "posterior/filter/filter_summary.hpp"
#include "posterior/filter/filter_window.hpp"

namespace tiller {

/// What filters that go over past transitions need.
struct RerunTools {
  const LaneFilter& filter;
  const FilterStart& start;
  const FilterParticles& particles;
  const FilterChunk* chunks;
};

/// The transitions that have left the window: a filter at each point of a design around the cloud goes on along the
/// window's start, and what it sees is kept in a summary.
class FilterPast {
 public:
  static FilterPast lay_out(Arena& arena, const tiller_config_t& config, std::uint32_t d, std::uint32_t states,
                            std::uint32_t effect_states);

  void clear();
  void forget(double keep) { summary_.forget(keep); }
  /// The oldest transitions leave until `keep` are left. Cost: points of the design a transition.
  void retire(FilterWindow& window, std::uint64_t keep, const RerunTools& tools);

  const FilterSummary& summary() const { return summary_; }
  /// The chunk's filters at the start of a window that is not exact.
  void begin_filters(const LaneFilter& filter, const FilterChunk& chunk) const;
  /// Transitions that left no trace: no finite step at any point.
  std::uint64_t lost() const { return lost_; }

 private:
  static constexpr std::uint32_t kLanes = FilterChunk::kLanes;

  void leave(FilterWindow& window, const RerunTools& tools);
  template <class Visit>
  void for_each_point_chunk(const RerunTools& tools, const Visit& visit) const;
  FilterRows point_lanes(std::uint32_t at) const;
  void begin_points(const RerunTools& tools);
  void step_points(const Observation& seen, const RerunTools& tools);
  bool mend_points();
  double* log_variance() const { return innovation_ + std::size_t{ny_} * summary_.design().points(); }

  FilterSummary summary_;
  std::uint32_t nf_ = 0, ns_ = 0, ny_ = 0;
  double* innovation_ = nullptr;  // (ny + 1 x points) what leaves, at the design's points: normalised, log variance
  std::uint32_t leaves_ = 0;      // since the design was looked at
  std::uint64_t lost_ = 0;
};

}  // namespace tiller
