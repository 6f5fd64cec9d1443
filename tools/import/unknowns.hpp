#pragma once

#include <string>
#include <vector>

#include "tools/import/mechanism.hpp"

namespace tiller::tools {

/// A parameter of the emitted model: what it stands for, its value by the description and how far that is believed.
struct ModelParameter {
  enum class Kind { mass, inertia, gain, contact };
  Kind kind = Kind::mass;
  std::string name;          ///< as in the robot file: "forearm_link_mass_kg"
  std::string about;         ///< the link, joint or pair
  int slot = 0;              ///< of an inertia's ten coordinates; of a contact 0 friction, 1 settle_s, 2 damping_ratio
  double value = 0.0;        ///< by the description
  double sd = 0.0;           ///< of the prior: of an inertia's coordinates as it is, else of the logarithm
  bool is_held = false;      ///< at `value`, which stands in the prior's place
  std::string comment = {};  ///< what stands behind it in the robot file

  bool is_log_normal() const { return kind != Kind::inertia; }
  std::string prior() const;  ///< TOML, as it stands in [parameters]
};

/// Friction of a joint: effects of the robot file, which act implicitly. Equations with damping of their own would be
/// stiff where a joint is light.
struct JointFriction {
  std::string joint;
  std::string viscous, dry;                     ///< TOML, a number or a prior; empty: none
  double plant_viscous = 0.0, plant_dry = 0.0;  ///< of the simulated plant: the description's, or within the prior
};

/// What is not known of a mechanism.
struct Unknowns {
  bool payload = false;
  double payload_kg = 0.0;  ///< largest
  std::vector<ModelParameter> parameters;
  std::vector<JointFriction> friction;
};

/// Takes the words of --unknown: payload[=KG], mass:LINK, inertia:LINK, friction:JOINT, gain:JOINT,
/// contact:PAIR; `*` for every one.
/// What the description says of damping and friction is there too, fixed. False with what is wrong in `errors`.
bool read_unknowns(const std::vector<std::string>& words, const Mechanism& mechanism, Unknowns& unknowns,
                   std::vector<std::string>& errors);

/// A name as C++ and TOML have it: letters, digits and underscores.
std::string identifier(const std::string& name);

/// Names of the log-Cholesky coordinates of an inertia (Rucker and Wensing, "Smooth parameterization of rigid-body
/// inertia", RA-L 2022), in their order: the size, three stretches, three shears, three shifts.
const char* const* inertia_coordinates();
constexpr int kInertiaCoordinates = 10;

}  // namespace tiller::tools
