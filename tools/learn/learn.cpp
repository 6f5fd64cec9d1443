#include "tools/learn/learn.hpp"

#include <algorithm>
#include <cmath>

#include "effects/effect_info.hpp"
#include "networks/evaluate.hpp"
#include "networks/network_check.hpp"
#include "posterior/prior.hpp"
#include "tools/base/text.hpp"
#include "tools/gap/residual/fallback.hpp"

namespace tiller::tools::learn {
namespace {

using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

constexpr std::uint32_t kMostRefitJoints = 3;
constexpr double kCovered = 0.9, kMostNoise = 1e4;
constexpr Eigen::Index kSeenEvery = 20;  // periods, of what is shown and of what the spread is taken of

double centre_of(const tiller_prior_t& prior) {
  return prior.kind == tiller_prior_uniform ? 0.5 * (prior.low + prior.high) : prior.a;
}

constexpr double kLeastJudged_s = 1.3;  // a rollout of one second, and what the filter needs to begin
constexpr double kLeastLearnt_s = 3.0;

double seconds_of(const Grid& grid) { return static_cast<double>(grid.points()) * grid.period_s; }

class Learner {
 public:
  Learner(const RobotFile& robot, const LearnOptions& options, Learnt& out)
      : robot_(robot), config_(robot.config), options_(options), out_(out) {}

  bool run(const std::vector<Grid>& grids, std::string& error) {
    if (!split(grids)) {
      error = format(
          "learn: the logs hold %.1f s without a gap; rollouts of one second want a log of at least %.0f s, or "
          "two of %.0f s each",
          out_.seconds, kLeastLearnt_s / (1.0 - options_.hold_out) + kLeastJudged_s, kLeastLearnt_s);
      return false;
    }
    choose_params(train_);
    typical_ = typical_forces(config_, train_, out_.base);
    if (!(typical_.maxCoeff() > 0.0)) {
      error = "learn: the logs never move a joint, or are too short to tell; record a motion (`tiller excite`)";
      return false;
    }
    tell("smoothing", 0.0);
    out_.force_sd = typical_;
    smoothing_ =
        with_honest_sensors(config_, train_, out_.base, typical_.cwiseMax(1e-6 * typical_.maxCoeff()), out_.force_sd);
    if (!smooth_forces(smoothing_, train_, out_.base, out_.force_sd, first_, error)) {
      error = "learn: " + error;
      return false;
    }
    states_ = filtered_states(smoothing_, judge_, out_.base, out_.force_sd);
    out_.samples = static_cast<std::size_t>(first_.force.cols());
    calibrate({&config_, {out_.params}, Vector()}, first_, out_.before, out_.before_process_sd);
    judge_residual();
    if (options_.form != Form::gaussian) add(Form::network);
    if (options_.form != Form::network && !stopped()) add(Form::gaussian);
    choose();
    if (out_.chosen >= 0 && !stopped()) learn_from_all(grids);
    return true;
  }

 private:
  bool stopped() const { return options_.stop && *options_.stop != 0; }
  void tell(const std::string& what, double share) const {
    if (options_.progress) options_.progress(what, share);
  }

  /// The nine weights at their mean.
  void judge_residual() {
    if (out_.residual_joint.empty()) return;
    std::vector<double> params;
    for (std::uint32_t p = 0; p < residual_.config.param_count; ++p) params.push_back(residual_.config.priors[p].a);
    for (std::size_t i = 0; i < residual_.at.size(); ++i)
      params[residual_.at[i]] = from_coordinate(residual_.config.priors[residual_.at[i]], residual_.mean[i]);
    const Eigen::Index nx = config_.model->state_count;
    out_.residual = judge_rollouts(
        {&residual_.config, {params}, Eigen::Map<const Vector>(residual_.config.process_sd, nx)}, judge_, states_);
  }

