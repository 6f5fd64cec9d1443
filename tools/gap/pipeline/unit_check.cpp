#include "tools/gap/pipeline/unit_check.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "tools/base/text.hpp"
#include "tools/gap/fit/hypothesis.hpp"
#include "tools/gap/localise/residual_force.hpp"
#include "tools/gap/result/thresholds.hpp"

namespace tiller::tools::gap {
namespace {

constexpr double kSuspicious = 0.3;      // share of the forces' square that is left: beyond it a unit may be wrong
constexpr double kNearlyAll = 0.1;       // ... that a corrected unit may leave
constexpr double kCorrectedShare = 0.1;  // ... of what is left without the correction
constexpr int kPriorRounds = 3;          // of the search within the priors
constexpr int kPriorPlaces = 5;          // of a parameter in each round

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

double weak_square(const std::vector<double>& values, const ResidualForce& r) {
  const std::vector<double> bump = test_function(kTestHalfWidth * r.time_scale, r.period_s);
  double sum = 0;
  for (std::size_t k = 0; k + bump.size() <= values.size(); k += bump.size() / 4) {
    const double weak = std::inner_product(bump.begin(), bump.end(), values.data() + k, 0.0);
    if (std::isfinite(weak)) sum += weak * weak;
  }
  return sum;
}

// The share of the forces that the model leaves: residual over accelerating and driving force, 0 for a perfect model,
// about 1 or more for one that tells nothing. The worst joint's.
double unexplained(const tiller_config_t& config, const std::vector<Grid>& grids, const double* params) {
  std::string why;
  const std::vector<ResidualForce> forces = residual_forces(config, grids, params, why);
  if (!why.empty()) return 0;
  const tiller_model_t& model = *config.model;
  double worst = 0;
  for (std::uint32_t j = 0; j < model.joint_count; ++j) {
    double left = 0, all = 0;
    for (const ResidualForce& r : forces) {
      std::vector<double> measured = r.force[j];
      for (std::size_t k = 0; k < r.points(); ++k) measured[k] += r.model_force[j][k];
      left += weak_square(r.force[j], r);
      all += weak_square(measured, r);
      if (model.joints[j].drive != 0) all += weak_square(r.input[model.joints[j].drive - 1u], r);
    }
    if (all > 0) worst = std::max(worst, left / all);
  }
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
double least_unexplained(const tiller_config_t& config, const std::vector<Grid>& grids) {
  std::vector<double> params = prior_centre(config);
  double least = unexplained(config, grids, params.data()), width = 1;
  for (int round = 0; round < kPriorRounds; ++round, width /= 3)
    for (std::uint32_t i = 0; i < config.param_count; ++i) {
      if (config.priors[i].kind == tiller_prior_fixed) continue;
      double low = 0, high = 0;
      range_of(config.priors[i], low, high);
      if (!std::isfinite(low) || !std::isfinite(high)) continue;
      const double middle = params[i];
      for (int k = 0; k < kPriorPlaces; ++k) {
        std::vector<double> tried = params;
        tried[i] = std::clamp(middle + width * (high - low) * (k / (kPriorPlaces - 1.0) - 0.5), low, high);
        const double left = unexplained(config, grids, tried.data());
        if (left < least) least = left, params = tried;
      }
    }
  return least;
}

void check_units(const tiller_config_t& config, const std::vector<Grid>& grids, const std::string& paths,
                 Result& result) {
  double as_read = unexplained(config, grids, prior_centre(config).data());
  if (!(as_read > kSuspicious)) return;
  as_read = least_unexplained(config, grids);
  if (!(as_read > kSuspicious)) return;
  const Suspect* best = nullptr;
  double least = as_read;
  const std::vector<Suspect> suspects = suspects_of(config);
  for (const Suspect& s : suspects) {
    const double left = least_unexplained(config, corrected(grids, *config.model, s));
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
