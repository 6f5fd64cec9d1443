#include <poll.h>

#include <algorithm>
#include <cmath>

#include "io/monotonic_clock.hpp"
#include "tools/links/latency_watch.hpp"
#include "tools/links/transport.hpp"
#include "tools/robot/section_reader.hpp"
#include "tools/robot/transport_names.hpp"

namespace tiller::tools {
namespace {

constexpr std::int64_t kLookUpUs = 50000;  // how long a wait may last before the stop flag is looked at

std::string where(const RobotFile& robot) {
  const int line = robot.transport.line;  // 0: the file has no such section, the command line named the transport
  return robot.path + (line > 0 ? ":" + std::to_string(line) : "") + ": [transport] ";
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
    if (table_) table_->close(transport_->self());
  }

  bool open(std::string& error) {
    OpenError problem;
    transport_ = make_transport(options_.kind);
    if (!transport_) {
      error = where(robot_) + remedy_for_unknown(options_.kind, transport_words()) + "\n";
      return false;
    }
    const tiller_status_t status = transport_->open(robot_, options_, problem);
    if (status == tiller_status_ok) {
      table_ = &transport_->table();
      transport_->keep_off(options_.kept_off);
      return true;
    }
    const std::string text = problem.text[0] ? problem.text : tiller_status_text(status);
    error = where(robot_) + text + "\n";
    return false;
  }

  Sensed wait(const volatile std::sig_atomic_t& stop) override {
    if (options_.lockstep) return wait_lockstep(stop);
    return options_.by_clock ? wait_clock(stop) : wait_real_time(stop);
  }

  tiller_status_t send(const tiller_command_t& command) override { return table_->send(transport_->self(), &command); }
  bool truth(double*) const override { return false; }
  void permit() override { transport_->keep_off(false); }
  void prepare(bool on) override { transport_->prepare(on); }
  bool is_ready() const override { return transport_->is_ready(); }
  const PeriodicTimer* timer() const override { return options_.by_clock && !options_.lockstep ? &timer_ : nullptr; }

  void tell(const tiller_info_t& info, std::int64_t stamp_us, const LogState& log) override {
    // mean over about ten ticks: one that was held up by the machine says little of the next
    compute_us_ += 0.1 * (1e-3 * static_cast<double>(info.tick_ns) - compute_us_);
    transport_->tell(robot_, info, stamp_us, log);
  }

  std::string news() override { return latency_.news(transport_->tells_latency()); }

  std::string counters() const override {
    tiller_transport_counters_t c{};
    table_->counters(transport_->self(), &c);
    std::string text = format("%s: %llu received, %llu sent", table_->name, count(c.received), count(c.sent));
    if (c.dropped_old) text += format(", %llu superseded", count(c.dropped_old));
    if (c.bad_messages) text += format(", %llu bad messages", count(c.bad_messages));
    if (c.queue_full) text += format(", %llu commands dropped by a full queue", count(c.queue_full));
    if (c.bus_errors) text += format(", %llu bus errors", count(c.bus_errors));
    if (c.overflows) text += format(", %llu lost in the kernel's queue", count(c.overflows));
    return text + transport_->more_counters();
  }

 private:
  static unsigned long long count(std::uint64_t n) { return n; }

  /// True when something fresh or a fault is in `sensed`.
  bool look(Sensed& sensed) {
    const tiller_status_t status = table_->poll(transport_->self(), &sensed.measurement);
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
      pollfd descriptor = {table_->descriptor(transport_->self()), POLLIN, 0};
      const int wait_ms = static_cast<int>((std::min(left_us, kLookUpUs) + 999) / 1000);
      (void)::poll(&descriptor, descriptor.fd >= 0 ? 1 : 0, wait_ms);
    }
    return false;
  }

  /// A tick follows each measurement; without one, it comes half a period late, then every period.
  Sensed wait_real_time(const volatile std::sig_atomic_t& stop) {
    Sensed sensed;
    const std::int64_t last_us = last_us_ ? last_us_ : monotonic_us();
    if (transport_->asks()) ask_at(last_us + period_us_, stop);
    const std::int64_t margin_us = missed_ ? 0 : period_us_ / 2;
    const bool came = wait_until(last_us + period_us_ + margin_us, stop, sensed);
    missed_ = !came;
    note_fault(sensed, last_us + period_us_);
    last_us_ = sensed.now_us = monotonic_us();
    if (sensed.fresh) predict_latency(sensed);
    return sensed;
  }

  /// Drives that speak only when spoken to keep no time: a tick begins by the clock, with the question.
  void ask_at(std::int64_t due_us, const volatile std::sig_atomic_t& stop) {
    for (std::int64_t left_us; stop == 0 && (left_us = due_us - monotonic_us()) > 0;)
      (void)::poll(nullptr, 0, static_cast<int>((std::min(left_us, kLookUpUs) + 999) / 1000));
    transport_->ask();
  }

  /// At absolute times, with what came since the last one. A transport that fails at every look does no harm here.
  Sensed wait_clock(const volatile std::sig_atomic_t& stop) {
    Sensed sensed;
    (void)timer_.wait(&stop);
    if (transport_->asks()) {  // drives that speak only when spoken to have half a period for their answer
      transport_->ask();
      (void)wait_until(timer_.due_ns() / 1000 + period_us_ / 2, stop, sensed);
    } else {
      (void)look(sensed);
    }
    last_us_ = sensed.now_us = monotonic_us();
    if (sensed.fresh) predict_latency(sensed);
    return sensed;
  }

  /// A command acts after the tick that computes it, not at the stamp that it answers. Robots seldom say how much
  /// later; unaccounted for, 1.5 ms at a 20 ms period pull the friction of the cart-pole by several standard
  /// deviations.
  void predict_latency(Sensed& sensed) {
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
  std::unique_ptr<HostTransport> transport_;
  const tiller_transport_t* table_ = nullptr;  // null: not open
  std::int64_t last_us_ = 0;
  double compute_us_ = 0;  // what a tick takes
  bool missed_ = false;
  bool faulted_ = false;
};

}  // namespace

#define TILLER_TRANSPORT(name, alias, help) std::unique_ptr<HostTransport> make_##name##_transport();
#include "tools/robot/transports.def"

std::unique_ptr<HostTransport> make_transport(const std::string& name) {
#define TILLER_TRANSPORT(known, alias, help) \
  if (name == #known) return make_##known##_transport();
#include "tools/robot/transports.def"
  return nullptr;
}

std::unique_ptr<Link> make_transport_link(const RobotFile& robot, const TransportLinkOptions& options,
                                          std::string& error) {
  auto link = std::make_unique<TransportLink>(robot, options);
  if (!link->open(error)) return nullptr;
  return link;
}

}  // namespace tiller::tools
