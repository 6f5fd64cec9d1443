// Ticks from the messages of an LCM log. What a controller was given and what it answered are not one message, so they
// are put together again: docs/guide/replay.md tells by which rules.
#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <map>

#include "tools/logs/lcm_messages.hpp"
#include "tools/logs/recorded_run.hpp"
#include "tools/robot/in_motion.hpp"

namespace tiller::tools {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// A command with the telemetry that was logged for it.
struct Answer {
  std::uint64_t tick = 0;
  LcmCommand command{};
  bool told = false;
  LcmTelemetry telemetry{};
  LcmForces forces{};         ///< no joints: none were logged
  LcmProbing probing{};       ///< zeros: none was logged
  bool has_answered = false;  ///< `answered` is the measurement that it answers
  tiller_measurement_t answered{};
  bool has_waiting = false;  ///< `waiting` is the newest one that came since the command before
  tiller_measurement_t waiting{};
};

/// Commands with the measurement that each answers and the telemetry that tells of it.
class Answers : public LcmSink {
 public:
  void take_measurement(const LcmArrived&) override {}

  void take_command(const LcmCommand& command, const LcmArrived* answered, const LcmArrived* waiting) override {
    Answer answer;
    answer.command = command;
    answer.has_answered = answered != nullptr;
    if (answered) answer.answered = answered->measurement;
    answer.has_waiting = waiting != nullptr;
    if (waiting) answer.waiting = waiting->measurement;
    list.push_back(answer);
  }

  void take_telemetry(const LcmTelemetry& t) override {
    if (t.tick < 1 || t.tick > kMostTicks) return;
    Answer* const answer = newest([&](const Answer& a) { return !a.told && a.command.stamp_us == t.stamp_us; });
    if (!answer) return;
    answer->telemetry = t;
    answer->told = true;
  }

  void take_forces(const LcmForces& f) override {
    if (Answer* const answer = told_of(f.tick, f.stamp_us)) answer->forces = f;
  }

  void take_probing(const LcmProbing& p) override {
    if (Answer* const answer = told_of(p.tick, p.stamp_us)) answer->probing = p;
  }

  std::vector<Answer> list;

 private:
  /// The newest of the last answers that fits; null: none does.
  template <class Fits>
  Answer* newest(const Fits& fits) {
    const std::size_t end = list.size(), oldest = end - std::min(end, kMostBack);
    for (std::size_t i = end; i > oldest; --i)
      if (fits(list[i - 1])) return &list[i - 1];
    return nullptr;
  }
  Answer* told_of(std::int64_t tick, std::int64_t stamp_us) {
    return newest(
        [&](const Answer& a) { return a.told && a.telemetry.tick == tick && a.command.stamp_us == stamp_us; });
  }

  static constexpr std::size_t kMostBack = 4;                        // how far telemetry may come behind its command
  static constexpr std::int64_t kMostTicks = std::int64_t{1} << 53;  // more is no number of a tick
};

/// Which commands are ticks of the controller: those with telemetry, and those between them that its tick numbers miss.
/// Without any telemetry: all from the first to the last that is not the safe command of STANDBY.
std::vector<Answer> ticks_of(const std::vector<Answer>& answers, std::string& note) {
  const auto add_note = [&](const std::string& text) { note += (note.empty() ? "" : "; ") + text; };
  std::vector<Answer> ticks;
  const bool any = std::any_of(answers.begin(), answers.end(), [](const Answer& a) { return a.told; });
  if (!any) {
    const auto moves = [](const Answer& a) { return a.command.state != tiller_state_standby; };
    const auto first = std::find_if(answers.begin(), answers.end(), moves);
    const auto last = std::find_if(answers.rbegin(), answers.rend(), moves).base();
    if (first < last) ticks.assign(first, last);
    for (std::size_t i = 0; i < ticks.size(); ++i) ticks[i].tick = i;
    add_note("no telemetry was logged: the iterations of each plan are not known");
    return ticks;
  }
  std::vector<Answer> between;
  std::int64_t tick = 0;
  for (const Answer& answer : answers) {
    if (!answer.told) {
      between.push_back(answer);
      continue;
    }
    const std::int64_t missing = answer.telemetry.tick - tick - 1;
    if (!ticks.empty() && answer.telemetry.tick <= tick) {
      add_note("a second run begins in it, which is left out");
      break;
    }
    const auto found = std::min<std::int64_t>(missing, static_cast<std::int64_t>(between.size()));
    ticks.insert(ticks.end(), between.end() - found, between.end());
    ticks.push_back(answer);
    tick = answer.telemetry.tick;
    for (std::int64_t i = 0; i <= found; ++i) (ticks.end() - 1 - i)->tick = static_cast<std::uint64_t>(tick - 1 - i);
    between.clear();
  }
  return ticks;
}

/// The guard refused the measurement: it was given to the controller, but no command answers it.
bool is_refusal(std::int32_t status) {
  return status >= tiller_status_sensor_not_finite && status <= tiller_status_time_backwards;
}

bool is_told_by_the_host(std::int32_t fault) {
  return fault == tiller_status_transport_closed || fault == tiller_status_bus_off ||
         fault == tiller_status_actuator_fault || fault == tiller_status_stopped || fault == tiller_status_io_error;
}

/// The latency that the host expects of a robot that tells none, as it computes it (TransportLink).
class Foresight {
 public:
  std::uint32_t latency_us(const tiller_measurement_t& m, std::int64_t now_us) const {
    const double age_us = static_cast<double>(now_us) - static_cast<double>(m.stamp_us);  // any two stamps of a file
    return static_cast<std::uint32_t>(std::clamp(age_us + compute_us_, 0.0, 1e6));
  }
  void note(std::int64_t tick_ns) { compute_us_ += 0.1 * (1e-3 * static_cast<double>(tick_ns) - compute_us_); }