  /// The last share of every grid judges; where that is too short for rollouts, whole grids do, the last ones first.
  /// False where there is too little of both.
  bool split(const std::vector<Grid>& grids) {
    std::size_t rollouts = 0;
    for (const Grid& grid : grids) {
      out_.seconds += seconds_of(grid);
      const auto cut = static_cast<std::size_t>((1.0 - options_.hold_out) * static_cast<double>(grid.points()));
      train_.push_back(part_of(grid, 0, cut));
      judge_.push_back(part_of(grid, cut, grid.points()));
      rollouts += seconds_of(judge_.back()) > kLeastJudged_s;
    }
    if (rollouts > 0) return out_.seconds > kLeastLearnt_s;
    train_ = grids;
    judge_.clear();
    double judged_s = 0.0;
    while (train_.size() > 1 && judged_s < options_.hold_out * out_.seconds) {
      if (seconds_of(train_.back()) > kLeastJudged_s) {
        judged_s += seconds_of(train_.back());
        judge_.push_back(train_.back());
      }
      train_.pop_back();
    }
    return !judge_.empty() && out_.seconds - judged_s > kLeastLearnt_s;
  }

  /// The priors' centres, refitted as the fallback of `tiller gap` does it, which is tried on the way.
  void choose_params(const std::vector<Grid>& grids) {
    for (std::uint32_t p = 0; p < config_.param_count; ++p) out_.params.push_back(centre_of(config_.priors[p]));
    out_.base = out_.params;
    out_.base_sd.assign(out_.params.size(), 0.0);
    const std::uint32_t nf = config_.model->joint_count;
    if (!options_.refit || nf > kMostRefitJoints) return;
    double best = -HUGE_VAL;
    for (std::uint32_t j = 0; j < nf && !stopped(); ++j) {
      tell(std::string("a residual at ") + config_.model->joints[j].name, j / static_cast<double>(nf));
      gap::ResidualFit fit;
      std::string error;
      if (!gap::fit_residual(config_, grids, out_.params.data(), j, fit, error)) continue;
      if (!(fit.log_evidence > best) || fit.nominal.size() != config_.param_count) continue;
      best = fit.log_evidence;
      refitted_ = fit.nominal;
      residual_ = fit;
      out_.residual_joint = config_.model->joints[j].name;
    }
    if (!refitted_.empty()) take_fit();
  }
  /// Both sets of parameters from the residual's fit.
  void take_fit() {
    out_.base = out_.params = refitted_;
    const std::size_t d = residual_.at.size();
    for (std::size_t i = 0; i < d; ++i) {
      const std::uint32_t p = residual_.at[i];
      if (p >= config_.param_count) continue;  // a force of the residual
      const double value = from_coordinate(config_.priors[p], residual_.mean[i]);
      const double sd = std::sqrt(residual_.covariance[i * d + i]);
      out_.base[p] = value;
      out_.base_sd[p] = config_.priors[p].kind == tiller_prior_log_normal ? value * sd : sd;
    }
  }

  StoredNetwork fit(Form form, const DynamicsData& data, bool final) const {
    StoredNetwork n;
    n.inputs = network_inputs(robot_);
    n.outputs = network_outputs(robot_);
    const auto report = [this](double share) {
      tell("training", share);
      return !stopped();
    };
    if (form == Form::gaussian) {
      GaussianOptions options = options_.gaussian;
      if (!final) options.members = 1;
      const GaussianFit fitted = fit_gaussian(data, options);
      n.kind = tiller_network_gaussian;
      n.members = static_cast<std::uint32_t>(options.members);
      n.hidden[0] = static_cast<std::uint32_t>(std::min<Eigen::Index>(options.inducing, data.x.cols()));
      n.hidden[1] = static_cast<std::uint32_t>(options.waves);
      n.weights = fitted.weights;
      return n;
    }
    EnsembleOptions options = options_.ensemble;
    options.progress = report;
    if (!final) options.members = 2;
    const std::vector<Member> members = train_ensemble(data, options);
    n.members = static_cast<std::uint32_t>(members.size());
    for (std::size_t l = 0; l < std::min<std::size_t>(2, options.hidden.size()); ++l)
      n.hidden[l] = static_cast<std::uint32_t>(options.hidden[l]);
    for (const Member& member : members) {
      const nets::Mlp plain = in_units(member.mlp, data);
      for (Eigen::Index k = 0; k < plain.weights.size(); ++k) n.weights.push_back(static_cast<float>(plain.weights(k)));
    }
    return n;
  }

