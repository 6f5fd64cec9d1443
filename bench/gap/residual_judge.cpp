#include "bench/gap/residual_judge.hpp"

#include <algorithm>
#include <ctime>

#include "posterior/prior.hpp"
#include "tiller/config.hpp"
#include "tools/gap/residual/fallback.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/smooth/grid_rollout.hpp"

namespace tiller::bench {
namespace {

using namespace tiller::tools;

constexpr std::uint32_t kLanes = 64;
constexpr double kHorizon_s = 1.0, kEvery_s = 0.5;

/// The scoring runs' rollouts from true states.
class Judge {
 public:
  Judge(const World& world, const RobotFile& robot) : world_(world), robot_(robot) {
    for (const Series& series : world.score)
      for (Grid& grid : make_grids(as_log(world, series), robot.log, robot.config)) grids_.push_back(std::move(grid));
  }

  /// Calls look(truth, lanes' last row, lanes, channel, measured) at the end of every rollout.
  template <class Look>
  void roll(const tiller_config_t& config, GridRollout& rollout, Look&& look) const {
    const auto horizon = static_cast<std::size_t>(std::lround(kHorizon_s / config.period_s));
    const auto every = static_cast<std::size_t>(std::lround(kEvery_s / config.period_s));
    for (std::size_t g = 0; g < grids_.size() && g < world_.score.size(); ++g) {
      const Series& series = world_.score[g];
      for (std::size_t k = every; k + horizon < std::min(grids_[g].points(), series.time_s.size()); k += every) {
        double state[TILLER_MAX_STATES];
        for (std::uint32_t i = 0; i < config.model->state_count; ++i) state[i] = series.truth[i][k];
        look(g, k, horizon, rollout.run(grids_[g], k, horizon, state));
      }
    }
  }

  double rms_sigma(const tiller_config_t& config, const std::vector<double>& params) const {
    GridRollout rollout(config, kLanePadding);
    for (std::uint32_t i = 0; i < config.param_count; ++i)
      std::fill_n(rollout.params() + i * kLanePadding, kLanePadding, params[i]);
    double squares = 0, count = 0;
    roll(config, rollout, [&](std::size_t g, std::size_t k, std::size_t horizon, const double* path) {
      for (std::size_t s = 1; s <= horizon; ++s)
        for (std::uint32_t c = 0; c < config.measurement_count; ++c) {
          const std::uint32_t i = config.measured_state[c];
          const double at = path[(s * config.model->state_count + i) * kLanePadding];
          const double e = state_difference(*config.model, i, grids_[g].state[i][k + s], at) / config.measurement_sd[c];
          squares += e * e;
          count += 1;
        }
    });
    return std::sqrt(squares / count);
  }

  /// Central 90 % of the particles' rollouts, sensor noise added, against what was measured.
  void coverage(const tiller_config_t& config, GridRollout& particles, Judged& out) const {
    Rng rng(1, 77, 0);
    roll(config, particles, [&](std::size_t g, std::size_t k, std::size_t horizon, const double* path) {
      for (std::uint32_t c = 0; c < config.measurement_count; ++c) {
        const std::uint32_t i = config.measured_state[c];
        const double measured = grids_[g].state[i][k + horizon];
        std::vector<double> off(kLanes);
        for (std::uint32_t l = 0; l < kLanes; ++l)
          off[l] = state_difference(*config.model, i, path[(horizon * config.model->state_count + i) * kLanes + l],
                                    measured) +
                   config.measurement_sd[c] * rng.normal();
        std::sort(off.begin(), off.end());
        out.covered += off[3] <= 0 && off[kLanes - 4] >= 0;
        out.intervals += 1;
      }
    });
  }

  const std::vector<Grid>& grids() const { return grids_; }

