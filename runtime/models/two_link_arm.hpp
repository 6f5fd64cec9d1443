#pragma once

#include "models/acrobot.hpp"

namespace tiller {

/// Two-link arm: the acrobot's two rods in a vertical plane with a motor in each hinge. Angles, parameters and
/// equations are the acrobot's.
template <class S>
struct TwoLinkArm {
  using Links = Acrobot<S>;
  static constexpr const char* name = "two_link_arm";
  using State = typename Links::State;
  TILLER_FIELDS(Input, S, shoulder_Nm, elbow_Nm);
  using Params = typename Links::Params;
  using Force = typename Links::Force;
  static constexpr tiller_joint_t joints[] = {{"shoulder", 0, 2, 0, 1}, {"elbow", 1, 3, 1, 2}};
  static constexpr unsigned angles = (1u << 0) | (1u << 1);
  static constexpr bool long_dynamics = true;
  using Output = typename Links::Output;

  static Output outputs(const State& x, const Params& p) { return Links::outputs(x, p); }

  static State dynamics(const State& x, const Input& u, const Force& f, const Body<S>& body, const Params& p) {
    Force turn = f;
    turn.shoulder_Nm = f.shoulder_Nm + u.shoulder_Nm;
    return Links::dynamics(x, {u.elbow_Nm}, turn, body, p);
  }
};

}  // namespace tiller