  /// Learns, smooths with what was learnt, and learns again: the walk has less to explain, and blurs less.
  StoredNetwork learn_in_passes(Form form, const std::vector<Grid>& grids, const SmoothedForces& first,
                                Vector& force_sd, SmoothedForces& forces) const {
    forces = first;
    Matrix known = Matrix::Zero(forces.force.rows(), forces.force.cols());
    StoredNetwork network;
    for (int pass = 0; pass < options_.passes && !stopped(); ++pass) {
      tell(form == Form::gaussian ? "Gaussian process" : "network", pass / static_cast<double>(options_.passes));
      const DynamicsData data = make_dynamics_data(config_, forces, known);
      const bool final = pass + 1 == options_.passes;
      network = fit(form, data, final);
      const LoadedNetwork loaded(network);
      Config with;
      if (!with_network(smoothing_, loaded, with)) return network;
      std::vector<double> params = out_.base;
      params.push_back(0.0);
      const Vector sd = choose_force_sd(with, grids, params, force_sd / 1.5);
      SmoothedForces again;
      std::string error;
      if (!smooth_forces(with, grids, params, sd, again, error)) return network;
      force_sd = sd;
      forces = again;
      known = member_forces(loaded.network, forces);
    }
    return network;
  }
  /// What the first member says, with which the smoother ran.
  Matrix member_forces(const tiller_network_t& network, const SmoothedForces& at) const {
    const Matrix x = network_features(*config_.model, at.state, at.input);
    Matrix forces(network.outputs, x.cols());
    double out[TILLER_MAX_NETWORK_OUTPUTS];
    for (Eigen::Index k = 0; k < x.cols(); ++k) {
      evaluate_member(network, 0, x.col(k).data(), out);
      for (std::uint32_t o = 0; o < network.outputs; ++o) forces(o, k) = out[o];
    }
    return forces;
  }

  std::vector<std::vector<double>> member_params(std::uint32_t members) const {
    std::vector<std::vector<double>> all;
    for (std::uint32_t m = 0; m < members; ++m) {
      all.push_back(out_.base);
      all.back().push_back(m + 0.5);
    }
    return all;
  }

  void add(Form form) {
    Candidate c;
    c.name = form == Form::gaussian ? "gaussian_process" : "network";
    Vector force_sd = out_.force_sd;
    SmoothedForces forces;
    c.network = learn_in_passes(form, train_, first_, force_sd, forces);
    const LoadedNetwork loaded(c.network);
    Config with;
    if (c.network.weights.empty() || !with_network(config_, loaded, with)) return;
    calibrate({&with, member_params(c.network.members), Vector()}, forces, c.held_out, c.process_sd);
    c.spread_ratio = spread_ratio(loaded.network, forces);
    c.seen = seen(loaded.network, forces);
    out_.candidates.push_back(std::move(c));
  }

  /// The noise at which the held-out spread is honest: the configured one, plus what the force left over does to the
  /// velocities, times the factor at which the central 90 % hold 90 %.
  void calibrate(Hypotheses who, const SmoothedForces& left_over, HeldOut& held_out, Vector& chosen) const {
    const Vector configured =
        Eigen::Map<const Vector>(config_.process_sd, static_cast<Eigen::Index>(config_.model->state_count));
    const Vector left = velocity_noise(left_over);
    const auto covers = [&](double factor) {
      chosen = who.process_sd = (configured.array().square() + (factor * left).array().square()).sqrt();
      held_out = judge_rollouts(who, judge_, states_);
      return held_out.covered >= kCovered;
    };
    if (covers(0.0)) return;  // wide enough by the members alone
    double low = 1e-2, high = 1.0;
    while (!covers(high) && high < kMostNoise) {
      low = high;
      high *= 4.0;
    }
    for (int k = 0; k < 5 && !stopped() && high < kMostNoise; ++k) {
      const double middle = std::sqrt(low * high);
      (covers(middle) ? high : low) = middle;
    }
    covers(high);
  }
  /// Deviation of the velocities (nx) per root second that the forces, as white noise, would make.
  Vector velocity_noise(const SmoothedForces& forces) const {
    Vector noise = Vector::Zero(config_.model->state_count);
    for (std::uint32_t j = 0; j < config_.model->joint_count; ++j) {
      const double rms = std::sqrt(forces.force.row(j).squaredNorm() / static_cast<double>(forces.force.cols()));
      const double share = typical_(j) > 0.0 ? std::max(rms / typical_(j), 1e-3) : 0.0;
      noise(config_.model->joints[j].velocity) = share * acceleration(j) * std::sqrt(config_.period_s);
    }
    return noise;
  }
  /// Root mean square of a joint's acceleration in the smoothed states.
  double acceleration(std::uint32_t joint) const {
    const std::uint32_t v = config_.model->joints[joint].velocity;
    double squares = 0.0, count = 0.0;
    for (Eigen::Index k = 1; k < first_.state.cols(); ++k) {
      const double a = (first_.state(v, k) - first_.state(v, k - 1)) / config_.period_s;
      if (first_.weight[static_cast<std::size_t>(k)] == 0.0 || first_.weight[static_cast<std::size_t>(k - 1)] == 0.0)
        continue;
      squares += a * a;
      count += 1.0;
    }
    return count > 0.0 ? std::sqrt(squares / count) : 0.0;
  }

