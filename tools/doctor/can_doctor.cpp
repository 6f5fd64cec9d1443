#include "tools/doctor/can_doctor.hpp"

#include <algorithm>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tools/base/text.hpp"

namespace tiller::tools {
namespace {

using nlohmann::json;

constexpr std::int64_t kFdMtu = 72;
constexpr std::int64_t kShortQueue = 16, kLongQueue = 256;
constexpr double kBusyLoad = 0.5, kFullLoad = 0.8;

/// A member of an object, or null.
const json& member(const json& object, const char* key) {
  static const json none;
  if (!object.is_object()) return none;
  const auto found = object.find(key);
  return found == object.end() ? none : *found;
}

std::int64_t whole(const json& object, const char* key, std::int64_t otherwise) {
  const json& value = member(object, key);
  return value.is_number() ? static_cast<std::int64_t>(value.get<double>()) : otherwise;
}

std::string word(const json& object, const char* key) {
  const json& value = member(object, key);
  return value.is_string() ? value.get<std::string>() : std::string();
}

/// Editions of ip print it as a number or as text.
double sample_point(const json& timing) {
  const json& value = member(timing, "sample_point");
  if (value.is_number()) return value.get<double>();
  return value.is_string() ? std::strtod(value.get<std::string>().c_str(), nullptr) : -1;
}

std::vector<std::string> words(const json& list) {
  std::vector<std::string> all;
  if (!list.is_array()) return all;
  for (const json& entry : list)
    if (entry.is_string()) all.push_back(entry.get<std::string>());
  return all;
}

void read_controller(const json& data, CanLinkState& link) {
  link.state = word(data, "state");
  link.modes = words(member(data, "ctrlmode"));
  link.restart_ms = whole(data, "restart_ms", -1);
  const json& timing = member(data, "bittiming");
  link.bitrate = whole(timing, "bitrate", whole(data, "bittiming_bitrate", -1));
  link.sample_point = sample_point(timing);
  const json& data_timing = member(data, "data_bittiming");
  link.data_bitrate = whole(data_timing, "bitrate", whole(data, "data_bittiming_bitrate", -1));
  link.data_sample_point = sample_point(data_timing);
  const json& errors = member(data, "berr_counter");
  link.send_errors = whole(errors, "tx", -1);
  link.receive_errors = whole(errors, "rx", -1);
}

void read_counters(const json& entry, const json& info, CanLinkState& link) {
  const json& xstats = member(info, "info_xstats");
  link.restarts = whole(xstats, "restarts", 0);
  link.bus_offs = whole(xstats, "bus_off", 0);
  link.times_passive = whole(xstats, "error_passive", 0);
  link.bus_errors = whole(xstats, "bus_error", 0);
  const json& stats = member(entry, member(entry, "stats64").is_object() ? "stats64" : "stats");
  const json &rx = member(stats, "rx"), &tx = member(stats, "tx");
  link.frames = whole(rx, "packets", 0) + whole(tx, "packets", 0);
  link.bytes = whole(rx, "bytes", 0) + whole(tx, "bytes", 0);
  link.receive_dropped = whole(rx, "dropped", 0);
  link.receive_overruns = whole(rx, "over_errors", 0);
  link.send_dropped = whole(tx, "dropped", 0);
}

/// Collects findings about one link; commands are written out with its name.
class Examination {
 public:
  Examination(const CanLinkState& link, const CanDemand& demand) : link_(link), demand_(demand) {}

  std::vector<CanFinding> run() {
    if (!is_can()) return findings_;
    up();
    if (!link_.is_virtual()) controller();
    flexible_rate();
    queue();
    if (!link_.is_virtual()) history();
    losses();
    return findings_;
  }

