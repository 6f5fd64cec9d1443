#pragma once

#include <cstdint>
#include <vector>

#include "tools/nets/mlp.hpp"

namespace tiller::tools::nets {

/// A gated recurrent unit (Cho et al., EMNLP 2014): a state of fixed size that reads a sequence of any length.
///
///     z = s(Wz x + Uz h + bz)     r = s(Wr x + Ur h + br)     n = tanh(Wn x + Un (r o h) + bn)
///     h <- (1 - z) o n + z o h,   h = 0 at the beginning;  s is the logistic function
///
/// All weights stand in one vector: blocks z, r, n; each row by row: bias, a weight per input, a weight per state.
class Gru {
 public:
  Gru() = default;
  /// Both at least 1. Weights are zero.
  Gru(int inputs, int states);

  int inputs() const { return inputs_; }
  int states() const { return states_; }
  /// Rows of a summary: the last state, then the mean of all states.
  int outputs() const { return 2 * states_; }

  Vector weights;  ///< (3 states (1 + inputs + states))

  /// Glorot and Bengio (2010), biases zero.
  void randomise(std::uint64_t seed);

  /// What a forward pass leaves for the backward pass.
  struct Tape {
    std::vector<Matrix> x, z, r, n;  ///< a matrix per step (inputs x samples), then (states x samples)
    std::vector<Matrix> h;           ///< one more than steps: h[0] is zero
    Matrix output;                   ///< (outputs x samples)
  };
  /// `sequence`: a matrix per step (inputs x samples), at least one. O(steps samples count).
  void forward(const std::vector<Matrix>& sequence, Tape& tape) const;
  /// Adds to `gradient` the derivatives of a scalar with respect to the weights, by backpropagation through time, where
  /// `by_output` (outputs x samples) are those with respect to the taped output.
  void backward(const Tape& tape, const Matrix& by_output, Vector& gradient) const;

 private:
  int inputs_ = 0, states_ = 0;
};

}  // namespace tiller::tools::nets
