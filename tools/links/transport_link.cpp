#include "tools/links/transport_link.hpp"

#include <poll.h>

#include <algorithm>
#include <cmath>

#include "io/monotonic_clock.hpp"
#include "tools/robot/section_reader.hpp"
#include "tools/robot/transport_names.hpp"

namespace tiller::tools {

namespace {

constexpr std::int64_t kLookUpUs = 50000;  // how long a wait may last before the stop flag is looked at

unsigned long long count(std::uint64_t n) { return n; }

std::unique_ptr<TransportLink> make_link(const RobotFile& robot, const TransportLinkOptions& options) {
#define TILLER_TRANSPORT(name, alias, help) \
  if (options.kind == #name) return make_##name##_link(robot, options);
#include "tools/robot/transports.def"
  return nullptr;
}

}  // namespace

TransportLink::TransportLink(const RobotFile& robot, const TransportLinkOptions& options,
                             const tiller_transport_t& table, void* device)
    : robot_(robot),
      options_(options),
      table_(table),
      device_(device),
      period_us_(std::llround(1e6 * robot.config.period_s)),
      timer_(std::llround(1e9 * robot.config.period_s)),
      latency_(robot.config.period_s) {}

Sensed TransportLink::wait(const volatile std::sig_atomic_t& stop) {
  if (options_.lockstep) return wait_lockstep(stop);
  return options_.by_clock ? wait_clock(stop) : wait_real_time(stop);
}

void TransportLink::tell(const tiller_info_t& info, std::int64_t, const LogState&) {
  // mean over about ten ticks: one that was held up by the machine says little of the next
  compute_us_ += 0.1 * (1e-3 * static_cast<double>(info.tick_ns) - compute_us_);
}

std::string TransportLink::counters() const {
  tiller_transport_counters_t c{};
  table_.counters(device_, &c);
  std::string text = format("%s: %llu received, %llu sent", table_.name, count(c.received), count(c.sent));
  if (c.dropped_old) text += format(", %llu superseded", count(c.dropped_old));
  if (c.bad_messages) text += format(", %llu bad messages", count(c.bad_messages));
  if (c.queue_full) text += format(", %llu commands dropped by a full queue", count(c.queue_full));
  if (c.bus_errors) text += format(", %llu bus errors", count(c.bus_errors));
  if (c.overflows) text += format(", %llu lost in the kernel's queue", count(c.overflows));
  return text;
}

/// True when something fresh or a fault is in `sensed`.
bool TransportLink::look(Sensed& sensed) {
  const tiller_status_t status = table_.poll(device_, &sensed.measurement);
  sensed.fresh = status == tiller_status_ok;
  sensed.fault = sensed.fresh || status == tiller_status_no_new_measurement ? tiller_status_ok : status;
  return sensed.fresh || sensed.fault != tiller_status_ok;
}

/// Sleeps on the descriptor until something arrives or `until_us` (monotonic) has passed.
bool TransportLink::wait_until(std::int64_t until_us, const volatile std::sig_atomic_t& stop, Sensed& sensed) {
  while (stop == 0) {
    if (look(sensed)) return sensed.fresh || !faulted_;
    const std::int64_t left_us = until_us - monotonic_us();
    if (left_us <= 0) return false;
    pollfd descriptor = {table_.descriptor(device_), POLLIN, 0};
    const int wait_ms = static_cast<int>((std::min(left_us, kLookUpUs) + 999) / 1000);
    (void)::poll(&descriptor, descriptor.fd >= 0 ? 1 : 0, wait_ms);
  }
  return false;
}

/// A tick follows each measurement; without one, it comes half a period late, then every period.
Sensed TransportLink::wait_real_time(const volatile std::sig_atomic_t& stop) {
  Sensed sensed;
  const std::int64_t last_us = last_us_ ? last_us_ : monotonic_us();
  if (asks()) ask_at(last_us + period_us_, stop);
  const std::int64_t margin_us = missed_ ? 0 : period_us_ / 2;
  const bool came = wait_until(last_us + period_us_ + margin_us, stop, sensed);
  missed_ = !came;
  note_fault(sensed, last_us + period_us_);
  last_us_ = sensed.now_us = monotonic_us();
  if (sensed.fresh) predict_latency(sensed);
  return sensed;
}

/// Drives that speak only when spoken to keep no time: a tick begins by the clock, with the question.
void TransportLink::ask_at(std::int64_t due_us, const volatile std::sig_atomic_t& stop) {
  for (std::int64_t left_us; stop == 0 && (left_us = due_us - monotonic_us()) > 0;)
    (void)::poll(nullptr, 0, static_cast<int>((std::min(left_us, kLookUpUs) + 999) / 1000));
  ask();
}

/// At absolute times, with what came since the last one. A transport that fails at every look does no harm here.
Sensed TransportLink::wait_clock(const volatile std::sig_atomic_t& stop) {
  Sensed sensed;
  (void)timer_.wait(&stop);
  if (asks()) {  // drives that speak only when spoken to have half a period for their answer
    ask();
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
void TransportLink::predict_latency(Sensed& sensed) {
  const double age_us = static_cast<double>(sensed.now_us - sensed.measurement.stamp_us);
  const double latency_us = std::clamp(age_us + compute_us_, 0.0, 1e6);
  std::uint32_t& told_us = sensed.measurement.command_latency_us;
  latency_.note(told_us, latency_us);
  if (told_us == 0) told_us = static_cast<std::uint32_t>(latency_us);
}

/// The first wait has no measurement to count from: it returns nothing fresh and time stands still.
Sensed TransportLink::wait_lockstep(const volatile std::sig_atomic_t& stop) {
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
void TransportLink::note_fault(const Sensed& sensed, std::int64_t until_us) {
  const bool was = faulted_;
  faulted_ = sensed.fault != tiller_status_ok;
  if (!faulted_ || !was) return;
  const std::int64_t left_us = until_us - monotonic_us();
  if (left_us > 0) (void)::poll(nullptr, 0, static_cast<int>(left_us / 1000));
}

std::unique_ptr<Link> make_transport_link(const RobotFile& robot, const TransportLinkOptions& options,
                                          std::string& error) {
  const int line = robot.transport.line;  // 0: the file has no such section, the command line named the transport
  const std::string where = robot.path + (line > 0 ? ":" + std::to_string(line) : "") + ": [transport] ";
  std::unique_ptr<TransportLink> link = make_link(robot, options);
  if (!link) {
    error = where + remedy_for_unknown(options.kind, transport_words()) + "\n";
    return nullptr;
  }
  OpenError problem;
  const tiller_status_t status = link->open(problem);
  if (status == tiller_status_ok) return link;
  error = where + (problem.text[0] ? problem.text : tiller_status_text(status)) + "\n";
  return nullptr;
}

}  // namespace tiller::tools
