#include "tools/learn/force_data.hpp"

#include <algorithm>
#include <cmath>

#include "effects/effect_info.hpp"
#include "networks/network_check.hpp"
#include "rollout/measurement.hpp"
#include "tools/base/text.hpp"
#include "tools/gap/fit/hypothesis.hpp"
#include "tools/gap/pipeline/gap.hpp"
#include "tools/gap/report/robot_writer.hpp"
#include "tools/learn/own_params.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools::learn {
namespace {

using Vector = Eigen::VectorXd;

constexpr double kCovered = 0.9, kMostNoise = 1e4;
constexpr double kLeastJudged_s = 1.3;  // a rollout of one second, and what the filter needs to begin
constexpr double kLeastLearnt_s = 3.0;

double seconds_of(const Grid& grid) { return static_cast<double>(grid.points()) * grid.period_s; }

Config with_sensors(const tiller_config_t& config, double factor) {
  Config out = config;
  for (std::uint32_t c = 0; c < config.measurement_count; ++c) out.measurement_sd[c] *= factor;
  return out;
}

std::vector<Eigen::MatrixXd> states_by(const tiller_config_t& config, const Ground& ground,
                                       const std::vector<Grid>& grids) {
  return filtered_states(with_sensors(config, ground.sensor_factor), grids, gap::prior_centre(config), ground.force_sd);
}

/// The states that rollouts of `config` begin in: those of the model alone, `plain`, or where an effect is a sensor's
/// those that its own filter reads.
std::vector<Eigen::MatrixXd> begins_of(const tiller_config_t& config, const Ground& ground,
                                       const tiller_config_t& plain, const Ground& plain_ground,
                                       const std::vector<Grid>& grids) {
  return has_sensor_effects(config) ? states_by(config, ground, grids) : states_by(plain, plain_ground, grids);
}

/// Root mean square (nf) of the joints' accelerations in the smoothed states.
Vector accelerations(const tiller_config_t& config, const SmoothedForces& forces) {
  Vector rms = Vector::Zero(config.model->joint_count);
  for (Eigen::Index j = 0; j < rms.size(); ++j) {
    const std::uint32_t v = config.model->joints[j].velocity;
    double squares = 0.0, count = 0.0;
    for (Eigen::Index k = 1; k < forces.state.cols(); ++k) {
      const double a = (forces.state(v, k) - forces.state(v, k - 1)) / config.period_s;
      if (forces.weight[static_cast<std::size_t>(k)] == 0.0 || forces.weight[static_cast<std::size_t>(k - 1)] == 0.0)
        continue;
      squares += a * a;
      count += 1.0;
    }
    rms(j) = count > 0.0 ? std::sqrt(squares / count) : 0.0;
  }
  return rms;
}

/// Deviation of the velocities (nx) per root second that the forces, as white noise, would make.
Vector velocity_noise(const tiller_config_t& config, const Ground& ground, const SmoothedForces& forces) {
  Vector noise = Vector::Zero(config.model->state_count);
  for (std::uint32_t j = 0; j < config.model->joint_count; ++j) {
    const double rms = std::sqrt(forces.force.row(j).squaredNorm() / static_cast<double>(forces.force.cols()));
    const double share = ground.typical(j) > 0.0 ? std::max(rms / ground.typical(j), 1e-3) : 0.0;
    noise(config.model->joints[j].velocity) = share * ground.acceleration(j) * std::sqrt(config.period_s);
  }
  return noise;
}

/// The noise at which the held-out spread is honest: the configured one, plus `left` (nx) times the factor at which the
/// central 90 % hold 90 %.
HeldOut calibrate(Hypotheses who, const Vector& left, const std::vector<Grid>& grids,
                  const std::vector<Eigen::MatrixXd>& states, Vector& chosen) {
  const Vector configured =
      Eigen::Map<const Vector>(who.config->process_sd, static_cast<Eigen::Index>(who.config->model->state_count));
  HeldOut held_out;
  const auto covers = [&](double factor) {
    chosen = who.process_sd = (configured.array().square() + (factor * left).array().square()).sqrt();
    held_out = judge_rollouts(who, grids, states);
    return held_out.covered >= kCovered;
  };
  if (covers(0.0)) return held_out;  // wide enough by the members alone
  double low = 1e-2, high = 1.0;
  while (!covers(high) && high < kMostNoise) {
    low = high;
    high *= 4.0;
  }
  for (int k = 0; k < 5 && high < kMostNoise; ++k) {
    const double middle = std::sqrt(low * high);
    (covers(middle) ? high : low) = middle;
  }
  covers(high);
  return held_out;
}

/// The configuration with the effect; `loaded` outlives it. False where there is no room for it, or where its weights
/// are no network's: training that diverged.
bool with_network(const tiller_config_t& config, const LoadedNetwork& loaded, Config& out, std::string& error) {
  if (config.effect_count >= TILLER_MAX_EFFECTS || config.param_count >= TILLER_MAX_PARAMS)
    return error = "no room for one more effect", false;
  if (network_defect(loaded.network) != nullptr) return error = "the network's weights are none", false;
  out = config;
  const bool tanh = loaded.network.kind == tiller_network_tanh;
  out.effects[out.effect_count++] = {
      static_cast<std::uint32_t>(tanh ? tiller_effect_network : tiller_effect_gaussian_process), 0};
  out.priors[out.param_count++] = {tiller_prior_fixed, 0, 0.0, 0.0, 0.0, 0.0};  // the first member
  out.network = &loaded.network;
  out.prior_mixture = nullptr;
  return true;
}

/// Parameters at their centres, with each member in turn where forces are learnt.
std::vector<std::vector<double>> member_params(const tiller_config_t& config) {
  const std::vector<double> centre = gap::prior_centre(config);
  std::size_t at = config.model->param_count, member = centre.size();
  for (std::uint32_t e = 0; e < config.effect_count; ++e) {
    const EffectInfo& info = effect_info(config.effects[e].kind);
    if (info.learnt) member = at;
    at += static_cast<std::size_t>(info.param_count);
  }
  if (member == centre.size() || config.network == nullptr) return {centre};
  std::vector<std::vector<double>> all(config.network->members, centre);
  for (std::size_t m = 0; m < all.size(); ++m) all[m][member] = static_cast<double>(m) + 0.5;
  return all;
}

/// What `ground` lacks but text and parameters: how the logs are smoothed by it, and what it comes to by itself.
bool smooth_ground(const RobotFile& robot, const Course& course, const Ground& states_of, const RobotFile& states_robot,
                   Ground& ground, std::string& error) {
  const tiller_config_t& config = robot.config;
  const std::vector<double> base = gap::prior_centre(config);
  ground.typical = typical_forces(config, course.train, base);
  if (!(ground.typical.size() > 0 && ground.typical.maxCoeff() > 0.0)) {
    error = "the logs never move a joint, or are too short to tell; record a motion (`tiller excite`)";
    return false;
  }
  ground.force_sd = ground.typical;
  const Config honest = with_honest_sensors(config, course.train, base,
                                            ground.typical.cwiseMax(1e-6 * ground.typical.maxCoeff()), ground.force_sd);
  if (config.measurement_count > 0) ground.sensor_factor = honest.measurement_sd[0] / config.measurement_sd[0];
  if (!smooth_forces(honest, course.train, base, ground.force_sd, ground.forces, error)) return false;
  ground.acceleration = accelerations(config, ground.forces);
  const std::vector<Eigen::MatrixXd> states = begins_of(config, ground, states_robot.config, states_of, course.judge);
  ground.before = calibrate({&config, {ground.params.empty() ? base : ground.params}, Vector()},
                            velocity_noise(config, ground, ground.forces), course.judge, states, ground.process_sd);
  return true;
}

bool can_learn(const RobotFile& robot, std::string& error) {
  const tiller_model_t& model = *robot.config.model;
  if (model.joint_count == 0 || model.quaternion_mask != 0) {
    error = std::string(model.name) +
            (model.joint_count == 0 ? " has no joints, so no forces to learn"
                                    : " turns by a quaternion, which no network of forces reads") +
            "; choose another model, or `tiller gap`";
    return false;
  }
  for (std::uint32_t e = 0; e < robot.config.effect_count; ++e)
    if (effect_info(robot.config.effects[e].kind).learnt) {
      error = "the robot file has a learnt effect already; leave its [[effects]] and [network] out first";
      return false;
    }
  return true;
}

}  // namespace