 private:
  double compute_us_ = 0;
};

void take_telemetry(const RobotFile& robot, const Answer& answer, RecordEntry& entry) {
  tiller_record_t& r = entry.record;
  const LcmTelemetry& t = answer.telemetry;
  r.tick = static_cast<std::uint64_t>(t.tick - 1);
  r.status = t.status;
  r.planner_iterations = static_cast<std::uint32_t>(t.planner_iterations);
  r.plan_cost = t.plan_cost;
  r.effective_samples = t.effective_samples;
  r.noise_scale = t.noise_scale;
  r.tick_ns = t.tick_ns;
  std::copy(t.state_mean, t.state_mean + robot.config.model->state_count, r.state_mean);
  const auto params = std::min<std::uint32_t>(robot.config.param_count, TILLER_MAX_PARAMS);
  std::copy(t.param_mean, t.param_mean + params, r.param_mean);
  std::copy(t.param_sd, t.param_sd + params, r.param_sd);
}

void take_forces(const LcmForces& forces, RecordEntry& entry) {
  entry.force_joints = static_cast<std::uint32_t>(forces.count);
  entry.touched = static_cast<std::uint32_t>(forces.touched);
  std::copy(std::begin(forces.mean), std::end(forces.mean), entry.force_mean);
  std::copy(std::begin(forces.sd), std::end(forces.sd), entry.force_sd);
}

void take_probing(const LcmProbing& p, ProbeAccount& probe) {
  probe = {static_cast<std::uint32_t>(p.probing),
           static_cast<std::uint32_t>(p.calibration_left),
           p.value,
           p.cost,
           p.spent,
           p.allowed,
           p.information};
}

RecordEntry entry_of(const RobotFile& robot, const Answer& answer, bool lockstep, const Foresight& foresight) {
  RecordEntry entry;
  tiller_record_t& r = entry.record;
  const LcmCommand& c = answer.command;
  r.now_us = r.command.stamp_us = c.stamp_us;
  r.command.sequence = static_cast<std::uint32_t>(c.sequence);
  r.command.state = static_cast<std::uint32_t>(c.state);
  r.command.plan_sequence = static_cast<std::uint32_t>(c.plan_sequence);
  std::copy(c.value, c.value + robot.config.model->input_count, r.command.value);
  const bool refused = answer.told && answer.has_waiting && is_refusal(answer.telemetry.status);
  r.has_measurement = answer.has_answered || refused ? 1u : 0u;
  if (r.has_measurement != 0) r.measurement = answer.has_answered ? answer.answered : answer.waiting;
  if (r.has_measurement != 0 && robot.transport.stamp_on_arrival && !lockstep) r.measurement.stamp_us = r.now_us;
  if (r.has_measurement != 0 && !lockstep && r.measurement.command_latency_us == 0)
    r.measurement.command_latency_us = foresight.latency_us(r.measurement, r.now_us);
  r.planner_iterations = kIterationsUnknown;
  r.state_mean[0] = kNaN;
  return entry;
}

/// Whether the controller was given a measurement that is not in the log. A command repeats the sequence of the last
/// one that was taken in, so a new number is a measurement; the first tick of a run has one, unless it says otherwise.
bool lacks_measurement(const Answer& answer, const Answer* before) {
  if (answer.has_answered) return false;
  if (answer.told && is_refusal(answer.telemetry.status)) return !answer.has_waiting;
  if (before == nullptr) return !answer.told || answer.telemetry.status != tiller_status_no_new_measurement;
  return answer.command.sequence != before->command.sequence;
}

/// What single messages leave missing in ticks that are there. Behind a missing tick a new number proves nothing.
void find_lost_messages(const RobotFile& robot, const std::vector<Answer>& ticks, bool lockstep,
                        std::vector<LogHole>& holes) {
  for (std::size_t i = 0; i < ticks.size(); ++i) {
    const Answer* before = i > 0 && ticks[i].tick == ticks[i - 1].tick + 1 ? &ticks[i - 1] : nullptr;
    const auto add = [&](LogHole::What what) {
      const bool goes_on = !holes.empty() && holes.back().what == what && holes.back().last + 1 == ticks[i].tick;
      if (goes_on)
        ++holes.back().last;
      else
        holes.push_back({what, ticks[i].tick, ticks[i].tick, i});
    };
    if ((before || ticks[i].tick == 0) && lacks_measurement(ticks[i], before)) add(LogHole::What::kMeasurement);
    // in lockstep no deadline ends a plan
    if (!ticks[i].told && !lockstep && robot.config.planner.deadline_us > 0) add(LogHole::What::kIterations);
  }
}

/// What `tiller run` does between two ticks, as the state before and after shows it: prepares after each, arms,
/// disarms, and stops on a fault of the transport; a calibration that begins has more periods left than one that goes on.
void add_calls(const Answer& answer, bool first, std::uint32_t before, std::int32_t periods_before,
               RecordEntry& entry) {
  const std::uint32_t state = answer.command.state;
  std::uint32_t calls = first ? 0u : std::uint32_t{tiller_call_prepare}, shift = first ? 0 : 4;
  if (answer.probing.calibration_left > periods_before) {
    calls |= std::uint32_t{tiller_call_calibrate} << shift;
    shift += 4;
  }
  if (in_motion(state) && !in_motion(before)) calls |= std::uint32_t{tiller_call_arm} << shift;
  if (in_motion(before) && state == tiller_state_standby) calls |= std::uint32_t{tiller_call_disarm} << shift;
  const bool stopped = answer.told && state == tiller_state_safe && before != tiller_state_safe &&
                       is_told_by_the_host(answer.telemetry.first_fault);
  if (stopped) {
    calls |= std::uint32_t{tiller_call_stop} << shift;
    entry.stop_status = static_cast<std::uint32_t>(answer.telemetry.first_fault);
  }
  entry.record.calls = calls;
}

}  // namespace

