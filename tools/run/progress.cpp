#include "tools/run/progress.hpp"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "tools/base/interval_text.hpp"

namespace tiller::tools {
namespace {

constexpr double kLineEvery_s = 0.5;
constexpr auto kDrawEvery = std::chrono::milliseconds(100);
constexpr int kBarWidth = 24;

/// A terminal that was stopped (Ctrl-S), or a pipe that nobody reads, must not hold up the run: what it does not take
/// at once is not shown.
bool stdout_takes() {
  pollfd out = {STDOUT_FILENO, POLLOUT, 0};
  return ::poll(&out, 1, 0) == 1 && (out.revents & POLLOUT) != 0;
}

std::string upper(std::string text) {
  for (char& c : text) c = static_cast<char>(c >= 'a' && c <= 'z' ? c - 'a' + 'A' : c);
  return text;
}

std::string time_text(double time_s, double end_s) {
  return end_s > 0 ? format("%6.2f / %.0f s", time_s, end_s) : format("%6.2f s", time_s);
}

std::string tick_text(const LoggedTick& tick, std::uint32_t deadline_us) {
  std::string text = format("%.2f ms", tick.tick_us / 1000);
  if (deadline_us > 0) text += format(" of %.1f ms", deadline_us / 1000.0);
  return text;
}

bool stands_by(const LoggedTick& tick) {
  return tick.info.state == tiller_state_init || tick.info.state == tiller_state_standby;
}

/// Where the posterior stands inside the prior's middle 90 %: "[...===|===...]".
std::string bar(const tiller_prior_t& prior, double q05, double q95, double mean) {
  double low = prior.low;
  double high = prior.high;
  if (prior.kind == tiller_prior_normal) {
    low = std::max(low, prior.a - 2 * prior.b);
    high = std::min(high, prior.a + 2 * prior.b);
  } else if (prior.kind == tiller_prior_log_normal) {
    low = std::max(low, prior.a * std::exp(-2 * prior.b));
    high = std::min(high, prior.a * std::exp(2 * prior.b));
  }
  const auto column = [&](double value) {
    const double share = (value - low) / (high - low);
    return std::isfinite(share) ? std::clamp(static_cast<int>(share * kBarWidth), 0, kBarWidth - 1) : 0;
  };
  std::string text(kBarWidth, '.');
  for (int i = column(q05); i <= column(q95); ++i) text[static_cast<std::size_t>(i)] = '=';
  text[static_cast<std::size_t>(column(mean))] = '|';
  return "[" + text + "]";
}

}  // namespace

Progress::Progress(const RobotFile& robot, Style style, double end_s, std::vector<double> true_params)
    : robot_(robot), style_(style), end_s_(end_s), true_params_(std::move(true_params)), sensors_(robot) {}

Progress::Style Progress::style_for_stdout(bool quiet) {
  if (quiet) return Style::silent;
  return isatty(STDOUT_FILENO) ? Style::block : Style::lines;
}

std::string Progress::line(const LoggedTick& tick) const {
  const tiller_info_t& info = tick.info;
  std::string text =
      time_text(tick.time_s, end_s_) + "  " + upper(tiller_state_name(static_cast<tiller_state_t>(info.state)));
  if (stands_by(tick)) {
    text += sensors_.line();
    if (tick.status != tiller_status_ok) text += std::string("  ") + tiller_status_name(tick.status);
    return text;
  }
  for (std::size_t i = 0; i < robot_.names.states.size(); ++i) {
    text += format("  %s %.3f", robot_.names.states[i].c_str(), info.state_mean[i]);
  }
  text += format("  cost %.4g", info.plan_cost);
  for (std::size_t i = 0; i < robot_.names.params.size(); ++i) {
    if (robot_.config.priors[i].kind == tiller_prior_fixed) continue;
    text += format("  %s %s +- %.2g", robot_.names.params[i].c_str(),
                   mean_text(info.param_mean[i], info.param_sd[i]).c_str(), info.param_sd[i]);
  }
  text += format("  ess %.0f", info.effective_samples);
  text += "  tick " + tick_text(tick, robot_.config.planner.deadline_us);
  if (tick.status != tiller_status_ok) text += std::string("  ") + tiller_status_name(tick.status);
  if (tick.log.status != tiller_status_ok) text += std::string("  log: ") + tiller_status_name(tick.log.status);
  return text;
}

std::string Progress::head(const LoggedTick& tick) const {
  const tiller_info_t& info = tick.info;
  std::string text = format("  time    %s   %-7s  %s", time_text(tick.time_s, end_s_).c_str(),
                            upper(tiller_state_name(static_cast<tiller_state_t>(info.state))).c_str(),
                            tick.status == tiller_status_ok ? "" : tiller_status_name(tick.status));
  if (tick.log.status != tiller_status_ok) text += std::string("  log: ") + tiller_status_name(tick.log.status);
  return text + "\n";
}

std::string Progress::block(const LoggedTick& tick) const {
  const tiller_info_t& info = tick.info;
  std::string text = head(tick);
  if (stands_by(tick)) return text + sensors_.block();
  text += "  state ";
  for (std::size_t i = 0; i < robot_.names.states.size(); ++i) {
    text += format("  %s %+.3f", robot_.names.states[i].c_str(), info.state_mean[i]);
  }
  text += "\n  input ";
  for (std::size_t i = 0; i < robot_.names.inputs.size(); ++i) {
    text += format("  %s %+.2f", robot_.names.inputs[i].c_str(), tick.entry.record.command.value[i]);
  }
  text += format("   cost %.4g\n", info.plan_cost);
  for (std::size_t i = 0; i < robot_.names.params.size(); ++i) {
    const tiller_prior_t& prior = robot_.config.priors[i];
    if (prior.kind == tiller_prior_fixed) continue;
    text += format("  %-24s %9.4g +- %-8.2g", robot_.names.params[i].c_str(), info.param_mean[i], info.param_sd[i]);
    text += bar(prior, tick.q05[i], tick.q95[i], info.param_mean[i]);
    if (i < true_params_.size() && std::isfinite(true_params_[i])) text += format("  true %.4g", true_params_[i]);
    text += "\n";
  }
  text += format("  effective samples %.0f of %u   tick %s\n", info.effective_samples,
                 robot_.config.posterior.particles, tick_text(tick, robot_.config.planner.deadline_us).c_str());
  return text;
}

void Progress::draw(const LoggedTick& tick) {
  const std::string text = block(tick);
  std::string out;
  // and what a longer block left below this one
  if (drawn_lines_ > 0) out += format("\033[%dA\033[J", drawn_lines_);
  std::size_t from = 0;
  for (std::size_t end; (end = text.find('\n', from)) != std::string::npos; from = end + 1) {
    // no wrap: a line that is wider than the terminal would break the count of lines
    out += "\033[?7l" + text.substr(from, end - from) + "\033[K\033[?7h\n";
  }
  drawn_lines_ = static_cast<int>(std::count(text.begin(), text.end(), '\n'));
  std::fwrite(out.data(), 1, out.size(), stdout);
  std::fflush(stdout);
}

void Progress::show(const LoggedTick& tick) {
  const tiller_record_t& record = tick.entry.record;
  if (style_ != Style::silent && record.has_measurement != 0 && stands_by(tick)) sensors_.take(record.measurement);
  if (style_ == Style::lines && tick.time_s >= next_line_s_ - 1e-9) {
    if (stdout_takes()) {
      std::printf("%s\n", line(tick).c_str());
      std::fflush(stdout);
    }
    while (next_line_s_ <= tick.time_s + 1e-9) next_line_s_ += kLineEvery_s;
  }
  if (style_ != Style::block) return;
  const auto now = std::chrono::steady_clock::now();
  if (now < next_draw_) return;
  next_draw_ = now + kDrawEvery;
  if (stdout_takes()) draw(tick);
}

void Progress::finish(const LoggedTick& tick) {
  if (style_ == Style::block) draw(tick);
}

void Progress::say(const std::string& text, bool must) {
  if (must && style_ == Style::silent) std::fprintf(stderr, "tiller: %s\n", text.c_str());
  if (style_ == Style::silent || !stdout_takes()) return;
  std::printf("%s%s\n", style_ == Style::block ? "\033[K" : "", text.c_str());
  std::fflush(stdout);
  drawn_lines_ = 0;
}

}  // namespace tiller::tools
