#pragma once

// How strong hidden effects may be, against what the plant does in a rich motion. Inside of gap_worlds.hpp.

#include <string>
#include <vector>

#include "harness/gap_worlds/gap_setup.hpp"

namespace tiller::bench {

enum class HidingPlace {
  joint,
  motor_joint,   ///< a motor drives it
  ground_joint,  ///< and one of its sides is the ground
  spring_joint,  ///< its position 0 is where the plant rests
  input,
  ground_input,  ///< the motor stands on the ground
  sensor,
  gravity_sensor,  ///< of a joint on whose zero gravity depends
  spring_sensor,   ///< of a joint that rests at 0
  body
};

/// Extent of a rich motion of the plant without effects; index: joint (that is, position) or input.
struct Typical {
  std::vector<double> force;     ///< (joints) RMS acceleration times inertia, or command
  std::vector<double> velocity;  ///< (joints) RMS
  std::vector<double> position;  ///< (joints) RMS distance from rest
  std::vector<double> reach;     ///< (joints) RMS distance from 0
  std::vector<double> inertia;   ///< (joints)
  std::vector<double> input;     ///< (inputs) RMS
  std::vector<double> input_peak;
  std::vector<bool> turns;  ///< (joints) rad, not m
  double mass = 0;          ///< of the plant's moving end
};
Typical typical_motion(const Setup& setup, const std::vector<double>& amplitude);

/// One kind of effect as it is hidden. `make` turns a strength from 0 (next to nothing) to 1 (the most) into
/// parameters; what is not strength is drawn.
struct HiddenKind {
  std::string name;
  HidingPlace place;
  bool in_catalogue;
  std::map<std::string, double> (*make)(double strength, std::size_t port, const Typical& typical, Draws draws);
};
const std::vector<HiddenKind>& hidden_kind_table();
const HiddenKind* find_hidden_kind(const std::string& name);

}  // namespace tiller::bench
