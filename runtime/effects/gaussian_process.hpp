#pragma once

#include "effects/effect_info.hpp"
#include "effects/hook_arguments.hpp"

namespace tiller {

/// Forces at all joints that a sparse Gaussian process has learnt (tiller_config_t.network, gaussian): the features are
/// the process's squared exponentials about its inducing points, and waves that stand for its prior; each member is a
/// draw from its posterior (Wilson et al. 2020, pathwise conditioning), so members agree where data are dense and are
/// as wide as the prior where there are none. Inputs and `member` as for `network`.
template <class S>
struct GaussianProcess {
  static constexpr Hook hook = Hook::joints;
  static constexpr EffectInfo info = [] {
    EffectInfo i;
    i.name = "gaussian_process";
    i.port = PortKind::body;
    i.unnamed = true;
    i.learnt = true;
    i.param_count = 1;
    i.params[0] = {"member", "1", 0.0, TILLER_MAX_NETWORK_MEMBERS};
    i.help = "forces at all joints, learnt by a sparse Gaussian process (tiller learn)";
    i.equation = "force = sum of w_k[member] exp(-1/2 |s (z - c_k)|^2) + waves; z: sin q, cos q or q, v, u";
    i.source =
        "Wilson, Borovitskiy, Terenin, Mostowsky, Deisenroth (2020), Efficiently sampling functions from Gaussian "
        "process posteriors";
    return i;
  }();
};

}  // namespace tiller
