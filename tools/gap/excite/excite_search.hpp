#pragma once

#include <memory>

#include "tools/gap/excite/excite.hpp"
#include "tools/gap/excite/mean_innovations.hpp"

namespace tiller::tools::gap {

/// The search behind propose_excitation.
class ExciteSearch {
 public:
  ExciteSearch(const std::vector<Rival>& rivals, const ExciteOptions& options);

  /// Fits every rival to every other's outputs along a multisine: where refits begin.
  void prepare();
  /// False: no sequence keeps the states within bounds.
  bool run(std::string& error);

  const InputSequence& best() const { return best_; }
  const InputSequence& best_for(std::size_t pair) const { return pair_best_[pair].sequence; }
  std::size_t tried() const { return tried_; }
  /// Every pair's expected log odds along a sequence, refitted to the end.
  std::vector<Separation> measure(const InputSequence& sequence);
  /// Least and largest value of every state (nx), over rivals and draws of the robot file's priors. False: not finite.
  bool reach(const InputSequence& sequence, std::vector<double>& low, std::vector<double>& high);

 private:
  /// A possible truth: a rival at its values, or near them where nobody gave any.
  struct Truth {
    std::size_t rival = 0;
    std::vector<double> params;
    std::vector<std::vector<double>> start;  // (rivals) of (np): where the refit of each begins
  };
  struct Best {
    InputSequence sequence;
    double nats = -1;
  };
  /// The distribution of new codes: of each gene its shapes' probabilities, and each number's mean and deviation.
  struct Law {
    double shape[kShapes], mean[kGeneNumbers], sd[kGeneNumbers];
  };
  struct Member {
    SequenceCode code;
    double score = 0;
  };

  void make_pairs();
  void make_truths();
  void make_draws();
  std::vector<double> pair_nats(const InputSequence& sequence, int steps);
  void find_nested(const InputSequence& sequence);
  double direction(std::size_t truth, std::size_t fitted) const { return direction_[truth * rivals_.size() + fitted]; }
  bool within(const InputSequence& sequence);
  bool shrink_to_bounds(InputSequence& sequence);
  double score(const InputSequence& sequence);
  std::vector<SequenceCode> plain_codes() const;
  SequenceCode draw(Rng& rng, const std::vector<Member>& elite) const;
  void learn(const std::vector<Member>& elite);
  bool stopped() const { return options_.stop && *options_.stop != 0; }

  const std::vector<Rival>& rivals_;
  ExciteOptions options_;
  double period_s_;
  std::vector<Separation> pairs_;
  std::vector<Truth> truths_;
  std::vector<std::unique_ptr<RivalRollout>> rollout_;    // (rivals)
  std::vector<std::unique_ptr<MeanInnovations>> filter_;  // (rivals)
  std::vector<std::vector<std::vector<double>>> draws_;   // (rivals) of draws of (np)
  std::vector<double> direction_;                         // (rivals x rivals) nats of the last pair_nats
  std::vector<Law> law_;
  InputSequence best_;
  double best_score_ = -1;
  std::vector<Best> pair_best_;
  std::size_t tried_ = 0;
};

}  // namespace tiller::tools::gap