bool read_lcm_run(const std::string& path, const RobotFile& robot, RecordedRun& run, std::string& error) {
  std::ifstream file(path, std::ios::binary);
  if (file) return read_lcm_run(file, path, robot, run, error);
  error = path + ": cannot be read: " + std::strerror(errno) + "\n";
  return false;
}

bool read_lcm_run(std::istream& file, const std::string& path, const RobotFile& robot, RecordedRun& run,
                  std::string& error) {
  run = {};
  Answers answers;
  std::string damage;
  if (!read_lcm_messages(file, path, robot, answers, damage, error)) {
    error += "\n";
    return false;
  }
  const std::vector<Answer> ticks = ticks_of(answers.list, run.note);
  const auto stands_at_its_stamp = [](const Answer& a) {
    return !a.has_answered || a.command.stamp_us == a.answered.stamp_us;
  };
  const bool lockstep = std::all_of(ticks.begin(), ticks.end(), stands_at_its_stamp);
  if (lockstep) run.deadline_us = 0;
  Foresight foresight;
  std::uint32_t before = tiller_state_init;
  std::int32_t periods_before = 0;
  for (const Answer& answer : ticks) {
    RecordEntry entry = entry_of(robot, answer, lockstep, foresight);
    entry.record.tick = answer.tick;
    add_calls(answer, run.entries.empty(), before, periods_before, entry);
    if (answer.probing.tick > 0) periods_before = answer.probing.calibration_left;
    if (answer.told) {
      take_telemetry(robot, answer, entry);
      take_forces(answer.forces, entry);
      take_probing(answer.probing, entry.probe);
      foresight.note(answer.telemetry.tick_ns);
    }
    before = answer.command.state;
    run.entries.push_back(entry);
  }
  if (robot.transport.stamp_on_arrival && !lockstep)
    run.note +=
        (run.note.empty() ? "" : "; ") + std::string("the times of arrival are not in it: expect no equal bits");
  find_lost_messages(robot, ticks, lockstep, run.holes);
  run.cut_off = !damage.empty();
  if (run.cut_off) run.note += (run.note.empty() ? "" : "; ") + damage;
  find_holes(run);
  if (run.entries.empty()) error = path + ": no tick of a controller in it\n";
  return !run.entries.empty();
}

}  // namespace tiller::tools
