// What [transport] says of a drive, as io/ takes it.

#include "tools/robot/drive_settings.hpp"

namespace tiller::tools {
namespace {

template <class E, std::size_t N>
bool find_word(const char* what, const std::string& word, const char* const (&names)[N], E& value, std::string& error) {
  const int at = index_of(words_of(names), word);
  if (at >= 0) {
    value = static_cast<E>(at);
    return true;
  }
  error = "'" + word + "' is no " + what + "; write one of: " + join(words_of(names));
  return false;
}

}  // namespace

Words actuator_words() {
  Words words;
  for (std::size_t i = 0; i < static_cast<std::size_t>(ActuatorKind::count); ++i)
    words.emplace_back(actuator_name(static_cast<ActuatorKind>(i)).word);
  return words;
}

Words actuators_with(ActuatorCapability capability) {
  Words words;
  for (const std::string& word : actuator_words()) {
    ActuatorKind kind{};
    if (find_actuator(word.c_str(), kind) && (actuator_protocol(kind).capabilities & capability) != 0)
      words.push_back(word);
  }
  return words;
}

bool drive_settings(const DriveSection& drive, std::uint32_t node, ActuatorSettings& settings, std::string& error) {
  settings = ActuatorSettings();
  if (!find_actuator(drive.actuator.c_str(), settings.kind)) {
    error = "'" + drive.actuator + "' is no actuator; write one of: " + join(actuator_words());
    return false;
  }
  settings.node = node;
  settings.watchdog_s = drive.watchdog_s;
  settings.range = {drive.position_rad, drive.velocity_rad_s, drive.torque_Nm, drive.kp_max, drive.kd_max};
  settings.reply_id = drive.reply_id;
  settings.kp_Nm_rad = drive.kp_Nm_rad;
  settings.kd_Nms_rad = drive.kd_Nms_rad;
  return find_word("command", drive.command, kActuatorModeNames, settings.mode, error) &&
         find_word("resolution", drive.resolution, kMoteusResolutionNames, settings.resolution, error) &&
         find_word("reply", drive.reply, kMitReplyNames, settings.reply, error);
}

}  // namespace tiller::tools
