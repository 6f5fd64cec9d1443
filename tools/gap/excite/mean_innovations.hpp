#pragma once

#include <Eigen/Dense>
#include <vector>

#include "rollout/late_reading.hpp"
#include "tools/gap/excite/excite_sequence.hpp"
#include "tools/gap/excite/rival.hpp"

namespace tiller::tools::gap {

/// Outputs without noise (points x ny) of a rival along a sequence.
struct Outputs {
  std::vector<double> value;
  bool finite = false;
};

/// A rival rolled out along a sequence for several parameter vectors at once, in lanes of the kernel.
class RivalRollout {
 public:
  explicit RivalRollout(const Rival& rival);
  /// `params` (np x vectors): states (points * nx x vectors), from the robot file's start. False: not finite.
  bool run(const InputSequence& sequence, const std::vector<std::vector<double>>& params, std::vector<double>& states);
  Outputs outputs(const InputSequence& sequence, const std::vector<double>& params);

 private:
  const Rival& rival_;
  StepSetup setup_;
};

/// The part of another rival's outputs that a rival's extended Kalman filter does not predict: the mean of its
/// innovations, whitened. Their squares sum to D (excite.hpp) for the parameters given; process noise and the unknown
/// state are accounted for by the filter, and so is what a linearised model may claim: its memory fades over
/// kMemory_s, the length of the windows that `tiller gap` decides by.
///
/// Lanes: parameter vectors, and one perturbation per state for the filter's Jacobian. A perturbation is as large as
/// the state's deviation, so that a kink (dry friction) is seen as the filter's cloud would see it.
class MeanInnovations {
 public:
  static constexpr double kMemory_s = 1.0;

  explicit MeanInnovations(const Rival& rival);
  /// Innovations (points * ny x vectors) of `outputs` along `sequence`, one column per parameter vector; the gains are
  /// those of the first. Not finite: all NaN.
  Eigen::MatrixXd run(const InputSequence& sequence, const Outputs& outputs,
                      const std::vector<std::vector<double>>& params);

 private:
  void start(const std::vector<std::vector<double>>& params);
  void correct(const double* measured, Eigen::MatrixXd& innovations, std::size_t row);
  bool predict(const InputSequence& sequence, std::size_t k);

  const Rival& rival_;
  const tiller_config_t& config_;
  const tiller_model_t& model_;
  const RolloutTable& table_;
  StepSetup setup_;
  std::uint32_t vectors_ = 0, lanes_ = 0;
  Eigen::MatrixXd p_;  // covariance (nx x nx)
  std::vector<double> state_, next_, foreseen_, params_, effect_, next_effect_, history_, step_;
};

/// Rival b's parameters moved so that it explains `outputs` best.
struct Refit {
  std::vector<double> params;  // (np)
  double squares = 0;          // D that remains; infinite where the filter diverges
};
/// Levenberg-Marquardt from `start` within the bounds, `steps` of it at most. A change costs (change / 3 spreads)^2,
/// of a stiffness (change / 60 spreads)^2: a spring that nobody sees give is a rigid joint.
Refit refit(const Rival& rival, MeanInnovations& filter, const InputSequence& sequence, const Outputs& outputs,
            const std::vector<double>& start, int steps);

}  // namespace tiller::tools::gap
