#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "tiller/tiller.h"

namespace tiller::tools {

/// Predictions of half a horizon ahead, kept until the tick that they are about. Nothing is allocated after the
/// constructor.
class Foresight {
 public:
  /// Periods ahead for a horizon of so many.
  static std::uint32_t steps_ahead(std::uint32_t horizon) { return std::max(1u, horizon / 2); }

  Foresight(std::uint32_t horizon, std::uint32_t states)
      : ahead_(steps_ahead(horizon)), slots_(ahead_ + kMostLead + 1) {
    for (Slot& slot : slots_) slot.mean.resize(states), slot.sd.resize(states);
  }

  /// After a tick: takes the controller's prediction, if the tick has made a plan.
  void look(const tiller_t* controller, const tiller_info_t& info) {
    if (info.plans == plans_ || info.plan_lead > kMostLead) return;
    plans_ = info.plans;
    const std::uint64_t due = info.ticks + ahead_ + info.plan_lead;
    Slot& slot = slots_[due % slots_.size()];
    const tiller_status_t status = tiller_get_prediction(controller, ahead_, slot.mean.data(), slot.sd.data());
    slot.due = status == tiller_status_ok ? due : 0;
  }

  /// What was foreseen of the tick that `info` is about, (nx) each; false if nothing was.
  bool recall(const tiller_info_t& info, double* mean, double* sd) const {
    const Slot& slot = slots_[info.ticks % slots_.size()];
    if (slot.due != info.ticks) return false;
    std::copy(slot.mean.begin(), slot.mean.end(), mean);
    std::copy(slot.sd.begin(), slot.sd.end(), sd);
    return true;
  }

 private:
  static constexpr std::uint32_t kMostLead = 64;  // periods; whoever foresees later than that foresees nothing here
  struct Slot {
    std::uint64_t due = 0;  // ticks are counted from 1
    std::vector<double> mean, sd;
  };
  std::uint32_t ahead_;
  std::uint64_t plans_ = 0;
  std::vector<Slot> slots_;  // by due tick
};

}  // namespace tiller::tools
