#pragma once

#include <functional>
#include <string>
#include <vector>

#include "tools/learn/ensemble.hpp"
#include "tools/learn/gaussian_fit.hpp"
#include "tools/learn/held_out.hpp"
#include "tools/robot/network_file.hpp"

namespace tiller::tools::learn {

enum class Form { automatic, network, gaussian };

struct LearnOptions {
  Form form = Form::automatic;
  EnsembleOptions ensemble;
  GaussianOptions gaussian;
  int passes = 3;              ///< of smoothing with what was learnt, and learning again
  double hold_out = 0.25;      ///< last share of every grid, for the judgement alone
  double most_ratio = 0.9;     ///< of rollout errors, with over without: what does not reach it is refused
  bool beat_residual = false;  ///< refuses what nine weights at one joint do as well
  bool refit = true;           ///< the robot's own parameters first, where the model has at most three joints
  std::function<void(const std::string& what, double share)> progress;  ///< may be empty
  const volatile int* stop = nullptr;
};

/// What one form came to.
struct Candidate {
  std::string name;  ///< "network", "gaussian_process"
  StoredNetwork network;
  HeldOut held_out;
  Eigen::VectorXd process_sd;  ///< (nx) that makes the held-out spread honest
  double spread_ratio = NAN;   ///< of the members' forces outside of the data, over inside
  /// (nx + 3 nf x samples) some of the periods of the logs: state, force that the model lacks there, mean of the
  /// members, and their deviation.
  Eigen::MatrixXd seen;
};

struct Learnt {
  std::vector<double> params;   ///< (np) the robot's own, fitted without what is learnt: `before` has them
  std::vector<double> base;     ///< (np) the same beside a free residual: what is learnt stands on them, unbiased by
                                ///< what the model lacks
  std::vector<double> base_sd;  ///< (np) of them; 0: fixed, or as the robot file has them
  Eigen::VectorXd force_sd;     ///< (nf) intensity of the force that is left
  HeldOut before;               ///< the model without anything learnt, with the noise that makes its spread honest
  Eigen::VectorXd before_process_sd;  ///< (nx) that noise
  std::vector<Candidate> candidates;
  int chosen = -1;             ///< of the candidates; -1: refused
  std::string why;             ///< a sentence: of the choice, or of the refusal
  HeldOut residual;            ///< the nine local weights at one joint, from the same part of the logs
  std::string residual_joint;  ///< where; "": none was fitted
  std::size_t samples = 0;
  double seconds = 0;  ///< of the logs
};

/// The configuration with the effect; `loaded` outlives it. False where there is no room for
/// it, or where its weights are no network's: training that diverged.
bool with_network(const tiller_config_t& config, const LoadedNetwork& loaded, Config& out);

/// Learns the forces that the model lacks from grids of logs, on the part before the held-out one; judges on that one,
/// and then learns again from everything. The model has joints, and no quaternions. False with a sentence in `error`
/// where nothing can be learnt at all; a refusal of what was learnt is no error.
bool learn(const RobotFile& robot, const std::vector<Grid>& grids, const LearnOptions& options, Learnt& out,
           std::string& error);

}  // namespace tiller::tools::learn