 private:
  void say(Severity severity, std::string what, std::string remedy = "") {
    findings_.push_back({severity, std::move(what), std::move(remedy)});
  }
  std::string set(const std::string& what) const { return "sudo ip link set " + link_.name + " " + what; }
  /// Settings of the controller take effect while the interface is down.
  std::string set_controller(const std::string& what) const { return set("down") + "; " + set("up type can " + what); }

  bool is_can() {
    if (link_.kind == "can" || link_.kind == "vcan" || link_.kind == "vxcan") {
      say(Severity::good, link_.name + (link_.is_virtual() ? " is a virtual CAN interface (" + link_.kind + ")"
                                                           : " is a CAN interface"));
      return true;
    }
    say(Severity::failure, link_.name + " is not a CAN interface", "ip -brief link lists them all");
    return false;
  }

  void up() {
    if (link_.up) return say(Severity::good, "it is up");
    if (link_.is_virtual()) return say(Severity::failure, "it is down", set("up"));
    say(Severity::failure, "it is down",
        link_.bitrate > 0 ? set("up") : set("up type can bitrate 500000 restart-ms 100") + " (your bus's bit rate)");
  }

  void controller() {
    state();
    bit_rate();
    restart();
    modes();
  }

  void state() {
    const std::string wiring = "look at wiring, termination (60 Ohm between CAN_H and CAN_L), power and bit rate";
    if (link_.state == "ERROR-ACTIVE") return say(Severity::good, "the controller is error-active");
    if (link_.state == "ERROR-WARNING")
      return say(Severity::warning, "the controller counts errors (error-warning)", wiring);
    if (link_.state == "ERROR-PASSIVE")
      return say(Severity::failure, "the controller is error-passive: nobody acknowledges, or many frames are damaged",
                 wiring + "; is any other node on the bus and awake?");
    if (link_.state == "BUS-OFF")
      return say(Severity::failure, "the controller is bus-off",
                 wiring + ", then " + set("type can restart") + " (only where restart-ms is 0)");
    if (link_.state == "STOPPED" && !link_.up) return;  // said already
    if (!link_.state.empty())
      say(Severity::warning, "the controller's state is " + link_.state, set("down") + "; " + set("up"));
  }

  void bit_rate() {
    if (link_.bitrate <= 0)
      return say(Severity::failure, "no bit rate is set", set_controller("bitrate 500000") + " (your bus's bit rate)");
    std::string text = "bit rate " + std::to_string(link_.bitrate);
    if (link_.sample_point > 0) text += ", sample point " + number_text(link_.sample_point);
    if (link_.sample_point > 0 && (link_.sample_point < 0.7 || link_.sample_point > 0.9))
      return say(Severity::warning, text + ": most nodes sample at 0.8 to 0.875",
                 set_controller("bitrate " + std::to_string(link_.bitrate) + " sample-point 0.875"));
    say(Severity::good, text);
  }

  void restart() {
    if (link_.restart_ms > 0)
      return say(Severity::good, "restarts " + std::to_string(link_.restart_ms) + " ms after bus-off");
    if (link_.restart_ms == 0)
      say(Severity::warning, "it stays bus-off until somebody restarts it (restart-ms 0)",
          set_controller("restart-ms 100"));
  }

  void modes() {
    if (link_.has_mode("LISTEN-ONLY"))
      say(Severity::failure, "it only listens: nothing can be sent", set_controller("listen-only off"));
    if (link_.has_mode("LOOPBACK"))
      say(Severity::failure, "its frames do not leave the controller (loopback)", set_controller("loopback off"));
    if (link_.has_mode("ONE-SHOT"))
      say(Severity::warning, "a frame that loses arbitration is not sent again (one-shot)",
          set_controller("one-shot off"));
    if (link_.has_mode("PRESUME-ACK"))
      say(Severity::warning, "it believes in acknowledgements that nobody gave (presume-ack)",
          set_controller("presume-ack off"));
    if (link_.has_mode("FD-NON-ISO"))
      say(Severity::warning, "it speaks CAN FD before ISO 11898-1:2015, which nearly nobody does",
          set_controller("fd-non-iso off"));
  }

