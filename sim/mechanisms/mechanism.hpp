#pragma once

#include <cstdlib>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "sim/mechanisms/channel.hpp"

namespace tiller::sim {

/// One joint with one degree of freedom, as effects see it. Units: N and m for a sliding joint, Nm and rad
/// for a turning one.
class Joint {
 public:
  virtual ~Joint() = default;
  virtual double position() const = 0;  ///< turning joints count their turns
  virtual double rate() const = 0;
  /// Adds a generalised force for the coming step only.
  virtual void add_force(double force) = 0;
  /// Dry friction with true sticking: ODE's joint motor holds the rate at zero with at most this force.
  virtual void set_dry_friction(double force) = 0;
  /// Lower bound of the inertia that this joint moves, for checks of stability.
  virtual double least_inertia() const = 0;
};

/// Bodies and joints of one plant in an ODE world of its own. Knows nothing of effects, sensors and clocks.
class Mechanism {
 public:
  virtual ~Mechanism() = default;
  /// Moves the bodies to the state (order of state_channels) and forgets all forces.
  virtual void place(const std::vector<double>& state) = 0;
  virtual void read_state(double* out) const = 0;
  /// The forces that the motors make (commands) in the coming step, or the velocities that they keep.
  virtual void drive(const double* motor) = 0;
  /// Adds the plant's own passive forces (its viscous friction), then steps the world.
  virtual void step(double step_s) = 0;
  virtual double energy_J() const = 0;  ///< kinetic and potential

  // Of a mechanism with joints; one whose motors keep a velocity may have none.
  virtual double own_damping(std::size_t /*joint*/) const { return 0; }  ///< viscous coefficient among the parameters
  virtual Joint& joint(std::size_t /*index*/) { std::abort(); }          ///< order of MechanismInfo::joints

  /// Before the forces of a step: steps of second order bring the joints to where these act.
  virtual void begin(double /*step_s*/) {}

  // What effects may build, before the first place(). False: there is no place for it.
  virtual bool tilt(double /*angle_rad*/) { return false; }       ///< gravity turns counter-clockwise
  virtual bool add_payload(double /*mass_kg*/) { return false; }  ///< fixed to the last body
  virtual bool add_flywheel(std::size_t /*joint*/, double /*inertia*/) { return false; }
  /// A body between the motor and its joint: with play, or with a spring and a damper.
  virtual bool add_rotor(std::size_t /*motor*/, double /*inertia*/, double /*gap*/) { return false; }
  virtual bool add_elastic_rotor(std::size_t /*motor*/, double /*inertia*/, double /*stiffness*/, double /*damping*/) {
    return false;
  }
  virtual bool add_swinging_load(double /*mass_kg*/, double /*length_m*/) { return false; }  ///< hangs from the tip
  /// The same, from the centre of the body behind a joint.
  virtual bool add_hung_load(std::size_t /*joint*/, double /*mass_kg*/, double /*length_m*/) { return false; }
};

/// A physical parameter: its default and the open or closed lower bound that keeps the bodies real.
struct ParameterInfo {
  std::string name;
  double default_value;
  double minimum;
  bool minimum_allowed;
  std::string help;
};

/// What one kind of plant has, and how to build it. Entries are in mechanisms.def.
struct MechanismInfo {
  std::string kind;
  std::string help;
  std::vector<ParameterInfo> parameters;
  std::vector<Channel> states;
  std::vector<double> default_state;  // (states), hanging at rest
  std::vector<std::size_t> measured;  // indices of states that an encoder measures
  std::vector<Channel> commands;      // one for each motor
  std::vector<std::string> joints;    // ports of joint effects
  std::size_t actuated;               // index of the joint that the (first) motor drives
  std::vector<std::size_t> motors;    // (commands) index of the joint that each drives; empty: not one each
  std::function<std::unique_ptr<Mechanism>(const std::map<std::string, double>& parameters)> build;
};

const std::vector<MechanismInfo>& mechanisms();
const MechanismInfo* find_mechanism(const std::string& kind);  ///< null: unknown

#define SIM_MECHANISM(name) MechanismInfo name##_info();
#include "sim/mechanisms/mechanisms.def"

}  // namespace tiller::sim
