#pragma once

#include "tools/nets/gru.hpp"
#include "tools/nets/mdn.hpp"
#include "tools/nets/standardise.hpp"

namespace tiller::tools {

/// What a density is conditional on, a column for each sample: numbers, a sequence, or both.
struct Features {
  nets::Matrix fixed;                  ///< (size x n); no rows: none
  std::vector<nets::Matrix> sequence;  ///< (steps) of (rows x n); empty: none
  nets::Matrix::Index count() const { return sequence.empty() ? fixed.cols() : sequence[0].cols(); }
  Features at(const std::vector<Eigen::Index>& index) const;
};

struct DensityNetOptions {
  int components = 3, hidden = 48, states = 16;  ///< of the mixture, each of two hidden layers, the recurrent unit
  int epochs = 200, patience = 15, batch = 100;
  double rate = 3e-3;
  std::uint64_t seed = 1;
};

/// q(v | features): a mixture-density network over d numbers, behind a perceptron, behind a gated recurrent unit where
/// the features have a sequence; all of it trained together on the mean of -log q (BayesSim, RSS 2019, eq. 5).
class DensityNet {
 public:
  /// Trains from random weights. A tenth of the samples is kept back: the weights are those of its least loss, the rate
  /// falls to a third when that has not fallen for `patience` epochs, and training ends the third time. Returns that
  /// loss, in nats of v.
  double train(const Features& features, const nets::Matrix& v, const DensityNetOptions& options);
  /// At one sample.
  nets::NormalMixture at(const Features& one) const;
  /// Mean of -log q over the samples.
  double loss(const Features& features, const nets::Matrix& v) const;

 private:
  nets::Vector weights() const;
  void set_weights(const nets::Vector& weights);
  double step(const Features& features, const nets::Matrix& target, nets::Vector* gradient) const;

  nets::MixtureHead head_;
  nets::Gru gru_;
  nets::Mlp mlp_;
  nets::Standardiser in_, out_;
};

}  // namespace tiller::tools
