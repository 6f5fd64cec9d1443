#pragma once

#include <memory>

#include "tools/likelihood_free/draws.hpp"

namespace tiller::tools {

/// What a simulation is compared by: a vector of fixed length.
class Summary {
 public:
  virtual ~Summary() = default;
  /// Learns from simulations what it needs to know of them, and gives their summaries (size x n), each as if it had
  /// been left out of what was learnt: of(), of a draw that was learnt from, would be nearer to its parameters than of
  /// the logs. Nothing is learnt where nothing is needed.
  virtual Matrix learn(const Draws& draws) = 0;
  /// Of one trajectory: (size), always as many.
  virtual Vector of(const Trajectory& trajectory) const = 0;
  /// Whether noise of the data alone gives each entry a deviation of about one: a distance then needs no scale.
  virtual bool is_scaled() const = 0;

  /// (size x n)
  Matrix of(const std::vector<Trajectory>& all) const;
};

/// "linear, cross_correlation, recurrent"
Words summary_names();

/// By name, for the problem's pieces, which outlive it; null for "recurrent", which is learnt together with a density
/// (sequence.hpp).
///
/// - cross_correlation: the summary by hand of BayesSim (Ramos, Possas, Fox, RSS 2019): of the changes of each measured
///   value, the mean products with each input, the means, and the variances.
/// - linear: two numbers per parameter, the estimates that linear models of the values and of their changes make
///   (Drovandi, Pettitt, Faddy, JRSS C 2011), fitted to the simulations themselves: with w the standardised
///   coordinates,
///
///     y_o = a_o + J_o w + Q_o(w) + e_o,   s = L^-1 J' V^-1 (y - a),   V = diag(var e),  L L' = J' V^-1 J
///
///   by least squares over the draws (Q the quadratic terms, where there are draws enough). Sensors' noise is
///   independent from value to value, a machine's own from change to change: either estimate is the good one of its
///   kind. Near-sufficient where the draws are close together; a black box's derivative is never asked for. A draw is
///   left out in closed form (residual over one less its leverage). Learning costs O(draws terms (terms + values)).
std::unique_ptr<Summary> make_summary(const std::string& name, const std::vector<Piece>& pieces);

}  // namespace tiller::tools
