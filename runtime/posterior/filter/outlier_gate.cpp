#include "posterior/filter/outlier_gate.hpp"

#include "posterior/attitude_measurement.hpp"

namespace tiller {

bool OutlierGate::refuse(const LaneFilter& filter, const FilterChunk* chunks, const Cloud& cloud, double noise_scale,
                         double* measured) {
  constexpr std::uint32_t kLanes = FilterChunk::kLanes;
  const auto explained = [&](std::uint32_t k) {
    // the first particle usually ends the search
    for (std::uint32_t i = 0; i < cloud.n; ++i)
      if (cloud.weight[i] > 0.0 && explains(filter, chunks[i / kLanes], i % kLanes, measured, k, noise_scale))
        return true;
    return false;
  };
  bool any = false, left = false;
  for (std::uint32_t k = 0; k < filter.ny(); ++k) {
    if (std::isnan(measured[k])) continue;
    any = true;
    if (run_[k] >= kRun || explained(k)) {
      run_[k] = 0;
      left = true;
      continue;
    }
    measured[k] = NAN;
    ++run_[k];
    ++refused_;
  }
  drop_parts(filter.config(), measured);
  return any && !left;
}

}  // namespace tiller
