#include "tools/links/latency_watch.hpp"

#include "tools/base/text.hpp"

namespace tiller::tools {

void LatencyWatch::note(std::uint32_t told_us, double seen_us) {
  if (done_) return;
  told_ = told_ || told_us != 0;
  sum_us_ += seen_us;
  ++count_;
}

std::string LatencyWatch::news(bool can_tell) {
  if (done_ || count_ < kMeanOver) return "";
  done_ = true;
  const double seen_us = sum_us_ / count_, share = seen_us / period_us_;
  if (told_ || share < kNoticeable) return "";
  return format(
             "measurements do not tell when their commands take hold (command_latency_us): %.2f ms from stamp to "
             "departure are accounted for, %.1f %% of the period, but not the command's way to the motor. Where that "
             "is more than %.0f %%, parameters leave their intervals: ",
             1e-3 * seen_us, 100 * share, 100 * kNoticeable) +
         (can_tell ? "let the plant fill it in (docs/guide/lcm.md)"
                   : "CAN frames cannot tell it, an effect input_delay with a prior learns it (docs/guide/can.md)");
}

}  // namespace tiller::tools
