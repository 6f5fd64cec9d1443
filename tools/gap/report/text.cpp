#include <cmath>

#include "tools/base/interval_text.hpp"
#include "tools/base/text.hpp"
#include "tools/gap/fit/hypothesis.hpp"
#include "tools/gap/report/outputs.hpp"

namespace tiller::tools::gap {
namespace {

std::string effects_line(const Explanation& x, const tiller_config_t& config) {
  std::string text;
  for (const EffectAt& effect : x.effects) text += (text.empty() ? "" : " + ") + effect_text(effect, config);
  return text.empty() ? "the model as it is" : text;
}

void append_horizons(const Result& result, std::string& text) {
  if (result.horizons.empty()) return;
  const auto row = [&](const std::string& what, double before, double after, std::size_t windows) {
    text += format("  %-24s %14.3g %14.3g %9zu\n", what.c_str(), before, after, windows);
  };
  text += format("\n  %-24s %14s %14s %9s\n", "rollouts", "before (sigma)", "after (sigma)", "windows");
  if (!result.ranking.empty())
    row("windows worked on", result.before.logs.empty() ? result.nominal_sigma : result.frozen_sigma,
        result.ranking[0].remaining_sigma, result.fit_windows);
  for (const HorizonGap& h : result.horizons)
    row(format("%g s, kept for the proof", h.seconds), h.before_sigma, h.after_sigma, h.windows);
}

void append_ranking(const RobotFile& robot, const Result& result, std::string& text) {
  if (result.ranking.empty()) return;
  text += format("\n  %-46s %10s %8s %9s %7s\n", "explanation", "gain/nats", "z", "z to best", "sigma");
  for (std::size_t i = 0; i < result.ranking.size() && i < 10; ++i) {
    const Explanation& x = result.ranking[i];
    bool rival = false;
    for (const std::size_t a : result.ambiguity) rival = rival || a == i;
    text += format("%c %-46s %10.1f %8.1f %9.1f %7.3g\n", rival ? '*' : ' ', effects_line(x, robot.config).c_str(),
                   x.gain_nats, x.z, x.z_to_best, x.remaining_sigma);
  }
  if (result.ambiguity.size() > 1) text += "  (*: cannot be told apart on these data)\n";
}

void append_parameters(const Result& result, std::string& text) {
  if (result.ranking.empty() || result.ranking[0].params.empty()) return;
  text += format("\n  %-34s %12s %12s %10s   %s\n", "parameter", "before", "after", "sd", "95 %");
  for (const Estimate& e : result.ranking[0].params) {
    if (e.fixed) continue;
    const std::string before = std::isfinite(e.before) ? format("%.5g", e.before) : std::string("-");
    text += format("  %-34s %12s %12s %10.2g   %s %s\n", e.name.c_str(), before.c_str(),
                   mean_text(e.mean, e.sd, 5).c_str(), e.sd, interval_text(e.low, e.high).c_str(), e.unit.c_str());
  }
  for (const Estimate& e : result.ranking[0].params)
    if (e.edge.side != EdgeSide::none) text += "  " + edge_text(e.name, e.edge) + "\n";
}

void append_changes(const Result& result, std::string& text) {
  const auto table = [&](const char* title, const std::vector<Change>& changes) {
    if (changes.empty()) return;
    text += format("\n  %-34s %12s %12s %12s   %s\n", title, "before", "after", "change", "95 %");
    for (const Change& c : changes)
      text += format("  %-34s %12s %12s %12s   %s %s\n", c.name.c_str(),
                     c.effect ? "-" : mean_text(c.before, c.before_sd, 5).c_str(),
                     mean_text(c.after, c.after_sd, 5).c_str(), format("%+.3g", c.change).c_str(),
                     interval_text(c.low, c.high).c_str(), c.unit.c_str());
  };
  table("changed", result.changes);
  table(result.changes.empty() ? "if it alone had changed" : "if it had changed, too", result.others);
}

void append_region(const RobotFile& robot, const Result& result, std::string& text) {
  const Region& r = result.region;
  if (!r.found) return;
  const char* label = "";
  for (const AxisMap& map : result.maps)
    if (map.joint == r.joint && map.axis == r.axis) label = map.axis_label.c_str();
  text += format("\nWhere: at %s, %s from %.4g to %.4g: %.3g +- %.1g (%s) are missing (z = %.0f)\n",
                 robot.config.model->joints[r.joint].name, label, r.low, r.high, r.force, r.force_sd,
                 robot.config.model->force_names[robot.config.model->joints[r.joint].force], r.z);
}

}  // namespace

std::string gap_text(const RobotFile& robot, const Result& result) {
  const bool unchanged = !result.before.logs.empty() && result.verdict == Verdict::no_gap;
  std::string text = robot.name + ": " + (unchanged ? "unchanged" : verdict_name(result.verdict)) +
                     (result.interrupted ? " (interrupted)" : "") + "\n" + result.sentence + "\n";
  for (const std::string& reason : result.reasons) text += "  " + reason + "\n";
  if (result.verdict == Verdict::unfit) return text;
  append_region(robot, result, text);
  append_ranking(robot, result, text);
  if (result.before.logs.empty())
    append_parameters(result, text);
  else
    append_changes(result, text);
  append_horizons(result, text);
  if (!result.separation.empty()) text += "\nTo tell them apart: " + result.separation + "\n";
  text += format("\n%.1f s of data, %zu windows worked on, %zu kept for the proof; %.1f s of computing\n",
                 result.data_s, result.fit_windows, result.test_windows, result.cpu_s);
  return text;
}

}  // namespace tiller::tools::gap
