#include "tools/gap/pipeline/unit_check.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "tools/base/text.hpp"
#include "tools/gap/fit/hypothesis.hpp"
#include "tools/gap/localise/residual_force.hpp"
#include "tools/gap/result/thresholds.hpp"
#include "tools/robot/units.hpp"
#include "tools/smooth/forced_step.hpp"

namespace tiller::tools::gap {
namespace {

constexpr double kDifferenceHalfWidth_s = 0.04;  // of parabolas: 9 points at 100 Hz
constexpr double kSuspicious = 0.3;      // share of the forces' square that is left: beyond it a unit may be wrong
constexpr double kNearlyAll = 0.1;       // ... that a corrected unit may leave
constexpr double kCorrectedShare = 0.1;  // ... of what is left without the correction
constexpr std::size_t kMostUnitPoints = 2000;  // of machines of many joints, whose forces cost the most
constexpr int kPriorRounds = 3;                // of the search within the priors
constexpr int kPriorPlaces = 5;                // of a parameter in each round

// A channel that may have been logged in another unit: what was read is `factor` times what it should have been.
struct Suspect {
  std::string name, unit, words;
  double factor = 1;
  std::uint32_t joint = TILLER_MAX_JOINTS, input = TILLER_MAX_INPUTS;
};

bool is_angle_name(const std::string& name) {
  const std::string end = "_rad";
  return name.size() > end.size() && name.compare(name.size() - end.size(), end.size(), end) == 0;
}

std::vector<Suspect> suspects_of(const tiller_config_t& config) {
  const tiller_model_t& model = *config.model;
  std::vector<Suspect> all;
  for (std::uint32_t j = 0; j < model.joint_count; ++j) {
    const std::uint32_t q = model.joints[j].position;
    if (q == TILLER_NO_POSITION) continue;
    const std::string name = model.state_names[q];
    // by its name too: a hinge between two ends is an angle that does not wrap
    const bool angle = (model.angle_mask >> q & 1u) != 0 || is_angle_name(name);
    if (angle) {
      all.push_back({name, "deg", "in degrees", 57.29577951308232, j});
      all.push_back({name, "-rad", "reversed in sign", -1, j});
    } else {
      all.push_back({name, "mm", "in mm", 1e3, j});
      all.push_back({name, "cm", "in cm", 1e2, j});
      all.push_back({name, "-m", "reversed in sign", -1, j});
    }
  }
  for (std::uint32_t i = 0; i < model.input_count; ++i) {
    if (is_goal(config, i)) continue;
    const std::string name = model.input_names[i];
    all.push_back({name, "", "reversed in sign", -1, TILLER_MAX_JOINTS, i});
    all.push_back(
        {name, name.find("Nm") != std::string::npos ? "mNm" : "", "in thousandths", 1e3, TILLER_MAX_JOINTS, i});
    all.push_back({name, name.find("Nm") == std::string::npos ? "kN" : "", "in thousands", 1e-3, TILLER_MAX_JOINTS, i});
  }
  return all;
}

std::vector<Grid> corrected(const std::vector<Grid>& grids, const tiller_model_t& model, const Suspect& s) {
  std::vector<Grid> copy = grids;
  for (Grid& grid : copy) {
    const auto scale = [&](std::vector<double>& values) {
      for (double& v : values) v /= s.factor;
    };
    if (s.input < TILLER_MAX_INPUTS) scale(grid.input[s.input]);
    if (s.joint < TILLER_MAX_JOINTS) {
      scale(grid.state[model.joints[s.joint].position]);
      scale(grid.state[model.joints[s.joint].velocity]);
    }
  }
  return copy;
}

double weak_square(const std::vector<double>& values, const Grid& grid) {
  const std::vector<double> bump = test_function(kTestHalfWidth * grid.time_scale, grid.period_s);
  double sum = 0;
  for (std::size_t k = 0; k + bump.size() <= values.size(); k += bump.size() / 4) {
    const double weak = std::inner_product(bump.begin(), bump.end(), values.data() + k, 0.0);
    if (std::isfinite(weak)) sum += weak * weak;
  }
  return sum;
}

// A joint's forces at the points of a grid, N or N m; NaN where they are not known.
struct JointForces {
  std::vector<double> missing, measured, input;  // without the model's, with it, and the drive's command
};

// By differences, so that no model has a hand in the state that it is asked about: a smoother follows the data in any
// unit, and calls a wrong unit a force. The inertia is what the model makes of unit forces over a period.
std::vector<JointForces> forces_by_differences(const tiller_config_t& config, const Grid& grid,
                                               const std::vector<double>& params) {
  const tiller_model_t& model = *config.model;
  const std::uint32_t nx = model.state_count, nf = model.joint_count;
  const double half_width_s = kDifferenceHalfWidth_s * grid.time_scale;
  std::vector<JointForces> all(nf);
  for (JointForces& f : all) f.missing.assign(grid.points(), NAN), f.measured = f.input = f.missing;
  Config forced;
  std::string error;
  if (!with_forces(config, forced, error)) return all;
  ForcedStep step(forced, params, Eigen::VectorXd::Ones(nf));
  double state[TILLER_MAX_STATES], after[TILLER_MAX_STATES];
  bool begun = false;
  for (std::size_t k = 0; k + 1 < grid.points(); ++k) {
    if (!estimate_state(grid, config, k, half_width_s, state)) continue;
    if (!estimate_state(grid, config, k + 1, half_width_s, after)) continue;
    Eigen::VectorXd z = Eigen::VectorXd::Zero(nx + nf), next, change(nf), missing(nf);
    Eigen::MatrixXd slope, by_force(nf, nf);
    for (std::uint32_t i = 0; i < nx; ++i) z(i) = state[i];
    if (!begun) step.begin(grid, k);
    begun = true;
    if (!step.run(grid, k, z, next, slope)) continue;
    for (std::uint32_t j = 0; j < nf; ++j) {
      const std::uint32_t v = model.joints[j].velocity;
      by_force.row(j) = slope.row(v).tail(nf);
      change(j) = next(v) - state[v];
      missing(j) = after[v] - next(v);
    }
    const Eigen::FullPivLU<Eigen::MatrixXd> inertia(by_force);
    if (!inertia.isInvertible()) continue;
    missing = inertia.solve(missing).eval();
    const Eigen::VectorXd measured = missing + inertia.solve(change);
    for (std::uint32_t j = 0; j < nf; ++j) {
      all[j].missing[k] = missing(j);
      all[j].measured[k] = measured(j);
      const std::uint32_t drive = model.joints[j].drive;
      if (drive != 0) all[j].input[k] = is_goal(config, drive - 1u) ? 0.0 : grid.input[drive - 1u][k];
    }
  }
  return all;
}

// The share of the forces that the model leaves: residual over accelerating and driving force, 0 for a perfect model,
// about 1 or more for one that tells nothing. The worst joint's.
double unexplained(const tiller_config_t& config, const std::vector<Grid>& grids, const double* params) {
  std::string why;
  if (!states_are_measured(config, why)) return 0;
  const std::vector<double> fixed(params, params + config.param_count);
  const std::uint32_t joints = config.model->joint_count;
  std::vector<double> left(joints, 0.0), all(joints, 0.0);
  for (const Grid& wrapped : grids) {
    const Grid grid = unwrapped(wrapped, *config.model);
    const std::vector<JointForces> forces = forces_by_differences(config, grid, fixed);
    for (std::uint32_t j = 0; j < joints; ++j) {
      left[j] += weak_square(forces[j].missing, grid);
      all[j] += weak_square(forces[j].measured, grid) + weak_square(forces[j].input, grid);
    }
  }
  double worst = 0;
  for (std::uint32_t j = 0; j < joints; ++j)
    if (all[j] > 0) worst = std::max(worst, left[j] / all[j]);
  return worst;
}

// Where a parameter may be: its bounds, or four deviations about its centre.
void range_of(const tiller_prior_t& prior, double& low, double& high) {
  low = prior.low, high = prior.high;
  if (prior.kind == tiller_prior_normal) {
    low = std::max(low, prior.a - 4 * prior.b);
    high = std::min(high, prior.a + 4 * prior.b);
  } else if (prior.kind == tiller_prior_log_normal) {
    low = std::max(low, prior.a * std::exp(-4 * prior.b));
    high = std::min(high, prior.a * std::exp(4 * prior.b));
  }
}

}  // namespace

// A search along one parameter after the other,
// each round over a third of the range before.
double least_unexplained(const tiller_config_t& config, const std::vector<Grid>& grids, const volatile int* stop,
                         std::vector<double>* best) {
  std::vector<double> params = prior_centre(config);
  double least = unexplained(config, grids, params.data()), width = 1;
  const int rounds = config.model->joint_count <= kFewJoints ? kPriorRounds : 1;
  for (int round = 0; round < rounds; ++round, width /= 3)
    for (std::uint32_t i = 0; i < config.param_count; ++i) {
      if (config.priors[i].kind == tiller_prior_fixed) continue;
      double low = 0, high = 0;
      range_of(config.priors[i], low, high);
      if (!std::isfinite(low) || !std::isfinite(high)) continue;
      const double middle = params[i];
      for (int k = 0; k < kPriorPlaces && !(stop && *stop); ++k) {
        std::vector<double> tried = params;
        tried[i] = std::clamp(middle + width * (high - low) * (k / (kPriorPlaces - 1.0) - 0.5), low, high);
        const double left = unexplained(config, grids, tried.data());
        if (left < least) least = left, params = tried;
      }
    }
  if (best) *best = params;
  return least;
}

namespace {

// The first points of each grid, `most` in all.
std::vector<Grid> first_points(const std::vector<Grid>& grids, std::size_t most) {
  std::size_t all = 0;
  for (const Grid& grid : grids) all += grid.points();
  if (all <= most) return grids;
  std::vector<Grid> parts;
  for (const Grid& grid : grids) parts.push_back(part_of(grid, 0, grid.points() * most / all));
  return parts;
}

}  // namespace

void check_units(const tiller_config_t& config, const std::vector<Grid>& all, const std::string& paths,
                 const volatile int* stop, Result& result) {
  const bool few = config.model->joint_count <= kFewJoints;
  const std::vector<Grid> grids = few ? all : first_points(all, kMostUnitPoints);
  double as_read = unexplained(config, grids, prior_centre(config).data());
  if (!(as_read > kSuspicious)) return;
  std::vector<double> params;
  as_read = least_unexplained(config, grids, stop, &params);
  if (!(as_read > kSuspicious)) return;
  const Suspect* best = nullptr;
  double least = as_read;
  const std::vector<Suspect> suspects = suspects_of(config);
  for (const Suspect& s : suspects) {
    if (stop && *stop) return;
    const std::vector<Grid> other = corrected(grids, *config.model, s);
    // where each costs much, the parameters are fitted anew to what helps without that
    double left = few ? least_unexplained(config, other, stop) : unexplained(config, other, params.data());
    if (!few && left < as_read && left < least) left = std::min(left, least_unexplained(config, other, stop));
    if (!(left < least)) continue;
    least = left;
    best = &s;
  }
  if (!best || !(least < kNearlyAll) || !(least < kCorrectedShare * as_read)) return;
  const std::string unit =
      best->unit.empty() ? "" : ": write [log] units = { " + best->name + " = \"" + best->unit + "\" }";
  result.reasons.push_back(
      paths + ": column '" + best->name + "': the model leaves " + format("%.0f %%", 100 * std::sqrt(as_read)) +
      " of the forces unexplained as it stands, whatever parameters its priors allow, and " +
      format("%.0f %%", 100 * std::sqrt(least)) + " if it is " + best->words + unit +
      (best->factor == -1 ? "; or its counterpart (input or position) is the one that is reversed" : ""));
}

}  // namespace tiller::tools::gap