  void flexible_rate() {
    const bool fd = link_.mtu >= kFdMtu;
    const std::string remedy = link_.is_virtual() ? set("down") + "; " + set("mtu 72 up")
                                                  : set_controller("bitrate 1000000 dbitrate 5000000 fd on");
    if (demand_.fd && !fd) return say(Severity::failure, "it carries no CAN FD, which these motors need", remedy);
    if (!fd) return say(Severity::good, "classic CAN, 8 bytes a frame");
    std::string text = "CAN FD";
    if (link_.data_bitrate > 0) text += ", data at " + std::to_string(link_.data_bitrate);
    if (link_.data_sample_point > 0) text += ", sample point " + number_text(link_.data_sample_point);
    say(Severity::good, text);
  }

  void queue() {
    if (link_.queue_discipline == "netem")
      say(Severity::warning, "netem delays or loses frames here: for tests only",
          "sudo tc qdisc del dev " + link_.name + " root");
    const std::string text = "send queue of " + std::to_string(link_.queue_length) + " frames";
    if (link_.queue_discipline == "noqueue" || link_.queue_length < 0) return say(Severity::good, "no send queue");
    const std::int64_t wanted = std::max(kShortQueue, 2 * demand_.frames_per_tick);
    if (link_.queue_length < wanted)
      return say(Severity::warning, text + ": a burst of all motors' commands may not fit",
                 set("txqueuelen " + std::to_string(std::max<std::int64_t>(64, 2 * wanted))));
    if (link_.queue_length > kLongQueue)
      return say(Severity::warning, text + ": a bus that stands still keeps that many old commands",
                 set("txqueuelen 64"));
    say(Severity::good, text);
  }

  void history() {
    if (link_.send_errors > 95 || link_.receive_errors > 95)
      say(Severity::warning,
          "error counters: " + std::to_string(link_.send_errors) + " sending, " + std::to_string(link_.receive_errors) +
              " receiving (96 warns, 128 is passive)",
          "look at wiring, termination and bit rate");
    if (link_.bus_offs > 0 || link_.restarts > 0)
      say(Severity::warning,
          "it was bus-off " + std::to_string(link_.bus_offs) + " times and restarted " +
              std::to_string(link_.restarts) + " times since the driver was loaded",
          "look at wiring and termination before the robot moves");
    else if (link_.times_passive > 0)
      say(Severity::remark,
          "it was error-passive " + std::to_string(link_.times_passive) + " times since the driver was loaded");
    if (link_.bus_errors > 0) say(Severity::remark, std::to_string(link_.bus_errors) + " bus errors so far");
  }

  void losses() {
    if (link_.receive_overruns > 0)
      say(Severity::warning, std::to_string(link_.receive_overruns) + " frames were lost in the controller (overruns)",
          "give its interrupt a core of its own, or filter in hardware");
    if (link_.receive_dropped > 0)
      say(Severity::remark, std::to_string(link_.receive_dropped) + " frames were dropped on receiving");
    if (link_.send_dropped > 0)
      say(Severity::remark,
          std::to_string(link_.send_dropped) + " frames were dropped on sending: by a full queue or bus-off");
  }

