#include <poll.h>

#include <algorithm>
#include <cmath>

#include "io/key_file.hpp"
#include "io/lcm_transport.hpp"
#include "io/monotonic_clock.hpp"
#include "io/socketcan_transport.hpp"
#include "tools/links/latency_watch.hpp"
#include "tools/links/link.hpp"

namespace tiller::tools {
namespace {

constexpr std::int64_t kLookUpUs = 50000;  // how long a wait may last before the stop flag is looked at

std::string where(const RobotFile& robot) {
  const int line = robot.transport.line;  // 0: the file has no such section, the command line named the transport
  return robot.path + (line > 0 ? ":" + std::to_string(line) : "") + ": [transport] ";
}

/// "board:3" or "position:force_N" (checked when the robot file was read).
CanChannel parse_channel(const std::string& text, const Words& inputs) {
  const std::string source = text.substr(0, text.find(':'));
  const std::string rest = text.substr(text.find(':') + 1);
  CanChannel channel;
  if (source == "board") {
    channel.index = static_cast<std::uint8_t>(std::stoi(rest));
    return channel;
  }
  channel.source = source == "position" ? CanSource::kMotorPosition : CanSource::kMotorVelocity;
  channel.index = static_cast<std::uint8_t>(index_of(inputs, rest));
  return channel;
}

ActuatorSettings drive_settings(const DriveSection& drive) {
  ActuatorSettings settings;
  settings.kind = static_cast<ActuatorKind>(index_of({"odrive", "moteus", "mit"}, drive.actuator));
  settings.mode = static_cast<ActuatorMode>(index_of({"torque", "velocity", "position"}, drive.command));
  settings.resolution = static_cast<MoteusResolution>(index_of({"int8", "int16", "int32", "f32"}, drive.resolution));
  settings.watchdog_s = drive.watchdog_s;
  settings.range = {drive.position_rad, drive.velocity_rad_s, drive.torque_Nm, drive.kp_max, drive.kd_max};
  settings.reply = static_cast<MitReply>(index_of({"plain", "ak", "damiao"}, drive.reply));
  settings.reply_id = drive.reply_id;
  settings.kp_Nm_rad = drive.kp_Nm_rad;
  settings.kd_Nms_rad = drive.kd_Nms_rad;
  return settings;
}

CanLayout can_layout(const RobotFile& robot) {
  const TransportSection& t = robot.transport;
  CanLayout layout;
  layout.motor_count = robot.model->input_count;
  for (std::uint32_t i = 0; i < layout.motor_count; ++i) {
    layout.motors[i].node = i < t.nodes.size() ? t.nodes[i] : i + 1;
    layout.motors[i].wheel_radius_m = i < t.wheel_radius_m.size() ? t.wheel_radius_m[i] : 1;
    if (i < t.drives.size()) layout.motors[i].drive = drive_settings(t.drives[i]);
    const double rate_per_s = robot.config.safety.input_rate_per_s[i];
    layout.motors[i].entry_rate_per_s = std::isfinite(rate_per_s) ? rate_per_s : 0;
  }
  layout.channel_count = robot.config.measurement_count;
  bool board = t.channels.empty();
  for (std::uint32_t i = 0; i < layout.channel_count; ++i) {
    layout.channels[i].index = static_cast<std::uint8_t>(i);
    if (!t.channels.empty()) layout.channels[i] = parse_channel(t.channels[i], robot.inputs);
    board = board || layout.channels[i].source == CanSource::kSensor;
  }
  layout.sensor_node = board ? t.sensor_node : CanLayout::kNoBoard;
  layout.heartbeat_timeout_us = static_cast<std::uint32_t>(std::lround(1e6 * t.heartbeat_timeout_s));
  layout.stamp_on_arrival = t.stamp_on_arrival;
  return layout;
}

class TransportLink : public Link {
 public:
  TransportLink(const RobotFile& robot, const TransportLinkOptions& options)
      : robot_(robot),
        options_(options),
        period_us_(std::llround(1e6 * robot.config.period_s)),
        timer_(std::llround(1e9 * robot.config.period_s)),
        latency_(robot.config.period_s) {}
  ~TransportLink() override {
    if (table_) table_->close(self_);
  }

  bool open(std::string& error) {
    OpenError problem;
    const bool lcm = options_.kind == "lcm";
    const tiller_status_t status = lcm ? open_lcm(problem) : open_can(problem);
    if (status == tiller_status_ok) return true;
    const std::string text = problem.text[0] ? problem.text : tiller_status_text(status);
    error = where(robot_) + text + "\n";
    table_ = nullptr;
    return false;
  }

  Sensed wait(const volatile std::sig_atomic_t& stop) override {
    if (options_.lockstep) return wait_lockstep(stop);
    return options_.by_clock ? wait_clock(stop) : wait_real_time(stop);
  }

