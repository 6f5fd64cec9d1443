#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "tools/learn/dynamics_data.hpp"
#include "tools/nets/mlp.hpp"

namespace tiller::tools::learn {

struct EnsembleOptions {
  int members = 5;
  std::vector<int> hidden = {16, 16};
  int steps = 3000;  ///< of Adam, at most
  int batch = 256;   ///< samples of a step
  double drawn_share =
      1.0;                 ///< of the blocks, drawn with replacement for each member: fewer make members disagree more
  double anchor_sd = 1.0;  ///< of a weight's prior, over the reach of its first value
  std::uint64_t seed = 1;
  std::function<bool(double share)> progress;  ///< false: stop; may be empty
};

/// One member: trained on blocks drawn with replacement, of which a fifth stop it early; its weights are drawn towards
/// where they began, which was drawn from their prior (anchored ensembles, Pearce et al. 2020), so that members differ
/// where data are absent.
struct Member {
  nets::Mlp mlp;        ///< on standardised inputs and outputs
  double held_out = 0;  ///< weighted mean square of the blocks that stopped it, standardised
  int steps = 0;        ///< after which it was best
};

/// Same data, options and seed, same bits. Cost: members x steps x batch passes of a network there and back.
std::vector<Member> train_ensemble(const DynamicsData& data, const EnsembleOptions& options);

/// The same weights on plain inputs and outputs, as a runtime's network takes them.
nets::Mlp in_units(const nets::Mlp& mlp, const DynamicsData& data);

}  // namespace tiller::tools::learn
