// Hardware in the loop: the log takes the robot's place, the controller runs elsewhere.
#include <lcm/lcm.h>
#include <poll.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <thread>
#include <utility>

#include "io/lcm_messages.hpp"
#include "io/monotonic_clock.hpp"
#include "io/udp_multicast.hpp"
#include "tools/links/lcm_seal.hpp"
#include "tools/replay/replay.hpp"

namespace tiller::tools {
namespace {

/// A lost datagram is told from a slow tick by nothing but time; a repeated measurement is refused by its sequence.
constexpr std::int64_t kRepeatUs = 500000;

class LcmRobot {
 public:
  LcmRobot(const ReplayOptions& options, LcmSeal seal)
      : lcm_(lcm_create(options.url.c_str())),
        channel_(options.channel_prefix + "MEASUREMENT"),
        seal_(std::move(seal)) {
    if (lcm_) lcm_subscribe(lcm_, (options.channel_prefix + "COMMAND").c_str(), on_command, this);
  }
  ~LcmRobot() {
    if (lcm_) lcm_destroy(lcm_);
  }
  LcmRobot(const LcmRobot&) = delete;
  LcmRobot& operator=(const LcmRobot&) = delete;
  bool good() const { return lcm_ != nullptr; }

  bool publish(const tiller_measurement_t& m, std::uint32_t count, std::int64_t shift_us) {
    LcmMeasurement out = lcm_message(m, count);
    out.stamp_us += shift_us;
    const LcmType& type = lcm_measurement_type(count);
    std::vector<unsigned char> bytes(lcm_size(type, &out));
    (void)lcm_encode(type, &out, bytes.data());
    return publish(bytes);
  }

  /// With a key: until the controller has told its challenge, it takes nothing. False: it does not.
  bool introduce(double patience_s) {
    if (!seal_.sign) return true;
    const std::int64_t until_us = monotonic_us() + std::llround(1e6 * patience_s);
    while (!seal_.is_introduced() && monotonic_us() < until_us) {
      std::vector<unsigned char> nothing;
      if (!publish(nothing)) return false;
      const std::int64_t next_us = std::min(until_us, monotonic_us() + kRepeatUs);
      while (!seal_.is_introduced() && handle(next_us)) {
      }
    }
    commands.clear();
    return seal_.is_introduced();
  }

  /// Handles what comes until `until_us` (monotonic), or until there is a command.
  void listen(std::int64_t until_us) {
    while (commands.empty() && handle(until_us)) {
    }
  }

  std::vector<tiller_command_t> commands;

 private:
  bool publish(std::vector<unsigned char>& bytes) {
    if (seal_.sign) seal_.sign(channel_, bytes);
    return lcm_publish(lcm_, channel_.c_str(), bytes.data(), static_cast<unsigned>(bytes.size())) == 0;
  }

  /// The next message, if one comes in time. False: the time is over, or LCM fails.
  bool handle(std::int64_t until_us) {
    const std::int64_t left_us = until_us - monotonic_us();
    pollfd descriptor = {lcm_get_fileno(lcm_), POLLIN, 0};
    const int wait_ms = static_cast<int>(std::clamp<std::int64_t>((left_us + 999) / 1000, 0, 1000));
    if (::poll(&descriptor, 1, wait_ms) > 0 && lcm_handle(lcm_) != 0) return false;
    return left_us > 0;
  }

  static void on_command(const lcm_recv_buf_t* buffer, const char* channel, void* user) {
    auto* robot = static_cast<LcmRobot*>(user);
    const auto* data = static_cast<const unsigned char*>(buffer->data);
    std::vector<unsigned char> bytes(data, data + buffer->data_size);
    if (robot->seal_.verify && !robot->seal_.verify(channel, bytes)) return;
    LcmCommand in;
    if (!lcm_read(bytes.data(), static_cast<std::uint32_t>(bytes.size()), in)) return;
    tiller_command_t command{};
    command.stamp_us = in.stamp_us;
    command.sequence = static_cast<std::uint32_t>(in.sequence);
    command.state = static_cast<std::uint32_t>(in.state);
    std::copy(in.value, in.value + TILLER_MAX_INPUTS, command.value);
    robot->commands.push_back(command);
  }