  tiller_status_t send(const tiller_command_t& command) override { return table_->send(self_, &command); }
  bool truth(double*) const override { return false; }
  void prepare() override { can_.robot.prepare(true); }
  bool is_ready() const override { return options_.kind == "lcm" || can_.robot.is_ready(); }
  const PeriodicTimer* timer() const override { return options_.by_clock && !options_.lockstep ? &timer_ : nullptr; }

  void tell(const tiller_info_t& info, std::int64_t stamp_us, const LogState& log) override {
    // mean over about ten ticks: one that was held up by the machine says little of the next
    compute_us_ += 0.1 * (1e-3 * static_cast<double>(info.tick_ns) - compute_us_);
    if (options_.kind != "lcm") return;
    (void)lcm_send_telemetry(&lcm_, stamp_us, info, robot_.model->state_count, robot_.config.param_count, log);
  }

  std::string news() override { return latency_.news(options_.kind == "lcm"); }

  std::string counters() const override {
    tiller_transport_counters_t c{};
    table_->counters(self_, &c);
    std::string text = format("%s: %llu received, %llu sent", table_->name, count(c.received), count(c.sent));
    if (c.dropped_old) text += format(", %llu superseded", count(c.dropped_old));
    if (c.bad_messages) text += format(", %llu bad messages", count(c.bad_messages));
    if (c.queue_full) text += format(", %llu commands dropped by a full queue", count(c.queue_full));
    if (c.bus_errors) text += format(", %llu bus errors", count(c.bus_errors));
    if (c.overflows) text += format(", %llu lost in the kernel's queue", count(c.overflows));
    if (table_ == &kSocketCanTransport) text += can_counters();
    if (lcm_.challenged > MessageSeal::kMeetingMessages) text += format(", %llu challenged", count(lcm_.challenged));
    if (lcm_.repeated_answers) text += format(", %llu answers sent again", count(lcm_.repeated_answers));
    if (options_.kind == "lcm" && lcm_.refusal) text += std::string("; last refused: ") + lcm_.refusal;
    return text;
  }

 private:
  static unsigned long long count(std::uint64_t n) { return n; }

  std::string can_counters() const {
    const SocketCanCounters& c = can_.bus_counters;
    std::string text = std::string(", times of arrival by ") + stamp_source_text(can_.stamps);
    if (c.held_back) text += format(", %llu commands held back by a stuck bus", count(c.held_back));
    if (c.foreign) text += format(", %llu set points of another program", count(c.foreign));
    if (c.bus_offs) text += format(", %llu times bus-off", count(c.bus_offs));
    if (const char* why = socketcan_fault_text(&can_)) text += std::string("; ") + why;
    return text;
  }

  tiller_status_t open_lcm(OpenError& problem) {
    LcmOptions lcm;
    lcm.url = robot_.transport.url.c_str();
    lcm.channel_prefix = robot_.transport.channel_prefix.c_str();
    lcm.measurement_count = robot_.config.measurement_count;
    lcm.input_count = robot_.model->input_count;
    lcm.stamp_on_arrival = robot_.transport.stamp_on_arrival && !options_.lockstep;
    lcm.lockstep = options_.lockstep;
    lcm.liblcm = robot_.transport.liblcm;
    lcm.replay_window_us = std::llround(1e6 * robot_.transport.replay_window_s);
    std::uint8_t key[MessageSeal::kKeyBytes];
    if (!robot_.transport.key_file.empty()) {
      const tiller_status_t status = read_key_file(robot_.transport.key_file.c_str(), key, &problem);
      if (status != tiller_status_ok) return status;
      lcm.key = key;
    }
    table_ = &kLcmTransport;
    self_ = &lcm_;
    return lcm_transport_open(&lcm_, lcm, &problem);
  }

  tiller_status_t open_can(OpenError& problem) {
    SocketCanOptions can;
    can.interface = robot_.transport.interface.c_str();
    can.layout = can_layout(robot_);
    if (options_.lockstep) can.layout.stamp_on_arrival = false;
    table_ = &kSocketCanTransport;
    self_ = &can_;
    const tiller_status_t status = socketcan_open(&can_, can, &problem);
    asks_ = status == tiller_status_ok && can_.robot.needs_asking();
    return status;
  }

  /// True when something fresh or a fault is in `sensed`.
  bool look(Sensed& sensed) {
    const tiller_status_t status = table_->poll(self_, &sensed.measurement);
    sensed.fresh = status == tiller_status_ok;
    sensed.fault = sensed.fresh || status == tiller_status_no_new_measurement ? tiller_status_ok : status;
    return sensed.fresh || sensed.fault != tiller_status_ok;
  }

