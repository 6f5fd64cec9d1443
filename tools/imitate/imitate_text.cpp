#include <algorithm>
#include <cmath>

#include "tools/base/interval_text.hpp"
#include "tools/base/text.hpp"
#include "tools/imitate/imitate_policy.hpp"

namespace tiller::tools::imitate {
namespace {

std::string judgement(const LearntWeight& w) {
  if (!w.varies) return "never has a slope here: stays";
  if (!w.identified) return "not identified";
  return "";
}

std::string weights_table(const MaxentFit& fit) {
  std::string text = format("  %-36s %12s %12s %25s\n", "weight", "file", "learnt", "90 % interval");
  for (const LearntWeight& w : fit.weights) {
    const std::string interval = std::isfinite(w.low) && w.varies ? interval_text(w.low, w.high) : "-";
    text += format("  %-36s %12.5g %12.5g %25s  %s\n", w.term.key.c_str(), w.term.value, w.value, interval.c_str(),
                   judgement(w).c_str());
  }
  for (const LearntTarget& t : fit.targets)
    text += format("  %-36s %12.5g %12.5g %25s  %s\n", t.target.key.c_str(), t.target.value, t.value,
                   interval_text(t.low, t.high).c_str(), t.identified ? "" : "not identified");
  return text;
}

std::string replay_table(const Imitated& result) {
  std::string text = format("\n  %-32s %8s %10s %12s %14s %14s\n", "demonstration", "periods", "at limits", "its cost",
                            "cost replanned", "distance (was)");
  for (const Replayed& r : result.replayed) {
    const Demonstration& d = *r.demonstration;
    text += format("  %-32s %8ld %8.0f %% %12.5g %14.5g %6.3f (%.3f)\n", d.path.c_str(),
                   static_cast<long>(d.motion.steps()), 100 * d.limited, r.cost_demonstrated, r.cost_after, r.rms_after,
                   r.rms_before);
  }
  return text + "  distance: RMS of the replanned states from the demonstrated ones, over their spread there\n";
}

std::string likelihood_text(const MaxentFit& fit) {
  std::string text = format("log likelihood %.1f (the file's weights: %.1f); %d iterations%s\n", fit.log_likelihood,
                            fit.before, fit.iterations, fit.converged ? "" : ", not converged");
  for (const auto& [a, b] : fit.alike)
    text += format("%s and %s: the demonstrations tell their ratio to each other better than their size\n",
                   fit.weights[a].term.key.c_str(), fit.weights[b].term.key.c_str());
  return text;
}

/// Means of the critic's gap over the first and the last tenth of the iterations.
std::string gap_text(const std::vector<double>& gap) {
  const std::size_t tenth = std::max<std::size_t>(1, gap.size() / 10);
  double first = 0, last = 0;
  for (std::size_t i = 0; i < tenth; ++i) {
    first += gap[i] / static_cast<double>(tenth);
    last += gap[gap.size() - 1 - i] / static_cast<double>(tenth);
  }
  return format("what the critic still tells apart: %.3g (first tenth of the iterations: %.3g)\n", last, first);
}

std::string policy_table(const Imitated& result) {
  std::string text =
      format("\n  %-32s %8s %10s %12s %12s\n", "demonstration", "periods", "at limits", "distance", "of cloning");
  for (const Replayed& r : result.replayed)
    text += format("  %-32s %8ld %8.0f %% %12.3f %12.3f\n", r.demonstration->path.c_str(),
                   static_cast<long>(r.demonstration->motion.steps()), 100 * r.demonstration->limited, r.rms_after,
                   r.rms_before);
  return text +
         "  distance: RMS of the states that the policy reaches on the model from the same start, over their spread\n"
         "  cloning: least squares on the same inputs\n";
}

std::string policy_summary(const RobotFile& robot, const ImitateOptions& options, const Imitated& result) {
  const StoredNetwork& net = result.policy.stored.network;
  return format("%s: %zu demonstrations; a policy by %s, %d iterations, rollouts of %u periods\n", robot.name.c_str(),
                result.demonstrations.size(),
                options.method == "wasserstein" ? "adversarial imitation, Wasserstein" : "adversarial imitation",
                options.iterations, result.horizon) +
         format("network: %zu inputs, %u x %u, %zu weights\n", net.inputs.size(), net.hidden[0], net.hidden[1],
                net.weights.size()) +
         gap_text(result.policy.gap) + policy_table(result);
}

}  // namespace

std::string imitate_text(const RobotFile& robot, const ImitateOptions& options, const Imitated& result) {
  if (learns_policy(options.method)) return policy_summary(robot, options, result);
  const MaxentFit& fit = result.fit;
  std::string text = format("%s: %zu demonstrations; ", robot.name.c_str(), result.demonstrations.size());
  text += result.horizon == 0 ? "each one plan to its end\n" : format("a horizon of %u periods\n", result.horizon);
  for (const CostTerm& term : result.kept) text += format("kept: %s = %g\n", term.key.c_str(), term.value);
  text += weights_table(fit);
  if (options.method == "matching")
    text +=
        format("plans spend at most %.1f %% more of a feature than the demonstrations (no weights: under %.1f %%)\n",
               100 * result.matching.excess, 100 * result.matching.bound);
  else
    text += format("%ld inputs judged, %ld more at limits\n", static_cast<long>(fit.inputs),
                   static_cast<long>(fit.limited)) +
            likelihood_text(fit);
  return text + replay_table(result);
}

}  // namespace tiller::tools::imitate
