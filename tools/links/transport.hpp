#pragma once

#include <memory>
#include <string>

#include "io/open_error.hpp"
#include "tiller/transport.h"
#include "tools/links/link.hpp"

namespace tiller::tools {

/// One transport of transports.def, as far as the link needs more of it than its table of functions.
class HostTransport {
 public:
  virtual ~HostTransport() = default;
  /// Once. Where it fails, nothing stays open.
  virtual tiller_status_t open(const RobotFile& robot, const TransportLinkOptions& options, OpenError& problem) = 0;

  virtual const tiller_transport_t& table() const = 0;
  virtual void* self() = 0;

  /// Before the robot may move, see Link.
  virtual void keep_off(bool /*on*/) {}
  virtual void prepare(bool /*on*/) {}
  virtual bool is_ready() const { return true; }
  /// Devices that speak only when spoken to: a tick begins with the question.
  virtual bool asks() const { return false; }
  virtual void ask() {}
  /// Whether measurements can say when a command takes hold.
  virtual bool tells_latency() const { return false; }
  virtual void tell(const RobotFile&, const tiller_info_t&, std::int64_t, const LogState&) {}
  /// Counters beyond tiller_transport_counters_t: ", 3 challenged".
  virtual std::string more_counters() const { return ""; }
};

/// By its name in transports.def; null for another.
std::unique_ptr<HostTransport> make_transport(const std::string& name);

}  // namespace tiller::tools
