#pragma once

#include <string>
#include <vector>

#include "rollout/rollout.hpp"
#include "tiller/config.hpp"
#include "tools/gap/result/result.hpp"

namespace tiller::tools::gap {

/// One of the explanations that an experiment is to tell apart: the robot file's model with effects added, at definite
/// values, and how far each of them may move in a refit.
struct Rival {
  std::string name;               ///< "stribeck_friction (joint)"; "nominal"
  Config config{};                ///< with the effects; every added parameter fixed at its value
  std::vector<EffectAt> effects;  ///< added to the robot file's
  Words params;                   ///< (np)
  std::vector<double> value;      ///< (np)
  std::vector<double> spread;     ///< (np) deviation that a refit takes for usual; 0: known
  std::vector<double> low, high;  ///< (np) hard bounds
  std::vector<bool> stiff;        ///< (np) a stiffness, which may be any larger one: what it holds is then rigid
  std::vector<bool> given;        ///< (np) value came from the user or a report, not from a typical magnitude
};

/// The robot file's model with the effects of `text` added, e.g. "coulomb_friction@joint:friction_SI=0.2+tilt". A port
/// may be left out where there is one; a parameter without a value gets a typical one. "nominal" adds nothing.
/// False with what is wrong and what to write in `error`.
bool parse_rival(const RobotFile& robot, const std::string& text, Rival& rival, std::string& error);

/// The ambiguity set of a gap.json; where that names fewer than two, the best explanations of its ranking.
bool read_rivals(const RobotFile& robot, const std::string& path, std::vector<Rival>& rivals, std::string& error);

/// Whether `small` is `large` with something set to nothing: its effects are contained in large's.
bool contains(const Rival& large, const Rival& small);

}  // namespace tiller::tools::gap
