#include "tools/gap/result/result.hpp"

#include "effects/effect_info.hpp"

namespace tiller::tools::gap {

const EffectInfo& info_of(std::uint32_t kind) {
  static const EffectInfo changed = [] {
    EffectInfo info;
    info.name = "changed_parameter";
    info.help = "a parameter of the model has another value than before";
    return info;
  }();
  return kind == kChangedParameter ? changed : effect_info(kind);
}

const char* axis_name(Axis axis) {
  switch (axis) {
    case Axis::position: return "position";
    case Axis::velocity: return "velocity";
    case Axis::input: return "input";
    case Axis::input_rate: return "input_rate";
    case Axis::time: return "time";
    case Axis::input_sign_square: return "input_sign_square";
    default: return "none";
  }
}

const char* verdict_name(Verdict verdict) {
  switch (verdict) {
    case Verdict::no_gap: return "no_gap";
    case Verdict::named: return "named";
    case Verdict::ambiguous: return "ambiguous";
    case Verdict::partly: return "partly_explained";
    case Verdict::unnamed: return "unnamed";
    case Verdict::leading: return "leading";
    case Verdict::off_prior: return "off_prior";
    default: return "unfit";
  }
}

}  // namespace tiller::tools::gap