  /// Mean and deviation (outputs each) of the members at one column of inputs.
  static void moments(const tiller_network_t& network, const double* x, double* mean, double* sd) {
    double out[TILLER_MAX_NETWORK_OUTPUTS];
    std::fill_n(mean, network.outputs, 0.0);
    std::fill_n(sd, network.outputs, 0.0);
    for (std::uint32_t m = 0; m < network.members; ++m) {
      evaluate_member(network, m, x, out);
      for (std::uint32_t o = 0; o < network.outputs; ++o) {
        mean[o] += out[o] / network.members;
        sd[o] += out[o] * out[o] / network.members;
      }
    }
    for (std::uint32_t o = 0; o < network.outputs; ++o) sd[o] = std::sqrt(std::max(0.0, sd[o] - mean[o] * mean[o]));
  }

  /// The members' deviation at twice the largest velocities, over that in the data.
  double spread_ratio(const tiller_network_t& network, const SmoothedForces& forces) const {
    const auto spread = [&](const Matrix& state) {
      const Matrix x = network_features(*config_.model, state, forces.input);
      double sum = 0.0, mean[TILLER_MAX_NETWORK_OUTPUTS], sd[TILLER_MAX_NETWORK_OUTPUTS];
      for (Eigen::Index k = 0; k < x.cols(); k += kSeenEvery) {
        moments(network, x.col(k).data(), mean, sd);
        for (std::uint32_t o = 0; o < network.outputs; ++o) sum += sd[o];
      }
      return sum;
    };
    Matrix beyond = forces.state;
    for (std::uint32_t j = 0; j < config_.model->joint_count; ++j) {
      const std::uint32_t v = config_.model->joints[j].velocity;
      const double most = forces.state.row(v).cwiseAbs().maxCoeff();
      for (Eigen::Index k = 0; k < beyond.cols(); ++k) beyond(v, k) = beyond(v, k) >= 0.0 ? 2.0 * most : -2.0 * most;
    }
    return spread(beyond) / std::max(spread(forces.state), 1e-300);
  }

  Matrix seen(const tiller_network_t& network, const SmoothedForces& forces) const {
    const Matrix x = network_features(*config_.model, forces.state, forces.input);
    const Matrix total = member_forces(network, forces) + forces.force;
    const Eigen::Index nx = forces.state.rows(), nf = total.rows(), count = (x.cols() + kSeenEvery - 1) / kSeenEvery;
    Matrix all(nx + 3 * nf, count);
    for (Eigen::Index c = 0; c < count; ++c) {
      const Eigen::Index k = c * kSeenEvery;
      all.col(c).head(nx) = forces.state.col(k);
      all.col(c).segment(nx, nf) = total.col(k);
      moments(network, x.col(k).data(), &all(nx + nf, c), &all(nx + 2 * nf, c));
    }
    return all;
  }

