// Messages of a log of LCM, each once, with what answers what.
#include "tools/logs/lcm_messages.hpp"

#include <algorithm>
#include <cstring>
#include <deque>
#include <limits>
#include <map>

#include "io/lcm_messages.hpp"

namespace tiller::tools {
namespace {

constexpr std::size_t kMostWaiting = 64;
constexpr std::size_t kMostBack = 4;       // how far a repetition may come behind its command
constexpr std::size_t kMostChannels = 64;  // to tell of; a log with more is no log of ours

tiller_measurement_t convert(const LcmMeasurement& message) {
  tiller_measurement_t m{};
  m.stamp_us = message.stamp_us;
  m.sequence = static_cast<std::uint32_t>(message.sequence);
  m.command_latency_us = static_cast<std::uint32_t>(std::max(message.command_latency_us, 0));
  for (int i = 0; i < message.count; ++i)
    m.value[i] = (static_cast<std::uint32_t>(message.valid_mask) >> i & 1u) != 0
                     ? message.value[i]
                     : std::numeric_limits<double>::quiet_NaN();
  return m;
}

bool is_same(const LcmCommand& a, const LcmCommand& b) {
  return a.stamp_us == b.stamp_us && a.sequence == b.sequence && a.state == b.state &&
         a.plan_sequence == b.plan_sequence && std::equal(std::begin(a.value), std::end(a.value), b.value);
}

class Reader {
 public:
  Reader(const RobotFile& robot, LcmSink& sink) : robot_(robot), sink_(sink), prefix_(robot.transport.channel_prefix) {}

  void take(const LcmEvent& event) {
    ++number_;
    if (event.channel == prefix_ + "MEASUREMENT") take_measurement(event);
    if (event.channel == prefix_ + "COMMAND") take_command(event);
    if (event.channel == prefix_ + "TELEMETRY") take_telemetry(event);
    if (event.channel == prefix_ + "FORCES") take_forces(event);
    if (event.channel == prefix_ + "PROBING") take_probing(event);
    if (channels_.size() < kMostChannels || channels_.count(event.channel) > 0) ++channels_[event.channel];
  }

  /// Why nothing can be made of them; empty: something can.
  std::string problem() const {
    const std::string channel = "channel " + prefix_ + "MEASUREMENT: ";
    if (miscounted_ > 0)
      return channel + std::to_string(miscounted_) + " messages hold " + std::to_string(said_) +
             " values where [measurement] of " + robot_.path + " names " +
             std::to_string(robot_.config.measurement_count) + "; use the robot file that the log was made with";
    if (contradictions_ > 0)
      return channel + std::to_string(contradictions_) +
             " messages repeat the stamp and the sequence of the one before them with other values; two plants on one "
             "channel, or a log that was joined: record one run a file";
    if (measurements_ > 0 && commands_ > 0) return "";
    return "no messages on channel " + prefix_ + (measurements_ == 0 ? "MEASUREMENT" : "COMMAND") + "; the log has " +
           channels_text() + "; name the prefix in [transport] channel_prefix, and log measurements and commands" +
           (undecoded_ > 0 ? " (" + std::to_string(undecoded_) + " could not be decoded: another message type)" : "");
  }

 private:
  void take_measurement(const LcmEvent& event) {
    LcmMeasurement m;
    if (!read_event(event, m)) return void(++undecoded_);
    if (m.count < 0 || static_cast<std::uint32_t>(m.count) != robot_.config.measurement_count) {
      said_ = m.count;
      return void(++miscounted_);
    }
    LcmArrived arrived{convert(m), measurements_, event.stamp_us, number_};
    if (measurements_ > 0 && arrived.measurement.sequence == newest_.sequence &&
        arrived.measurement.stamp_us == newest_.stamp_us) {
      contradictions_ += std::memcmp(arrived.measurement.value, newest_.value, sizeof newest_.value) != 0 ? 1 : 0;
      return;
    }
    ++measurements_;
    newest_ = arrived.measurement;
    waiting_.push_back(arrived);
    if (waiting_.size() > kMostWaiting) waiting_.pop_front();
    sink_.take_measurement(arrived);
  }

  void take_command(const LcmEvent& event) {
    LcmCommand command;
    if (!read_event(event, command)) return void(++undecoded_);
    if (std::any_of(sent_.begin(), sent_.end(), [&](const LcmCommand& c) { return is_same(c, command); })) return;
    ++commands_;
    sent_.push_back(command);
    if (sent_.size() > kMostBack) sent_.pop_front();
    const auto sequence = static_cast<std::uint32_t>(command.sequence);
    const auto found = std::find_if(waiting_.begin(), waiting_.end(),
                                    [&](const LcmArrived& a) { return a.measurement.sequence == sequence; });
    const bool answers = found != waiting_.end();
    sink_.take_command(command, answers ? &*found : nullptr, answers || waiting_.empty() ? nullptr : &waiting_.back());
    // what came after the one that is answered waits for the next command
    if (answers) waiting_.erase(waiting_.begin(), found + 1);
  }

  void take_telemetry(const LcmEvent& event) {
    LcmTelemetry telemetry;
    if (read_event(event, telemetry)) sink_.take_telemetry(telemetry);
  }

  void take_forces(const LcmEvent& event) {
    LcmForces forces;
    if (read_event(event, forces)) sink_.take_forces(forces);
  }

  void take_probing(const LcmEvent& event) {
    LcmProbing probing;
    if (read_event(event, probing)) sink_.take_probing(probing);
  }

  std::string channels_text() const {
    Words names;
    for (const auto& [name, count] : channels_) names.push_back(name + " (" + std::to_string(count) + ")");
    return join(names) + (channels_.size() == kMostChannels ? ", and perhaps more" : "");
  }

  const RobotFile& robot_;
  LcmSink& sink_;
  const std::string prefix_;
  tiller_measurement_t newest_{};
  std::deque<LcmArrived> waiting_;  // since the last one that was answered
  std::deque<LcmCommand> sent_;     // the last ones
  std::map<std::string, int> channels_;
  std::size_t measurements_ = 0, commands_ = 0;
  int undecoded_ = 0, miscounted_ = 0, contradictions_ = 0, said_ = 0, number_ = 0;
};

}  // namespace

bool read_lcm_messages(std::istream& file, const std::string& path, const RobotFile& robot, LcmSink& sink,
                       std::string& damage, std::string& error) {
  Reader reader(robot, sink);
  LcmEventLog log(file);
  for (LcmEvent event; log.next(event);) reader.take(event);
  damage.clear();
  if (log.skipped_bytes() > 0)
    damage = format("%llu bytes of it belong to no event", static_cast<unsigned long long>(log.skipped_bytes()));
  if (log.cut_off()) damage += (damage.empty() ? "" : "; ") + std::string("it is cut off in its last event");
  const std::string problem = reader.problem();
  if (!problem.empty()) error = path + ": " + problem;
  return problem.empty();
}

}  // namespace tiller::tools
