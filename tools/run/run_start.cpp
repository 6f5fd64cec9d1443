#include "tools/run/run_start.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "rollout/rollout.hpp"

namespace tiller::tools {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kStandsFor_s = 0.5;

}  // namespace

bool RunStart::wait_for_first(double patience_s, Sensed& sensed, std::string& error) {
  const auto until = Clock::now() + std::chrono::duration<double>(patience_s);
  const auto tell = Clock::now() + std::chrono::seconds(1);
  bool told = false;
  do {
    sensed = link_.wait(stop_.flag());
    if (sensed.fresh) return true;
    if (!told && Clock::now() > tell) {
      const std::string news = link_.news();
      progress_.say("waiting for the first measurement ..." + (news.empty() ? "" : " " + news));
    }
    told = told || Clock::now() > tell;
  } while (stop_.flag() == 0 && Clock::now() < until);
  error = stop_.flag() != 0 ? "interrupted before the first measurement" : nothing_came(patience_s, sensed.fault);
  return false;
}

std::string RunStart::nothing_came(double patience_s, tiller_status_t fault) const {
  const std::string why = fault == tiller_status_ok ? "" : std::string(tiller_status_text(fault)) + "; ";
  const std::string counted = link_.counters();
  const std::string& kind = robot_.transport.kind;
  const std::string serve = kind.empty() ? "lcm" : kind == "socketcan" ? "can" : kind;
  return why + format("no measurement within %.0f s", patience_s) + (counted.empty() ? "" : " (" + counted + ")") +
         "; start the robot first, e.g. `tiller sim " + robot_.path + " --serve " + serve +
         "`, and compare [transport]";
}

bool RunStart::stands_at_start(const tiller_measurement_t& measurement) const {
  const tiller_config_t& config = robot_.config;
  double seen[TILLER_MAX_STATES];
  std::copy_n(config.initial_state, config.model->state_count, seen);
  for (std::uint32_t i = 0; i < config.measurement_count; ++i) seen[config.measured_state[i]] = measurement.value[i];
  state_differences(*config.model, seen, config.initial_state, seen);
  for (std::uint32_t i = 0; i < config.measurement_count; ++i) {
    const std::uint32_t state = config.measured_state[i];
    const double most = 4 * std::hypot(config.initial_state_sd[state], config.measurement_sd[i]);
    if (!(std::fabs(seen[state]) <= most)) return false;
  }
  return true;
}

bool RunStart::wait_for_start(Sensed& sensed, std::string& error) {
  const tiller_safety_config_t& safety = robot_.config.safety;
  tiller_command_t safe{};
  safe.state = tiller_state_standby;
  std::copy(std::begin(safety.safe_command), std::end(safety.safe_command), safe.value);
  std::int64_t since_us = -1;
  bool told = false;
  while (stop_.flag() == 0) {
    if (sensed.fault != tiller_status_ok) {
      error = "waiting for the start: " + std::string(tiller_status_text(sensed.fault));
      return false;
    }
    if (sensed.fresh) {
      if (!stands_at_start(sensed.measurement))
        since_us = -1;
      else if (since_us < 0)
        since_us = sensed.now_us;
      if (since_us >= 0 && 1e-6 * static_cast<double>(sensed.now_us - since_us) >= kStandsFor_s) return true;
      if (since_us < 0 && !told) progress_.say("put the robot back to its start ([start] of the robot file) ...");
      told = told || since_us < 0;
    }
    safe.stamp_us = sensed.now_us;
    safe.sequence = sensed.measurement.sequence;
    (void)link_.send(safe);
    sensed = link_.wait(stop_.flag());
  }
  error = "interrupted before the robot was back at its start";
  return false;
}

}  // namespace tiller::tools