  void choose() {
    const double residual = out_.residual.rms_sigma / out_.before.rms_sigma;
    double best = options_.most_ratio;
    if (options_.beat_residual && residual < best) best = residual;
    for (std::size_t i = 0; i < out_.candidates.size(); ++i) {
      const double ratio = out_.candidates[i].held_out.rms_sigma / out_.before.rms_sigma;
      if (!(ratio < best) || !is_better(out_.before, out_.candidates[i].held_out)) continue;
      best = ratio;
      out_.chosen = static_cast<int>(i);
    }
    if (out_.chosen >= 0) {
      out_.why = format("%s: held-out rollouts of one second are %.2f times as wrong as without it",
                        out_.candidates[static_cast<std::size_t>(out_.chosen)].name.c_str(), best);
    } else if (out_.candidates.empty()) {
      out_.why = "refused: nothing could be trained";
    } else {
      double nearest = HUGE_VAL;
      for (const Candidate& c : out_.candidates)
        nearest = std::min(nearest, c.held_out.rms_sigma / out_.before.rms_sigma);
      out_.why =
          format("refused: held-out rollouts of one second would be %.2f times as wrong as without it, ", nearest);
      const bool beaten = options_.beat_residual && nearest >= residual && residual < options_.most_ratio;
      out_.why += beaten ? format("and nine weights at %s come to %.2f", out_.residual_joint.c_str(), residual)
                  : nearest < options_.most_ratio
                      ? format("which %.1f s of rollouts do not tell from chance", out_.before.seconds)
                      : format("and %.2f is the most that earns a place", options_.most_ratio);
    }
  }

  /// What is given out has seen every log.
  void learn_from_all(const std::vector<Grid>& grids) {
    Candidate& c = out_.candidates[static_cast<std::size_t>(out_.chosen)];
    SmoothedForces first, forces;
    std::string error;
    if (!smooth_forces(smoothing_, grids, out_.base, out_.force_sd, first, error)) return;
    Vector force_sd = out_.force_sd;
    const StoredNetwork network =
        learn_in_passes(c.name == "network" ? Form::network : Form::gaussian, grids, first, force_sd, forces);
    if (!network.weights.empty() && !stopped()) c.network = network;
  }

  const RobotFile& robot_;
  const tiller_config_t& config_;
  Config smoothing_;  // of the filters: with the sensors as the logs have them
  const LearnOptions& options_;
  Learnt& out_;
  std::vector<Grid> train_, judge_;
  std::vector<double> refitted_;
  gap::ResidualFit residual_;
  SmoothedForces first_;
  Vector typical_;
  std::vector<Matrix> states_;
};

}  // namespace

bool with_network(const tiller_config_t& config, const LoadedNetwork& loaded, Config& out) {
  if (config.effect_count >= TILLER_MAX_EFFECTS || config.param_count >= TILLER_MAX_PARAMS) return false;
  if (network_defect(loaded.network) != nullptr) return false;  // weights that training has driven to infinity
  out = config;
  const bool tanh = loaded.network.kind == tiller_network_tanh;
  out.effects[out.effect_count++] = {
      static_cast<std::uint32_t>(tanh ? tiller_effect_network : tiller_effect_gaussian_process), 0};
  const double members = loaded.network.members;
  out.priors[out.param_count++] = members > 1.0 ? tiller_prior_t{tiller_prior_uniform, 0, 0.0, members, 0.0, members}
                                                : tiller_prior_t{tiller_prior_fixed, 0, 0.0, 0.0, 0.0, 0.0};
  out.network = &loaded.network;
  out.prior_mixture = nullptr;
  return true;
}

bool learn(const RobotFile& robot, const std::vector<Grid>& grids, const LearnOptions& options, Learnt& out,
           std::string& error) {
  const tiller_model_t& model = *robot.model;
  if (model.joint_count == 0 || model.quaternion_mask != 0) {
    error = std::string("learn: ") + model.name +
            (model.joint_count == 0 ? " has no joints, so no forces to learn"
                                    : " turns by a quaternion, which no "
                                      "network of forces reads") +
            "; choose another model, or `tiller gap`";
    return false;
  }
  for (std::uint32_t e = 0; e < robot.config.effect_count; ++e)
    if (effect_info(robot.config.effects[e].kind).learnt) {
      error = "learn: the robot file has a learnt effect already; leave its [[effects]] and [network] out first";
      return false;
    }
  return Learner(robot, options, out).run(grids, error);
}

}  // namespace tiller::tools::learn
