#pragma once

#include <memory>
#include <string>

#include "io/open_error.hpp"
#include "tiller/transport.h"
#include "tools/links/latency_watch.hpp"
#include "tools/links/link.hpp"

namespace tiller::tools {

/// A robot behind a transport: when a tick is due, and what came for it. A transport of transports.def derives from it
/// what its table of functions does not say.
class TransportLink : public Link {
 public:
  /// `device`: the table's own struct, a member of the class that derives.
  TransportLink(const RobotFile& robot, const TransportLinkOptions& options, const tiller_transport_t& table,
                void* device);
  /// Once. Where it fails, nothing stays open.
  virtual tiller_status_t open(OpenError& problem) = 0;

  Sensed wait(const volatile std::sig_atomic_t& stop) override;
  tiller_status_t send(const tiller_command_t& command) override { return table_.send(device_, &command); }
  bool truth(double*) const override { return false; }
  const PeriodicTimer* timer() const override { return options_.by_clock && !options_.lockstep ? &timer_ : nullptr; }
  void tell(const tiller_info_t& info, std::int64_t stamp_us, const LogState& log) override;
  std::string news() override { return latency_.news(tells_latency()); }
  std::string counters() const override;

 protected:
  /// Devices that speak only when spoken to: a tick begins with the question.
  virtual bool asks() const { return false; }
  virtual void ask() {}
  /// Whether measurements can say when a command takes hold.
  virtual bool tells_latency() const { return false; }

  const RobotFile& robot_;
  const TransportLinkOptions options_;

 private:
  bool look(Sensed& sensed);
  bool wait_until(std::int64_t until_us, const volatile std::sig_atomic_t& stop, Sensed& sensed);
  Sensed wait_real_time(const volatile std::sig_atomic_t& stop);
  void ask_at(std::int64_t due_us, const volatile std::sig_atomic_t& stop);
  Sensed wait_clock(const volatile std::sig_atomic_t& stop);
  void predict_latency(Sensed& sensed);
  Sensed wait_lockstep(const volatile std::sig_atomic_t& stop);
  void note_fault(const Sensed& sensed, std::int64_t until_us);

  const tiller_transport_t& table_;
  void* device_;
  std::int64_t period_us_;
  PeriodicTimer timer_;
  LatencyWatch latency_;
  std::int64_t last_us_ = 0;
  double compute_us_ = 0;  // what a tick takes
  bool missed_ = false;
  bool faulted_ = false;
};

/// make_<name>_link() of every transport.
#define TILLER_TRANSPORT(name, alias, help) \
  std::unique_ptr<TransportLink> make_##name##_link(const RobotFile& robot, const TransportLinkOptions& options);
#include "tools/robot/transports.def"

}  // namespace tiller::tools