 private:
  const World& world_;
  const RobotFile& robot_;
  std::vector<Grid> grids_;
};

void fill_particles(const gap::ResidualFit& fit, GridRollout& rollout) {
  tiller::Config config = fit.config;
  config.prior_mixture = &fit.joint_prior->mixture;
  const PriorDistribution law(config);
  std::vector<double> v(law.dimension() * kLanes);
  std::vector<std::uint32_t> index(kLanes);
  law.draw(7, kLanes, v.data(), index.data());
  for (std::uint32_t i = 0; i < config.param_count; ++i)
    std::fill_n(rollout.params() + i * kLanes, kLanes, config.priors[i].a);
  for (std::size_t j = 0; j < fit.at.size(); ++j)
    for (std::uint32_t l = 0; l < kLanes; ++l)
      rollout.params()[fit.at[j] * kLanes + l] = from_coordinate(config.priors[fit.at[j]], v[j * kLanes + l]);
}

/// Deviation over the particles of the joint's velocity after 0.1 s without input.
double spread(const gap::ResidualFit& fit, GridRollout& particles, const double* state) {
  const tiller_model_t& model = *fit.config.model;
  Grid idle;
  idle.period_s = fit.config.period_s;
  const auto steps = static_cast<std::size_t>(std::lround(0.1 / idle.period_s));
  idle.state.assign(model.state_count, std::vector<double>(steps + 1, NAN));
  idle.input.assign(model.input_count, std::vector<double>(steps + 1, 0.0));
  const double* path = particles.run(idle, 0, steps, state);
  const double* row = path + (steps * model.state_count + model.joints[fit.joint].velocity) * kLanes;
  double mean = 0, squares = 0;
  for (std::uint32_t l = 0; l < kLanes; ++l) mean += row[l] / kLanes;
  for (std::uint32_t l = 0; l < kLanes; ++l) squares += (row[l] - mean) * (row[l] - mean) / kLanes;
  return std::sqrt(squares);
}

/// States of the runs, against the same with the joint moved out of all data: by its range to either side, and to twice
/// its largest speed.
double spread_ratio(const World& world, const gap::ResidualFit& fit) {
  const tiller_joint_t& joint = fit.config.model->joints[fit.joint];
  double low = HUGE_VAL, high = -HUGE_VAL, fast = 0;
  for (const Series& s : world.work) {
    for (const double q : s.truth[joint.position]) low = std::min(low, q), high = std::max(high, q);
    for (const double v : s.truth[joint.velocity]) fast = std::max(fast, std::fabs(v));
  }
  const bool turns = ((fit.config.model->angle_mask >> joint.position) & 1u) != 0;
  const bool everywhere = turns && high - low > 3.5;  // a joint that went nearly all round has no position left
  GridRollout particles(fit.config, kLanes);
  fill_particles(fit, particles);
  std::vector<double> known, unknown;
  for (const Series& s : world.score)
    for (std::size_t k = 50; k < s.time_s.size(); k += 50) {
      double state[TILLER_MAX_STATES];
      for (std::uint32_t i = 0; i < fit.config.model->state_count; ++i) state[i] = s.truth[i][k];
      known.push_back(spread(fit, particles, state));
      const double side = k % 100 == 0 ? 1.0 : -1.0;
      if (!everywhere && k % 200 < 100) {
        state[joint.position] = 0.5 * (low + high) + side * (turns ? std::min(high - low, 3.1) : high - low);
      } else {
        state[joint.velocity] = 2.0 * side * fast;
      }
      unknown.push_back(spread(fit, particles, state));
    }
  return median(unknown) / median(known);
}

}  // namespace

bool judge(const WorldCase& wanted, Judged& out, std::string& error) {
  const auto world = make_world(wanted, error);
  if (!world) return false;
  const auto robot = parse_robot_file(world->robot_toml, "robot.toml", error);
  if (!robot) return false;
  std::vector<Grid> work;
  for (const Series& series : world->work)
    for (Grid& grid : make_grids(as_log(*world, series), robot->log, robot->config)) work.push_back(std::move(grid));
  double params[TILLER_MAX_PARAMS];
  for (std::uint32_t i = 0; i < robot->config.param_count; ++i) {
    const tiller_prior_t& p = robot->config.priors[i];
    params[i] = p.kind == tiller_prior_uniform ? 0.5 * (p.low + p.high) : p.a;
  }
  const std::clock_t begin = std::clock();
  gap::ResidualFit best;
  best.log_evidence = -HUGE_VAL;
  for (std::uint32_t j = 0; j < robot->config.model->joint_count; ++j) {
    gap::ResidualFit fit;
    if (gap::fit_residual(robot->config, work, params, j, fit, error) && fit.log_evidence > best.log_evidence)
      best = fit;
  }
  out.cpu_s = static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
  if (!std::isfinite(best.log_evidence)) return false;
  out.evidence = best.evidence_nats;
  const Judge judge(*world, *robot);
  std::vector<double> with;
  for (std::uint32_t i = 0; i < best.config.param_count; ++i) with.push_back(best.config.priors[i].a);
  for (std::size_t j = 0; j < best.at.size(); ++j)
    with[best.at[j]] = from_coordinate(best.config.priors[best.at[j]], best.mean[j]);
  out.before = judge.rms_sigma(robot->config, best.nominal);
  // as offer_residual() decides: what the logs speak against is not offered
  out.offered = best.evidence_nats >= 10 && best.rollout_ratio < 0.95;
  out.after = out.offered ? judge.rms_sigma(best.config, with) : out.before;
  GridRollout particles(best.config, kLanes);
  fill_particles(best, particles);
  judge.coverage(best.config, particles, out);
  out.spread_ratio = spread_ratio(*world, best);
  return true;
}

}  // namespace tiller::bench
