#pragma once

#include <memory>
#include <vector>

#include "sim/mechanisms/ode_world.hpp"

namespace tiller::sim {

/// A point of a moving body in the vertical plane: where it is, its velocity, and the acceleration that it has while
/// all coordinates keep their rates.
struct Frame {
  double x = 0, z = 0, vx = 0, vz = 0, ax = 0, az = 0;
  double angle = 0, rate = 0;
};

/// The point at the end of an arm of that length. up = +1: angle 0 points upwards and grows as the arm leans to +x (a
/// right-handed turn about +y); -1: angle 0 hangs and grows counter-clockwise (about -y).
Frame arm_end(const Frame& from, double length, double angle, double rate, double up);

/// Bodies that move in the vertical plane, in generalised coordinates: one per state's position, and further ones for
/// what effects add.
///
/// Midpoint steps: coordinates go half a step, ODE solves for the velocities there, coordinates go the other half. The
/// bodies are put on the joints exactly, and the part of their acceleration that comes from turning alone is handed to
/// ODE as a force, for which d'Alembert stands. Second order; for forces that depend on position alone it is the
/// symplectic leapfrog. Velocity-dependent forces see the rate carried forward by half of the last step's change.
///
/// ODE's own steps are no alternative: their velocities fit the joints where the step began, so a turning body loses a
/// share of rate^2 step / 2 of its speed each second, an error of first order that looks like drag.
class PlanarMechanism : public Mechanism {
 public:
  explicit PlanarMechanism(double gravity_m_s2) : world_(gravity_m_s2) {}

  void place(const std::vector<double>& state) override;
  void read_state(double* out) const override;
  void drive(const double* motor) override;
  void begin(double step_s) override;
  void step(double step_s) override;
  double energy_J() const override;
  Joint& joint(std::size_t index) override { return *joints_[index]; }

  bool tilt(double angle_rad) override;
  bool add_payload(double mass_kg) override;
  bool add_flywheel(std::size_t joint, double inertia) override;
  bool add_rotor(std::size_t motor, double inertia, double gap) override;
  bool add_elastic_rotor(std::size_t motor, double inertia, double stiffness, double damping) override;
  bool add_swinging_load(double mass_kg, double length_m) override { return hang(slots_.size(), mass_kg, length_m); }
  bool add_hung_load(std::size_t joint, double mass_kg, double length_m) override {
    return hang(joint, mass_kg, length_m);
  }

 protected:
  /// What stands at the end of a coordinate.
  struct Slot {
    HingeJoint* hinge = nullptr;  ///< one of the two
    SliderJoint* slider = nullptr;
    dBodyID body = nullptr;
    double up = -1;          ///< of its turn
    bool on_ground = false;  ///< at the origin, so that a rotor may turn about the same axis
  };

  /// The centre of mass of each own body, in the order of add_body; q and v are all coordinates.
  virtual void frames(const double* q, const double* v, Frame* out) const = 0;
  /// Where a payload sits.
  virtual Frame tip(const double* q, const double* v) const = 0;

  /// A body of the mechanism; `across` is its inertia about y, and the one about the other axes does not matter.
  dBodyID add_body(double mass_kg, double across, double x, double z, double up);
  void add_slot(const Slot& slot);
  /// Motor i drives slot motors[i].
  void set_motors(std::vector<std::size_t> motors) { motors_ = std::move(motors); }

  OdeWorld world_;

 private:
  /// A joint as effects see it: at the middle of the step while one is made, turns counted.
  class Coordinate;
  struct Part {
    dBodyID body;
    double up;
    double mass;
  };
  /// Between a motor and its joint.
  struct Rotor {
    dBodyID body;
    dJointID joint;
    std::size_t slot, coordinate;
    double stiffness, damping;
  };

  Joint& ode_joint(std::size_t slot) const;
  double ode_rate(std::size_t coordinate) const;
  void all_frames(const double* q, const double* v, std::vector<Frame>& out) const;
  /// Moves ODE's bodies, and nothing of this object.
  void put(const std::vector<double>& q, const std::vector<double>& v) const;
  void set_velocities(const std::vector<double>& v);
  void push_turning();
  void push_springs();
  bool new_rotor(std::size_t motor, double inertia, double stiffness, double damping);
  dBodyID extra_body(double mass_kg, double across, const Frame& at, double up);

  std::vector<Slot> slots_;
  std::vector<std::unique_ptr<Joint>> joints_;
  std::vector<std::size_t> motors_;
  std::vector<Part> parts_;      // the mechanism's own, then those of effects
  std::vector<dBodyID> bodies_;  // of all parts
  std::size_t own_parts_ = 0;
  struct Extra {
    enum class Kind { flywheel, rotor, payload, load };
    Kind what;
    std::size_t slot, coordinate;
    double length_m;
  };
  const Extra* extra(Extra::Kind what) const;
  /// A load on a string from the centre of a slot's body; behind the last slot: from the tip.
  bool hang(std::size_t slot, double mass_kg, double length_m);
  std::size_t new_coordinate();

  std::vector<Extra> extras_;  // one for each part that is not the mechanism's own
  std::vector<Rotor> rotors_;
  std::vector<double> q_, v_, last_v_;  // coordinates
  std::vector<double> shown_q_, shown_v_;
  mutable std::vector<Frame> frames_;
};

}  // namespace tiller::sim
