#pragma once

#include "io/actuator.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// The words of io/actuators.def, and of choices below [transport] drives.
Words actuator_words();
template <std::size_t N>
Words words_of(const char* const (&names)[N]) {
  return Words(names, names + N);
}

/// A drive of a robot file as its protocol takes it, with the node. False with a sentence and the words that are known
/// where one of the section's words is none: a file that was read has none such.
bool drive_settings(const DriveSection& drive, std::uint32_t node, ActuatorSettings& settings, std::string& error);

/// The words of protocols that have the capability.
Words actuators_with(ActuatorCapability capability);

}  // namespace tiller::tools