  const CanLinkState& link_;
  const CanDemand& demand_;
  std::vector<CanFinding> findings_;
};

const char* mark(Severity severity) {
  switch (severity) {
    case Severity::good: return "ok  ";
    case Severity::remark: return "note";
    case Severity::warning: return "WARN";
    case Severity::failure: return "FAIL";
  }
  return "";
}

}  // namespace

bool CanLinkState::has_mode(const std::string& mode) const {
  return std::find(modes.begin(), modes.end(), mode) != modes.end();
}

bool parse_can_link(const std::string& text, CanLinkState& link, std::string& error) {
  const json parsed = json::parse(text, nullptr, false);
  if (!parsed.is_array() || parsed.empty() || !parsed[0].is_object() || word(parsed[0], "ifname").empty()) {
    error = "no description of an interface in the output of ip -details -statistics -json link show";
    return false;
  }
  const json& entry = parsed[0];
  const json& info = member(entry, "linkinfo");
  link = CanLinkState();
  link.name = word(entry, "ifname");
  link.kind = word(info, "info_kind");
  const std::vector<std::string> flags = words(member(entry, "flags"));
  link.up = std::find(flags.begin(), flags.end(), "UP") != flags.end();
  link.queue_discipline = word(entry, "qdisc");
  link.mtu = whole(entry, "mtu", -1);
  link.queue_length = whole(entry, "txqlen", -1);
  read_controller(member(info, "info_data"), link);
  read_counters(entry, info, link);
  return true;
}

std::vector<CanFinding> examine_can_link(const CanLinkState& link, const CanDemand& demand) {
  return Examination(link, demand).run();
}

// A classic frame with an 11-bit identifier has 47 bits beside its data, the pause between frames included.
double can_load(const CanLinkState& before, const CanLinkState& after, double seconds) {
  if (before.bitrate <= 0 || !(seconds > 0)) return -1;
  const double frames = static_cast<double>(after.frames - before.frames);
  const double bytes = static_cast<double>(after.bytes - before.bytes);
  return 1.1 * (47 * frames + 8 * bytes) / (static_cast<double>(before.bitrate) * seconds);
}

CanFinding examine_can_load(double load) {
  const std::string text = "the bus is in use " + number_text(std::round(1000 * load) / 10) + " % of the time";
  if (load > kFullLoad)
    return {Severity::failure, text + ": low priorities hardly get through",
            "a higher bit rate, fewer periodic reports of the drives, or a second bus"};
  if (load > kBusyLoad)
    return {Severity::warning, text + ": frames wait for each other",
            "a higher bit rate, or fewer periodic reports of the drives"};
  return {Severity::good, text, ""};
}

void count_can_listeners(const std::string& file, const std::string& text, const std::string& name,
                         CanListeners& listeners) {
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream columns(line);
    std::string first;
    if (!(columns >> first) || first != name) continue;
    if (file == "rcvlist_all")
      ++listeners.everything;
    else if (file == "rcvlist_err")
      ++listeners.errors;
    else
      ++listeners.filters;
  }
}

CanFinding describe_can_listeners(const CanListeners& listeners) {
  const std::string text = std::to_string(listeners.filters) + " filters, " + std::to_string(listeners.everything) +
                           " listeners to everything, " + std::to_string(listeners.errors) + " to error frames";
  if (listeners.everything > 2)
    return {Severity::remark, text + ": each of these is given every frame",
            "close what is not needed (candump, loggers)"};
  return {Severity::good, text, ""};
}

Severity worst(const std::vector<CanFinding>& findings) {
  Severity all = Severity::good;
  for (const CanFinding& finding : findings) all = std::max(all, finding.severity);
  return all;
}

std::string can_findings_text(const std::vector<CanFinding>& findings) {
  std::string text;
  for (const CanFinding& finding : findings) {
    text += std::string(mark(finding.severity)) + "  " + finding.what + "\n";
    if (!finding.remedy.empty()) text += "      -> " + finding.remedy + "\n";
  }
  return text;
}

std::string can_findings_json(const std::string& name, const std::vector<CanFinding>& findings) {
  static const char* const names[] = {"good", "remark", "warning", "failure"};
  json list = json::array();
  for (const CanFinding& f : findings)
    list.push_back({{"severity", names[static_cast<int>(f.severity)]}, {"what", f.what}, {"remedy", f.remedy}});
  return json{{"interface", name}, {"worst", names[static_cast<int>(worst(findings))]}, {"findings", list}}.dump(2) +
         "\n";
}

}  // namespace tiller::tools