bool split(const std::vector<Grid>& grids, double share, Course& course, std::string& error) {
  std::size_t rollouts = 0;
  for (const Grid& grid : grids) {
    course.seconds += seconds_of(grid);
    const auto cut = static_cast<std::size_t>((1.0 - share) * static_cast<double>(grid.points()));
    course.train.push_back(part_of(grid, 0, cut));
    course.judge.push_back(part_of(grid, cut, grid.points()));
    rollouts += seconds_of(course.judge.back()) > kLeastJudged_s;
  }
  if (rollouts > 0 && course.seconds > kLeastLearnt_s) return true;
  course.train = grids;
  course.judge.clear();
  double judged_s = 0.0;
  while (rollouts == 0 && course.train.size() > 1 && judged_s < share * course.seconds) {
    if (seconds_of(course.train.back()) > kLeastJudged_s) {
      judged_s += seconds_of(course.train.back());
      course.judge.push_back(course.train.back());
    }
    course.train.pop_back();
  }
  if (!course.judge.empty() && course.seconds - judged_s > kLeastLearnt_s) return true;
  error = format(
      "the logs hold %.1f s without a gap; rollouts of one second want a log of at least %.0f s, or two of %.0f s each",
      course.seconds, kLeastLearnt_s / (1.0 - share) + kLeastJudged_s, kLeastLearnt_s);
  return false;
}

