#pragma once

#include <algorithm>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "sim/mechanisms/planar.hpp"

namespace tiller::sim {

/// Two rods in a vertical plane, hinged at the shoulder to the world and at the elbow to each other, with a motor in
/// both hinges or in the elbow alone (acrobot). The shoulder's angle is 0 where the upper rod hangs, the elbow's where
/// the lower rod goes straight on; counter-clockwise is positive with x to the right and z up, so both hinges turn
/// about
/// -y.
class TwoRods final : public PlanarMechanism {
 public:
  TwoRods(const std::map<std::string, double>& p, std::vector<std::size_t> motors)
      : PlanarMechanism(p.at("gravity_m_s2")),
        p_(p),
        upper_length_m_(p.at("upper_length_m")),
        lower_length_m_(p.at("lower_length_m")),
        upper_com_m_(p.at("upper_com_m")),
        lower_com_m_(p.at("lower_com_m")),
        damping_Nms_{p.at("shoulder_damping_Nms"), p.at("elbow_damping_Nms")},
        upper_(rod("upper", -p.at("upper_com_m"))),
        lower_(rod("lower", -p.at("upper_length_m") - p.at("lower_com_m"))),
        shoulder_(world_, upper_, nullptr, -1, least_inertia(0)),
        elbow_(world_, lower_, upper_, -1, least_inertia(1), -p.at("upper_length_m")) {
    Slot slot;
    slot.hinge = &shoulder_;
    slot.body = upper_;
    slot.on_ground = true;
    add_slot(slot);
    slot.hinge = &elbow_;
    slot.body = lower_;
    slot.on_ground = false;
    add_slot(slot);
    set_motors(std::move(motors));
  }

  double own_damping(std::size_t joint) const override { return damping_Nms_[joint]; }

 private:
  dBodyID rod(const std::string& name, double height_m) {
    return add_body(p_.at(name + "_mass_kg"), p_.at(name + "_inertia_kgm2"), 0, height_m, -1);
  }
  Frame elbow(const double* q, const double* v) const { return arm_end({}, upper_length_m_, q[0], v[0], -1); }
  void frames(const double* q, const double* v, Frame* out) const override {
    out[0] = arm_end({}, upper_com_m_, q[0], v[0], -1);
    out[1] = arm_end(elbow(q, v), lower_com_m_, q[0] + q[1], v[0] + v[1], -1);
  }
  Frame tip(const double* q, const double* v) const override {
    return arm_end(elbow(q, v), lower_length_m_, q[0] + q[1], v[0] + v[1], -1);
  }

  /// What a torque at one hinge meets while the other swings freely, in the pose where that is least.
  double least_inertia(int joint) const {
    const double l1 = upper_length_m_, m2 = p_.at("lower_mass_kg"), com2 = lower_com_m_;
    const double below = p_.at("lower_inertia_kgm2") + m2 * com2 * com2;
    const double above =
        p_.at("upper_inertia_kgm2") + p_.at("upper_mass_kg") * upper_com_m_ * upper_com_m_ + m2 * l1 * l1;
    double least = joint == 0 ? above : below;
    for (int k = -64; k <= 64; ++k) {
      const double c = k / 64.0;
      const double coupling = m2 * l1 * com2 * c, across = below + coupling, whole = above + below + 2 * coupling;
      least = std::min(least, joint == 0 ? whole - across * across / below : below - across * across / whole);
    }
    return least;
  }

  std::map<std::string, double> p_;
  double upper_length_m_, lower_length_m_, upper_com_m_, lower_com_m_;
  double damping_Nms_[2];
  dBodyID upper_;
  dBodyID lower_;
  HingeJoint shoulder_;
  HingeJoint elbow_;
};

}  // namespace tiller::sim
