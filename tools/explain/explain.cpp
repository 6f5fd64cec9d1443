#include "tools/explain/explain.hpp"

#include <algorithm>
#include <map>

#include "tools/explain/evidence.hpp"
#include "tools/explain/happenings.hpp"
#include "tools/explain/remedies.hpp"
#include "tools/robot/in_motion.hpp"

namespace tiller::tools {
namespace {

std::string ticks_text(std::size_t ticks) { return format("%zu tick%s", ticks, ticks == 1 ? "" : "s"); }

/// What the robot did about it.
std::string headline(const Happening& h) {
  switch (h.kind) {
    case HappeningKind::safe: return "It went SAFE: the safe command, until a reset";
    case HappeningKind::held: return "It held: the feedback of HOLD in the place of a plan";
    case HappeningKind::refused:
      return h.status == tiller_status_no_new_measurement || h.status == tiller_status_measurement_outlier
                 ? "The plan before went on"
                 : "It was refused, and the plan before went on";
    case HappeningKind::clipped: return "The gate clipped the command";
    case HappeningKind::late: return "The planner ran out of time";
    default: return "The plan was sent all the same";
  }
}

std::string how_often(const RecordedRun& run, const Happening& h) {
  if (h.ticks == 1) return "";
  if (h.spans == 1) return ", for " + ticks_text(h.ticks) + (h.last + 1 == run.entries.size() ? ", to the end" : "");
  return format(", and %zu time%s more to ", h.spans - 1, h.spans == 2 ? "" : "s") + place_text(run, h.last) + ", " +
         ticks_text(h.ticks) + " in all";
}

/// Why the state is not what it was before, where the reason's name does not tell.
std::string latch_text(const tiller_config_t& config, const RecordedRun& run, const Happening& h) {
  if (h.kind != HappeningKind::safe || h.first == 0) return "";
  const RecordEntry& entry = run.entries[h.first];
  if (entry.stop_status != 0) return "The host stopped it by tiller_stop";
  const std::uint32_t most = config.safety.hold_ticks_to_safe;
  std::size_t held = 0;
  while (held < h.first && run.entries[h.first - 1 - held].record.command.state == tiller_state_hold) ++held;
  if (most > 0 && held + 1 >= most) return format("HOLD had lasted for [safety] hold_ticks_to_safe = %u ticks", most);
  std::size_t refused = 1;
  const std::int32_t why = entry.record.status;
  while (refused <= h.first && run.entries[h.first - refused].record.status == why) ++refused;
  if (refused > 1 && refused >= config.safety.bad_ticks_to_safe)
    return format("It was the reading number %zu in a row that was refused; [safety] bad_ticks_to_safe = %u", refused,
                  config.safety.bad_ticks_to_safe);
  return "";
}

/// What a tick without a plan in time costs beside it.
std::string given_way(const tiller_config_t& config, const Happening& h) {
  if (h.status != tiller_status_deadline_missed || config.posterior.moves_per_tick <= 8) return "";
  return format(
      "Each plan without an iteration halves [posterior] moves_per_tick = %u, down to 8, until plans have time "
      "again: docs/guide/real_time.md",
      config.posterior.moves_per_tick);
}

std::string sentence(const std::string& text) { return text.empty() ? "" : "    " + text + ".\n"; }

/// Troubles have a reason of the controller's.
std::string trouble_text(const tiller_config_t& config, const RecordedRun& run, const Happening& h) {
  std::string text = place_text(run, h.first) + how_often(run, h) + ": ";
  if (h.status == tiller_status_ok)
    return text + headline(h) + ".\n" +
           sentence("The log does not tell why: over LCM, record the channel TELEMETRY beside the others");
  text += std::string(tiller_status_name(h.status)) + ", " + tiller_status_text(h.status) + ".\n";
  text += sentence(headline(h)) + sentence(latch_text(config, run, h)) + sentence(h.evidence) +
          sentence(given_way(config, h));
  return text + sentence(std::string("Next: ") + remedy_for(h.status));
}

/// Beside the planner, which ends by its deadline, a tick learns and predicts.
std::string overran_text(const tiller_config_t& config, const RecordedRun& run, const Happening& h) {
  return place_text(run, h.first) + how_often(run, h) + ": the tick took longer than its deadline.\n" +
         sentence(format("The longest took %.3g ms; [planner] deadline_us = %.6g, and the period is %.3g ms",
                         1e3 * h.longest_s, deadline_of(config, run), 1e3 * config.period_s)) +
         sentence(
             "Next: fewer [posterior] particles or moves_per_tick, where the planner had its iterations; or the "
             "machine had other work: docs/guide/real_time.md");
}

/// Of all ticks in which the robot moved.
std::string share_text(const RecordedRun& run, std::size_t ticks) {
  const auto moved = std::count_if(run.entries.begin(), run.entries.end(),
                                   [](const RecordEntry& e) { return in_motion(e.record.command.state); });
  return format("%zu of %zu ticks in motion", ticks, static_cast<std::size_t>(std::max<std::ptrdiff_t>(moved, 1)));
}

std::string remark_text(const RobotFile& robot, const tiller_config_t& config, const RecordedRun& run,
                        const Happening& h) {
  const std::string from = ", first at " + place_text(run, h.first);
  if (h.kind == HappeningKind::at_limit) {
    const std::size_t i = h.channel / 2;
    const std::string& input = robot.names.inputs[i];
    const tiller_safety_config_t& limits = config.safety;
    if (h.channel % 2 == 1)
      return input + " changed as fast as it may in " + share_text(run, h.ticks) + from + "; [limits] " + input +
             " rate_per_s = " + number_text(limits.input_rate_per_s[i]);
    return input + " stood at a limit in " + share_text(run, h.ticks) + from + "; [limits] " + input +
           " low = " + number_text(limits.input_low[i]) + ", high = " + number_text(limits.input_high[i]);
  }
  const std::string why = std::string(tiller_status_name(h.status)) + " in " + ticks_text(h.ticks) + from + ", ";
  return why + tiller_status_text(h.status) + (h.evidence.empty() ? "" : ". " + h.evidence);
}

std::string states_text(const RecordedRun& run) {
  std::map<std::uint32_t, std::size_t> ticks;
  for (const RecordEntry& entry : run.entries) ++ticks[entry.record.command.state];
  Words words;
  for (const auto& [state, count] : ticks)
    words.push_back(format("%zu %s", count, tiller_state_name(static_cast<tiller_state_t>(state))));
  return join(words);
}

std::string missing_text(const RobotFile& robot, const RecordedRun& run, const Happening& h) {
  return place_text(run, h.first) + how_often(run, h) + ": " + robot.names.measurements[h.channel] +
         " was NaN; the rest of the reading was taken in.\n" +
         sentence(
             "Next: check that sensor's cable and driver; after [safety] sensor_timeout_s it would have been SAFE");
}

/// Whether the robot was never let go.
bool never_moved(const RecordedRun& run) {
  return std::none_of(run.entries.begin(), run.entries.end(),
                      [](const RecordEntry& e) { return in_motion(e.record.command.state); });
}

bool tells_states(const RecordedRun& run) {
  return std::none_of(run.entries.begin(), run.entries.end(),
                      [](const RecordEntry& e) { return e.record.command.state == kStateUnknown; });
}

}  // namespace

std::string explain_run(const RobotFile& robot, const RecordedRun& run, const std::string& path, std::string& error) {
  if (run.entries.empty() || !tells_states(run)) {
    error = path +
            ": it does not tell the controller's states and reasons; `tiller run --log` or --record writes a log "
            "that does";
    return "";
  }
  Config config = run.has_config ? run.config : robot.config;
  config.model = robot.config.model;  // a log's configuration has none
  const std::vector<Happening> all = find_happenings(robot, config, run);
  std::string troubles, remarks;
  for (const Happening& h : all) {
    if (h.kind == HappeningKind::missing)
      troubles += missing_text(robot, run, h);
    else if (h.kind == HappeningKind::overran)
      troubles += overran_text(config, run, h);
    else if (is_remark(h))
      remarks += "  " + remark_text(robot, config, run, h) + ".\n";
    else
      troubles += trouble_text(config, run, h);
  }
  const double time_s =
      1e-6 * static_cast<double>(run.entries.back().record.now_us - run.entries.front().record.now_us);
  std::string text =
      path + ": " + ticks_text(run.entries.size()) + format(" in %.2f s: ", time_s) + states_text(run) + "\n";
  if (never_moved(run)) text += "It was never armed in this log: --arm, the key a, or a message arms it.\n";
  text += troubles.empty() ? "Nothing happened: no measurement was refused, and no command held, clipped or late.\n"
                           : troubles;
  return remarks.empty() ? text : text + "Beside that, and no trouble by itself:\n" + remarks;
}

}  // namespace tiller::tools
