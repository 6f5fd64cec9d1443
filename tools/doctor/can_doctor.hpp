#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace tiller::tools {

/// A CAN interface as `ip -details -statistics -json link show` describes it. Negative numbers: not told.
struct CanLinkState {
  std::string name, kind;  ///< kind: "can", "vcan", "vxcan"; another link's or empty: none of them
  bool up = false;
  std::string state;               ///< "ERROR-ACTIVE", "BUS-OFF", ...; empty: a virtual one has none
  std::vector<std::string> modes;  ///< "FD", "LISTEN-ONLY", ...
  std::string queue_discipline;
  std::int64_t mtu = -1, queue_length = -1, restart_ms = -1;
  std::int64_t bitrate = -1, data_bitrate = -1;
  double sample_point = -1, data_sample_point = -1;
  std::int64_t send_errors = -1, receive_errors = -1;  ///< the controller's own counters, of 256
  std::int64_t restarts = 0, bus_offs = 0, times_passive = 0, bus_errors = 0;
  std::int64_t frames = 0, bytes = 0;  ///< in and out, since the interface exists
  std::int64_t receive_dropped = 0, receive_overruns = 0, send_dropped = 0;

  bool has_mode(const std::string& mode) const;
  bool is_virtual() const { return kind != "can"; }
};

/// Reads the output of ip (a list of one link). False with the reason in `error`.
bool parse_can_link(const std::string& json, CanLinkState& link, std::string& error);

/// The expected settings of the bus; zeros: not known.
struct CanDemand {
  bool fd = false;                   ///< CAN FD frames
  std::int64_t frames_per_tick = 0;  ///< sent at once
};

enum class Severity { good, remark, warning, failure };

struct CanFinding {
  Severity severity = Severity::good;
  std::string what;
  std::string remedy;  ///< a command, or what to look at; empty where nothing is to be done
};

/// Every check, in the order in which one would look.
std::vector<CanFinding> examine_can_link(const CanLinkState& link, const CanDemand& demand);

/// The share of the bus that was in use between two readings, 0..1; with the bits that stuffing adds on average (a
/// tenth). Negative where the bit rate is not known.
double can_load(const CanLinkState& before, const CanLinkState& after, double seconds);
CanFinding examine_can_load(double load);

/// Raw receive lists of the kernel (/proc/net/can/rcvlist_*): programs that listen on this interface.
struct CanListeners {
  int filters = 0;     ///< that let one identifier or a mask pass
  int everything = 0;  ///< that take all
  int errors = 0;      ///< that take error frames
};
/// Adds the entries of one such file for `name`.
void count_can_listeners(const std::string& file, const std::string& text, const std::string& name,
                         CanListeners& listeners);
CanFinding describe_can_listeners(const CanListeners& listeners);

Severity worst(const std::vector<CanFinding>& findings);
std::string can_findings_text(const std::vector<CanFinding>& findings);
std::string can_findings_json(const std::string& name, const std::vector<CanFinding>& findings);

}  // namespace tiller::tools
