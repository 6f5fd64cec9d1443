#pragma once

#include "tools/identify/coordinates.hpp"
#include "tools/likelihood_free/inference.hpp"

namespace tiller::tools {

/// Parameter vectors with what was simulated of them; those that failed are left out.
struct Draws {
  Matrix v;                            ///< (d x n) coordinates
  std::vector<Trajectory> trajectory;  ///< (n) with the sensors' noise
  Eigen::Index count() const { return v.cols(); }
  /// Columns `index` of both.
  Draws at(const std::vector<Eigen::Index>& index) const;
};

/// Simulates coordinates, counts what failed, and adds noise: the sensors', to every value; and to the start that a
/// simulation is given, so that the doubt of a measured start is in its trajectory (under a flat prior of the start).
class DrawMaker {
 public:
  DrawMaker(const InferenceProblem& problem, const Coordinates& coordinates);

  /// Of v (d x n). False with a sentence in `error`: the simulator's, or that nothing was simulated without a failure.
  bool simulate(const Matrix& v, Draws& out, std::string& error);
  std::uint64_t simulations() const { return total_; }
  std::uint64_t failed() const { return failed_; }
  /// A sentence about failures with the first of them; empty: none.
  std::string failure_text() const;
  /// What the logs show, in the form of a simulation.
  const Trajectory& observed() const { return observed_; }

 private:
  Ask ask_of(const double* v) const;
  void add_noise(std::uint64_t index, Trajectory& trajectory) const;

  const InferenceProblem& problem_;
  const Coordinates& coordinates_;
  Trajectory observed_;
  std::uint64_t total_ = 0, failed_ = 0;
  std::string first_failure_;
};

/// Counts and history for a result: weighted coordinates v (d x n) of weights that need not sum to one.
void conclude(const InferenceProblem& problem, const Coordinates& coordinates, const Matrix& v, const Vector& weight,
              Inferred& result);
/// Mean, deviation and effective number of weighted coordinates, as parameters.
MethodIteration iteration_of(const Coordinates& coordinates, std::size_t np, const Matrix& v, const Vector& weight);

}  // namespace tiller::tools
