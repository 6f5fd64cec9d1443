#include "tools/imitate/imitate_policy.hpp"

#include <algorithm>
#include <cmath>

#include "tools/base/text.hpp"
#include "tools/imitate/distance.hpp"

namespace tiller::tools::imitate {
namespace {

constexpr std::size_t kMostReplayed = 6;

Motion roll(const Scene& scene, const SmallPolicy& policy, const Demonstration& d) {
  const auto steps = static_cast<int>(d.motion.steps());
  std::vector<Matrix> inputs;
  const std::vector<Matrix> states = roll_policy(scene, policy, d.motion.state.col(0), steps, &inputs);
  Motion motion{Matrix(scene.nx(), steps + 1), Matrix(scene.nu(), steps)};
  for (int k = 0; k <= steps; ++k) motion.state.col(k) = states[static_cast<std::size_t>(k)];
  for (int k = 0; k < steps; ++k) motion.input.col(k) = inputs[static_cast<std::size_t>(k)];
  return motion;
}

double share_at_limits(const Scene& scene, const Motion& motion) {
  constexpr double kNear = 1e-3;  // of the range, as in ExpandOptions
  const tiller_safety_config_t& s = scene.config.safety;
  double limited = 0;
  for (Eigen::Index k = 0; k < motion.steps(); ++k)
    for (std::uint32_t i = 0; i < scene.nu(); ++i) {
      const double near = kNear * (s.input_high[i] - s.input_low[i]), u = motion.input(i, k);
      limited += u >= s.input_high[i] - near || u <= s.input_low[i] + near ? 1 : 0;
    }
  return limited / static_cast<double>(motion.input.size());
}

Replayed replay(const Scene& scene, const Demonstration& d, const SmallPolicy& cloned, const SmallPolicy& policy,
                const Vector& spread) {
  Replayed r;
  r.demonstration = &d;
  r.before = roll(scene, cloned, d);
  r.after = roll(scene, policy, d);
  r.cost_demonstrated = scene.cost(scene.config, d.motion.state, d.motion.input);
  r.cost_after = scene.cost(scene.config, r.after.state, r.after.input);
  r.rms_before = distance(scene, r.before, d.motion, spread);
  r.rms_after = distance(scene, r.after, d.motion, spread);
  return r;
}

/// Where the policy does not do what was shown, even on the model.
void add_doubts(Imitated& result) {
  constexpr double kElsewhere = 1.0;  // what it would be if the policy stayed at the demonstrations' mean
  std::size_t elsewhere = 0;
  const Replayed* worst = nullptr;
  for (const Replayed& r : result.replayed) {
    if (r.rms_after <= kElsewhere) continue;
    ++elsewhere;
    if (!worst || r.rms_after > worst->rms_after) worst = &r;
  }
  if (worst)
    result.warnings.push_back(format(
        "the policy does something else than %zu of %zu demonstrations show, on %s by %.1f of their spread; it is "
        "not fit for the robot (more demonstrations, --iterations, --horizon)",
        elsewhere, result.replayed.size(), worst->demonstration->path.c_str(), worst->rms_after));
}

}  // namespace

bool learns_policy(const std::string& method) { return method == "adversarial" || method == "wasserstein"; }

bool has_limits(const RobotFile& robot, std::string& error) {
  const tiller_safety_config_t& s = robot.config.safety;
  for (std::uint32_t i = 0; i < robot.model->input_count; ++i) {
    if (std::isfinite(s.input_low[i]) && std::isfinite(s.input_high[i])) continue;
    error = "limits." + robot.inputs[i] + ": a policy commands a share of the range; give low and high";
    return false;
  }
  return true;
}

std::uint32_t rollout_length(const ImitateOptions& options) {
  return options.horizon > 0 ? static_cast<std::uint32_t>(options.horizon) : 60;
}

StoredPolicy stored_policy(const RobotFile& robot, const Scene& scene, const SmallPolicy& policy,
                           const std::vector<const Motion*>& motions) {
  const Observer observer(scene);
  nets::Mlp folded = policy.mlp;
  nets::absorb_input_scale(folded, policy.scale.mean, policy.scale.sd);
  StoredPolicy out;
  out.squash = tiller_policy_sine;
  out.network.inputs = policy_inputs(robot, out.reads);
  out.network.outputs = robot.inputs;
  for (std::size_t l = 1; l + 1 < folded.widths().size(); ++l)
    out.network.hidden[l - 1] = static_cast<std::uint32_t>(folded.widths()[l]);
  out.network.weights.assign(folded.weights.data(), folded.weights.data() + folded.weights.size());
  Vector low = Vector::Constant(observer.rows, INFINITY), high = -low;
  for (const Motion* motion : motions) {
    if (!motion->state.allFinite()) continue;
    const Matrix seen = observer.of(motion->state);
    low = low.cwiseMin(seen.rowwise().minCoeff());
    high = high.cwiseMax(seen.rowwise().maxCoeff());
  }
  out.low.assign(low.data(), low.data() + low.size());
  out.high.assign(high.data(), high.data() + high.size());
  return out;
}

void imitate_policy(const RobotFile& robot, const Scene& scene, const ImitateOptions& options, Imitated& result) {
  std::vector<Motion> motions;
  Eigen::Index longest = 0;
  for (Demonstration& d : result.demonstrations) {
    motions.push_back(d.motion);
    d.limited = share_at_limits(scene, d.motion);
    longest = std::max(longest, d.motion.steps());
  }
  AdversarialOptions by;
  by.wasserstein = options.method == "wasserstein";
  by.iterations = options.iterations;
  by.seed = options.seed;
  result.horizon = static_cast<std::uint32_t>(std::min<Eigen::Index>(result.horizon, longest));
  by.steps = static_cast<int>(result.horizon);
  const AdversarialFit fit = fit_adversarial(scene, motions, by);
  const SmallPolicy cloned = clone_behaviour(scene, motions, options.seed);
  const Vector spread = spread_of(scene, result.demonstrations);
  for (std::size_t i = 0; i < std::min(kMostReplayed, result.demonstrations.size()); ++i)
    result.replayed.push_back(replay(scene, result.demonstrations[i], cloned, fit.policy, spread));
  add_doubts(result);
  std::vector<const Motion*> seen;
  for (const Motion& motion : motions) seen.push_back(&motion);
  for (const Replayed& r : result.replayed) seen.push_back(&r.after);
  result.policy.stored = stored_policy(robot, scene, fit.policy, seen);
  result.policy.gap = fit.gap;
}

}  // namespace tiller::tools::imitate
