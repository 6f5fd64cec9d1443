// Lines in, lines out, for actuator_reference.py: what the codecs make of numbers, and of frames.
//   settings  KIND NODE MODE RESOLUTION WATCHDOG REPLY REPLY_ID POSITION VELOCITY TORQUE KP_MAX KD_MAX KP KD
//   make      enable|disable|idle|query|clear        -> frames, "ID EXTENDED FD HEX" with spaces between frames
//   command   VALUE                                  -> the same
//   receive   ID EXTENDED FD HEX                     -> foreign | refused | taken ALIVE MODE ENABLED FAULT CODE MOTION
//   P V
//                                                       TORQUE T TEMPERATURE C
#include <cstdio>
#include <iostream>
#include <sstream>
#include <string>

#include "io/actuator.hpp"

namespace {

using namespace tiller;

template <class E, std::size_t N>
E chosen(const std::string& word, const char* const (&names)[N]) {
  int at = 0;
  for (const char* name : names) {
    if (word == name) return static_cast<E>(at);
    ++at;
  }
  std::fprintf(stderr, "unknown word %s\n", word.c_str());
  std::exit(2);
}

ActuatorSettings read_settings(std::istream& in) {
  ActuatorSettings s;
  std::string kind, mode, resolution, reply;
  in >> kind >> s.node >> mode >> resolution >> s.watchdog_s >> reply >> s.reply_id >> s.range.position_rad >>
      s.range.velocity_rad_s >> s.range.torque_Nm >> s.range.kp_Nm_rad >> s.range.kd_Nms_rad >> s.kp_Nm_rad >>
      s.kd_Nms_rad;
  if (!find_actuator(kind.c_str(), s.kind)) {
    std::fprintf(stderr, "unknown word %s\n", kind.c_str());
    std::exit(2);
  }
  s.mode = chosen<ActuatorMode>(mode, kActuatorModeNames);
  s.resolution = chosen<MoteusResolution>(resolution, kMoteusResolutionNames);
  s.reply = chosen<MitReply>(reply, kMitReplyNames);
  if (const char* error = actuator_protocol(s.kind).settings_error(s)) {
    std::fprintf(stderr, "%s\n", error);
    std::exit(2);
  }
  return s;
}

void print(const CanFrame* frames, std::uint32_t count) {
  for (std::uint32_t i = 0; i < count; ++i) {
    std::printf("%s%x %d %d ", i > 0 ? " " : "", frames[i].id, frames[i].extended, frames[i].fd);
    for (int k = 0; k < frames[i].length; ++k) std::printf("%02x", frames[i].data[k]);
  }
  std::printf("\n");
}

void make(const ActuatorSettings& s, const std::string& what) {
  const ActuatorProtocol& p = actuator_protocol(s.kind);
  CanFrame frames[ActuatorProtocol::kMaxFrames];
  const auto maker = what == "enable"    ? p.enable
                     : what == "disable" ? p.disable
                     : what == "idle"    ? p.idle
                     : what == "query"   ? p.query
                                         : p.clear_faults;
  print(frames, maker(s, frames));
}

void receive(const ActuatorSettings& s, std::istream& in) {
  CanFrame frame;
  std::string hex;
  in >> std::hex >> frame.id >> std::dec >> frame.extended >> frame.fd >> hex;
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2)
    frame.data[frame.length++] = static_cast<std::uint8_t>(std::stoi(hex.substr(i, 2), nullptr, 16));
  ActuatorReport r;
  switch (actuator_protocol(s.kind).receive(s, frame, r)) {
    case ActuatorReceipt::foreign: std::printf("foreign\n"); return;
    case ActuatorReceipt::refused: std::printf("refused\n"); return;
    case ActuatorReceipt::taken: break;
  }
  std::printf("taken %d %d %d %d %u %d %.17g %.17g %d %.17g %d %.17g\n", r.alive, r.has_mode, r.enabled, r.has_fault,
              r.fault, r.has_motion, r.position_rad, r.velocity_rad_s, r.has_torque, r.torque_Nm, r.has_temperature,
              r.temperature_C);
}

}  // namespace

int main() {
  ActuatorSettings settings;
  for (std::string line; std::getline(std::cin, line);) {
    std::istringstream in(line);
    std::string what;
    in >> what;
    if (what == "settings") {
      settings = read_settings(in);
    } else if (what == "make") {
      in >> what;
      make(settings, what);
    } else if (what == "command") {
      double value = 0.0;
      in >> value;
      CanFrame frames[ActuatorProtocol::kMaxFrames];
      print(frames, actuator_protocol(settings.kind).command(settings, value, frames));
    } else if (what == "receive") {
      receive(settings, in);
    }
  }
  return 0;
}