bool lay_ground(const RobotFile& robot, const std::string& text, const Course& course, Ground& ground,
                std::string& error) {
  if (!can_learn(robot, error)) return false;
  gap::ResidualFit fit;
  ground.text = text;
  ground.params = gap::prior_centre(robot.config);
  const bool fitted = best_residual(robot.config, course.train, fit);
  if (fitted) {
    ground.params = fit.nominal;
    if (!gap::write_robot(robot, text, own_params(robot, fit), "", ground.text, error)) return false;
  }
  const auto refitted = parse_robot_file(ground.text, robot.path, error);
  if (!refitted || !smooth_ground(*refitted, course, ground, *refitted, ground, error)) return false;
  if (!fitted) return true;
  ground.residual_joint = robot.config.model->joints[fit.joint].name;
  ground.residual = judge_residual(fit, course.judge, states_by(refitted->config, ground, course.judge));
  return true;
}

bool find_catalogue(const RobotFile& robot, const std::string& text, const Course& course, const Ground& plain,
                    unsigned threads, const std::string& hash, Ground& ground, std::string& error) {
  constexpr std::size_t kJudged = 4;  // sets of effects that are tried on rollouts
  gap::Options options;
  options.max_effects = 2;
  options.threads = threads;
  for (std::uint32_t k = 0; k < effect_kind_count(); ++k) {
    const EffectInfo& info = effect_info(k);
    if (!info.unnamed) options.only.emplace_back(info.name);
  }
  gap::Result found = gap::find_gap_on(robot.config, robot.names.params, course.train, {}, options);
  std::sort(found.ranking.begin(), found.ranking.end(),
            [](const gap::Explanation& a, const gap::Explanation& b) { return a.gain_nats > b.gain_nats; });
  const auto origin = parse_robot_file(plain.text, robot.path, error);
  if (!origin) return false;
  const std::vector<Eigen::MatrixXd> states = states_by(origin->config, plain, course.train);
  const auto wrong = [&](const RobotFile& with) {
    const bool reads = has_sensor_effects(with.config);
    return judge_robot(with, course.train, reads ? states_by(with.config, plain, course.train) : states).rms_sigma;
  };
  double least = wrong(*origin);
  std::size_t tried = 0;
  for (const gap::Explanation& one : found.ranking) {
    std::string with;
    if (one.effects.empty() || tried++ >= kJudged || !gap::write_robot(robot, text, one, hash, with, error)) continue;
    const auto read = parse_robot_file(with, robot.path, error);
    const double value = read ? wrong(*read) : HUGE_VAL;
    if (!(value < least)) continue;
    least = value;
    ground.text = with;
    ground.origin = gap::effects_text(one.effects, robot.config);
  }
  error = found.reasons.empty() ? "no effect of the catalogue brings rollouts nearer" : join(found.reasons, "; ");
  if (ground.text.empty()) return false;
  const auto with = parse_robot_file(ground.text, robot.path, error);
  return with && smooth_ground(*with, course, plain, *origin, ground, error);
}

bool smooth_beside(const RobotFile& robot, const Ground& ground, const Ground& states_of, const LoadedNetwork& network,
                   const Course& course, const Eigen::VectorXd& force_sd, bool judged, Beside& out,
                   std::string& error) {
  const auto base = parse_robot_file(ground.text, robot.path, error);
  const auto by = parse_robot_file(states_of.text, robot.path, error);
  Config with;
  if (!base || !by || !with_network(base->config, network, with, error)) return false;
  const Config honest = with_sensors(with, ground.sensor_factor);
  const std::vector<double> centre = gap::prior_centre(with);
  out.force_sd = choose_force_sd(honest, course.train, centre, force_sd / 1.5);
  if (!smooth_forces(honest, course.train, centre, out.force_sd, out.forces, error)) return false;
  if (!judged) return true;
  out.held_out =
      calibrate({&with, member_params(with), Vector()}, velocity_noise(with, ground, out.forces), course.judge,
                begins_of(base->config, ground, by->config, states_of, course.judge), out.process_sd);
  return true;
}

HeldOut judge_robot(const RobotFile& robot, const std::vector<Grid>& grids,
                    const std::vector<Eigen::MatrixXd>& states) {
  const Vector process_sd = Eigen::Map<const Vector>(robot.config.process_sd, robot.config.model->state_count);
  return judge_rollouts({&robot.config, member_params(robot.config), process_sd}, grids, states);
}

}  // namespace tiller::tools::learn
