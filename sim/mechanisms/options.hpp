#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace tiller::sim {

struct MechanismInfo;

/// Physics that the plant has and the model of the controller may lack.
struct HiddenEffect {
  std::string kind;                          ///< see plant_help()
  std::string port;                          ///< joint, command or sensor it acts on; empty: the actuated one
  std::map<std::string, double> parameters;  ///< by name; a missing one is an error, so is an unknown one
};

/// Everything that decides how a plant moves and what its sensors tell. Names that a plant does not have
/// are refused by Plant::make with a list of those it has. Times are in seconds; noise in channel units.
struct PlantOptions {
  std::string kind = "cart_pole";               ///< see plant_help()
  std::shared_ptr<const MechanismInfo> made;    ///< in the place of `kind`: a mechanism made for this robot
  std::map<std::string, double> parameters;     ///< physical parameters that differ from the default
  std::map<std::string, double> initial_state;  ///< by state name; default: hanging at rest
  std::vector<HiddenEffect> effects;            ///< actuator effects act in this order

  std::map<std::string, double> encoder_noise_sd;  ///< by measurement channel, default 0
  std::map<std::string, double> encoder_step;      ///< quantisation by measurement channel, 0: none
  double process_noise_sd = 0;                     ///< random force on the actuated joint, held for 1 ms each
  double measurement_latency_s = 0;                ///< a measurement shows the plant this long ago
  double command_latency_s = 0;                    ///< a command reaches the motor this much later
  double command_limit = 1000;                     ///< the motor saturates at +- this (command units)
  double watchdog_timeout_s = 0.1;                 ///< no command for this long: motor at zero; 0: no watchdog

  double step_s = 0.0005;     ///< physics step: whole microseconds, at most 1 ms
  bool rates = false;         ///< sensors for rates too, behind those for positions
  std::int64_t start_us = 0;  ///< the plant's clock at its start: process noise goes by it
  std::uint64_t seed = 1;     ///< of every random stream
};

/// Reads "name=value" into values. False with a message in error when the text is anything else or the
/// name was given before.
bool parse_assignment(const std::string& text, std::map<std::string, double>& values, std::string& error);

/// Reads "kind:name=value,name=value" or "kind@port:name=value" (for command lines) into effect.
bool parse_effect(const std::string& text, HiddenEffect& effect, std::string& error);

}  // namespace tiller::sim
