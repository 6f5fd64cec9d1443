#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// Forces at all joints that a network has learnt (tiller_config_t.network, tanh): what the model lacks and nobody has
/// a name for. Its inputs are, joint by joint, the position (of an angle its sine and its cosine; of a joint without
/// position nothing) and the velocity, then the inputs as they act. An ensemble's members disagree where data are
/// absent: particle by particle the parameter `member` says whom to believe, so planner and posterior see the spread
/// (Chua et al. 2018), and the posterior learns whom the robot agrees with.
///
/// Explicit: the forces of the step's beginning act through it.
template <class S>
struct Network {
  static constexpr Hook hook = Hook::joints;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "network";
    i.port = PortKind::body;
    i.unnamed = true;
    i.learnt = true;
    i.param_count = 1;
    i.params[0] = {"member", "1", 0.0, TILLER_MAX_NETWORK_MEMBERS};
    i.help = "forces at all joints, learnt by an ensemble of networks (tiller learn)";
    i.equation = "force = network[member](sin q, cos q or q, v, u)";
    i.source = "Chua, Calandra, McAllister, Levine (2018), Deep reinforcement learning in a handful of trials (PETS)";
    return i;
  }();
};

}  // namespace tiller
