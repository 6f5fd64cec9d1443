#include "tools/run/calibration.hpp"

#include "tools/base/interval_text.hpp"
#include "tools/robot/in_motion.hpp"

namespace tiller::tools {

std::string CalibrationNews::parameters_text(const tiller_info_t& info) const {
  std::string text;
  for (std::size_t i = 0; i < robot_.names.params.size(); ++i) {
    if (robot_.config.priors[i].kind == tiller_prior_fixed) continue;
    text += format("\n  %-24s %s +- %.2g, before +- %.2g", robot_.names.params[i].c_str(),
                   mean_text(info.param_mean[i], info.param_sd[i]).c_str(), info.param_sd[i], sd_before_[i]);
  }
  return text;
}

std::string CalibrationNews::of(const tiller_info_t& info) {
  if (ended_) return "";
  if (sd_before_.empty()) sd_before_.assign(info.param_sd, info.param_sd + TILLER_MAX_PARAMS);
  if (info.calibration_left > 0 && info.state == tiller_state_active && !began_) {
    began_ = true;
    first_tick_ = info.ticks;
    sd_before_.assign(info.param_sd, info.param_sd + TILLER_MAX_PARAMS);
    return "calibrating, the task comes after it";
  }
  if (!began_ || info.calibration_left > 0) return "";
  ended_ = true;
  if (!in_motion(info.state)) return "the calibration ended with motion";
  const double took_s = static_cast<double>(info.ticks - first_tick_) * robot_.config.period_s;
  return format("calibrated in %.1f s, the task begins", took_s) + parameters_text(info);
}

}  // namespace tiller::tools