  /// Sleeps on the descriptor until something arrives or `until_us` (monotonic) has passed.
  bool wait_until(std::int64_t until_us, const volatile std::sig_atomic_t& stop, Sensed& sensed) {
    while (stop == 0) {
      if (look(sensed)) return sensed.fresh || !faulted_;
      const std::int64_t left_us = until_us - monotonic_us();
      if (left_us <= 0) return false;
      pollfd descriptor = {table_->descriptor(self_), POLLIN, 0};
      const int wait_ms = static_cast<int>((std::min(left_us, kLookUpUs) + 999) / 1000);
      (void)::poll(&descriptor, descriptor.fd >= 0 ? 1 : 0, wait_ms);
    }
    return false;
  }

  /// A tick follows each measurement; without one, it comes half a period late, then every period.
  Sensed wait_real_time(const volatile std::sig_atomic_t& stop) {
    Sensed sensed;
    const std::int64_t last_us = last_us_ ? last_us_ : monotonic_us();
    if (asks_) ask_at(last_us + period_us_, stop);
    const std::int64_t margin_us = missed_ ? 0 : period_us_ / 2;
    const bool came = wait_until(last_us + period_us_ + margin_us, stop, sensed);
    missed_ = !came;
    note_fault(sensed, last_us + period_us_);
    last_us_ = sensed.now_us = monotonic_us();
    if (sensed.fresh) foresee_latency(sensed);
    return sensed;
  }

  /// Drives that speak only when spoken to keep no time: a tick begins by the clock, with the question.
  void ask_at(std::int64_t due_us, const volatile std::sig_atomic_t& stop) {
    for (std::int64_t left_us; stop == 0 && (left_us = due_us - monotonic_us()) > 0;)
      (void)::poll(nullptr, 0, static_cast<int>((std::min(left_us, kLookUpUs) + 999) / 1000));
    (void)socketcan_ask(&can_);
  }

  /// At absolute times, with what came since the last one. A transport that fails at every look does no harm here.
  Sensed wait_clock(const volatile std::sig_atomic_t& stop) {
    Sensed sensed;
    (void)timer_.wait(&stop);
    if (asks_) {  // drives that speak only when spoken to have half a period for their answer
      (void)socketcan_ask(&can_);
      (void)wait_until(timer_.due_ns() / 1000 + period_us_ / 2, stop, sensed);
    } else {
      (void)look(sensed);
    }
    last_us_ = sensed.now_us = monotonic_us();
    if (sensed.fresh) foresee_latency(sensed);
    return sensed;
  }

  /// A command acts after the tick that computes it, not at the stamp that it answers. Robots seldom say how much
  /// later; unaccounted for, 1.5 ms at a 20 ms period pull the friction of the cart-pole by several standard
  /// deviations.
  void foresee_latency(Sensed& sensed) {
    const double age_us = static_cast<double>(sensed.now_us - sensed.measurement.stamp_us);
    const double latency_us = std::clamp(age_us + compute_us_, 0.0, 1e6);
    std::uint32_t& told_us = sensed.measurement.command_latency_us;
    latency_.note(told_us, latency_us);
    if (told_us == 0) told_us = static_cast<std::uint32_t>(latency_us);
  }

  /// The first wait has no measurement to count from: it returns nothing fresh and time stands still.
  Sensed wait_lockstep(const volatile std::sig_atomic_t& stop) {
    Sensed sensed;
    const std::int64_t patience_us = std::llround(1e6 * options_.patience_s);
    const bool came = wait_until(monotonic_us() + (missed_ ? period_us_ : patience_us), stop, sensed);
    missed_ = !came;
    note_fault(sensed, monotonic_us() + period_us_);
    if (sensed.fresh) last_us_ = std::max(last_us_, sensed.measurement.stamp_us);
    if (!sensed.fresh && last_us_ != 0) last_us_ += period_us_;
    sensed.now_us = last_us_;
    return sensed;
  }

  /// A broken transport answers every poll at once: pace the loop by the clock then.
  void note_fault(const Sensed& sensed, std::int64_t until_us) {
    const bool was = faulted_;
    faulted_ = sensed.fault != tiller_status_ok;
    if (!faulted_ || !was) return;
    const std::int64_t left_us = until_us - monotonic_us();
    if (left_us > 0) (void)::poll(nullptr, 0, static_cast<int>(left_us / 1000));
  }

  const RobotFile& robot_;
  TransportLinkOptions options_;
  std::int64_t period_us_;
  PeriodicTimer timer_;
  LatencyWatch latency_;
  const tiller_transport_t* table_ = nullptr;
  void* self_ = nullptr;
  LcmTransport lcm_;
  SocketCanTransport can_;
  std::int64_t last_us_ = 0;
  double compute_us_ = 0;  // what a tick takes
  bool asks_ = false;      // drives must be asked before each tick
  bool missed_ = false;
  bool faulted_ = false;
};

}  // namespace

std::unique_ptr<Link> make_transport_link(const RobotFile& robot, const TransportLinkOptions& options,
                                          std::string& error) {
  auto link = std::make_unique<TransportLink>(robot, options);
  if (!link->open(error)) return nullptr;
  return link;
}

}  // namespace tiller::tools