  lcm_t* lcm_;
  std::string channel_;
  LcmSeal seal_;
};

void compare(const RobotFile& robot, const RecordedRun& run, std::size_t index, const tiller_command_t* answer,
             double tolerance, ReplayResult& result) {
  const RecordEntry& entry = run.entries[index];
  double apart = result.largest;
  const bool same =
      answer && same_command(entry.record.command, *answer, robot.config.model->input_count, tolerance, apart);
  if (is_behind_a_hole(run, index, same, result)) return;
  result.largest = apart;
  ++result.ticks;
  if (same) return;
  ++result.different;
  if (result.first.found) return;
  result.first.found = true;
  result.first.at = index;
  result.first.silent = answer == nullptr;
  if (answer) result.first.replayed = *answer;
}

/// The command that answers the entry, or null after the patience.
const tiller_command_t* await(LcmRobot& plant, const RecordEntry& entry, std::uint32_t count, double patience_s,
                              tiller_command_t& kept) {
  const tiller_record_t& r = entry.record;
  const std::int64_t until_us = monotonic_us() + std::llround(1e6 * patience_s);
  std::int64_t next_us = 0;
  do {
    if (r.has_measurement != 0 && monotonic_us() >= next_us) {
      if (!plant.publish(r.measurement, count, 0)) return nullptr;
      next_us = monotonic_us() + kRepeatUs;
    }
    plant.listen(r.has_measurement != 0 ? std::min(until_us, next_us) : until_us);
    for (const tiller_command_t& c : plant.commands) {
      if (c.sequence != r.command.sequence) continue;
      kept = c;
      plant.commands.clear();
      return &kept;
    }
    plant.commands.clear();
  } while (monotonic_us() < until_us);
  return nullptr;
}

bool lacks_its_measurement(const RecordedRun& run, std::size_t index) {
  return std::any_of(run.holes.begin(), run.holes.end(), [=](const LogHole& hole) {
    const std::uint64_t tick = run.entries[index].record.tick;
    return hole.what == LogHole::What::kMeasurement && hole.first <= tick && tick <= hole.last;
  });
}

void in_lockstep(LcmRobot& plant, const RobotFile& robot, const RecordedRun& run, const ReplayOptions& options,
                 ReplayResult& result) {
  tiller_command_t kept{};
  for (std::size_t i = 0; i < run.entries.size(); ++i) {
    if (lacks_its_measurement(run, i)) {
      (void)is_behind_a_hole(run, i, false, result);  // nothing to ask with, so there is no answer either
      continue;
    }
    const tiller_command_t* answer =
        await(plant, run.entries[i], robot.config.measurement_count, options.patience_s, kept);
    compare(robot, run, i, answer, options.tolerance, result);
    if (!answer) return;  // the controller is gone, or waits for something else
  }
}

/// At the log's pace, answers counted by the sequence that they answer; ticks without a measurement are the
/// controller's own business.
void in_real_time(LcmRobot& plant, const RobotFile& robot, const RecordedRun& run, const ReplayOptions& options,
                  ReplayResult& result) {
  std::map<std::uint32_t, tiller_command_t> answers;
  const auto collect = [&](std::int64_t until_us) {
    do {
      plant.listen(until_us);
      for (const tiller_command_t& c : plant.commands) answers.emplace(c.sequence, c);
      plant.commands.clear();
    } while (monotonic_us() < until_us);
  };
  const std::int64_t shift_us = monotonic_us() - run.entries[0].record.now_us;
  for (const RecordEntry& entry : run.entries) {
    collect(entry.record.now_us + shift_us);
    if (entry.record.has_measurement != 0)
      (void)plant.publish(entry.record.measurement, robot.config.measurement_count, shift_us);
  }
  collect(monotonic_us() + std::llround(1e6 * std::min(options.patience_s, 1.0)));
  for (std::size_t i = 0; i < run.entries.size(); ++i) {
    const tiller_record_t& r = run.entries[i].record;
    if (r.has_measurement == 0 || r.command.sequence != r.measurement.sequence) continue;
    const auto found = answers.find(r.measurement.sequence);
    compare(robot, run, i, found == answers.end() ? nullptr : &found->second, options.tolerance, result);
  }
}

}  // namespace

bool replay_through_lcm(const RobotFile& robot, const RecordedRun& run, const ReplayOptions& options,
                        ReplayResult& result, std::string& error) {
  LcmSeal seal;
  if (!make_lcm_seal(robot, seal, error)) return false;
  OpenError no_route;
  if (!has_multicast_route(options.url.c_str(), &no_route)) {
    error = no_route.text;
    return false;
  }
  LcmRobot plant(options, std::move(seal));
  if (!plant.good()) {
    error = "LCM cannot open '" + options.url + "'; is it a URL of one of liblcm's providers? (docs/guide/lcm.md)";
    return false;
  }
  const bool heard = plant.introduce(options.patience_s);
  if (heard && options.real_time)
    in_real_time(plant, robot, run, options, result);
  else if (heard)
    in_lockstep(plant, robot, run, options, result);
  const bool silent = !heard || (result.first.found && result.first.silent && result.first.at == 0);
  if (silent)
    error = "nobody answers on " + options.url + ": start `tiller run " + robot.path +
            " --transport lcm --arm --lockstep` first, with the same [transport], key_file included";
  return !silent;
}

}  // namespace tiller::tools
