#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace tiller::tools::nets {

using Matrix = Eigen::MatrixXd;  ///< a column per sample, unless said otherwise
using Vector = Eigen::VectorXd;

/// A multilayer perceptron: tanh in every hidden layer, linear at the end.
///
/// All weights stand in one vector, layer by layer, each layer row by row: of output i first the bias, then a weight
/// per input. A runtime that evaluates exported weights reads them in this order.
class Mlp {
 public:
  Mlp() = default;
  /// widths: inputs, hidden layers, outputs; at least two numbers, each at least 1. Weights are zero.
  explicit Mlp(std::vector<int> widths);

  const std::vector<int>& widths() const { return widths_; }
  int inputs() const { return widths_.front(); }
  int outputs() const { return widths_.back(); }
  /// Number of weights that a network of these widths has.
  static Eigen::Index count(const std::vector<int>& widths);

  Vector weights;  ///< (count)

  /// Glorot and Bengio (2010): uniform on +-sqrt(6 / (inputs + outputs)) of each layer, biases zero. `last_gain` scales
  /// the output layer: a small one begins near zero.
  void randomise(std::uint64_t seed, double last_gain = 1.0);

  /// (outputs x samples) for x (inputs x samples). O(samples count).
  Matrix evaluate(const Matrix& x) const;

  /// What a forward pass leaves for the backward pass: the input and each layer's output.
  struct Tape {
    std::vector<Matrix> layers;
    const Matrix& output() const { return layers.back(); }
  };
  void forward(const Matrix& x, Tape& tape) const;
  /// Adds to `gradient` (count) the derivatives of a scalar with respect to the weights, where `by_output` (outputs x
  /// samples) are those with respect to the outputs of the taped pass. `by_input`, if not null, is set to (inputs x
  /// samples).
  void backward(const Tape& tape, const Matrix& by_output, Vector& gradient, Matrix* by_input = nullptr) const;

 private:
  std::vector<int> widths_;
};

/// Replaces the network by the equal one that takes x_i in the place of (x_i - mean_i) / sd_i: a runtime then needs no
/// scaling.
void absorb_input_scale(Mlp& mlp, const Vector& mean, const Vector& sd);
/// Replaces the network by the one whose outputs are mean_i + sd_i times its own.
void absorb_output_scale(Mlp& mlp, const Vector& mean, const Vector& sd);

}  // namespace tiller::tools::nets
