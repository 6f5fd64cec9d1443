#include <cmath>

#include "tools/base/text.hpp"
#include "tools/imitate/imitate.hpp"

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
    const std::string interval = std::isfinite(w.low) && w.varies ? format("%.4g .. %.4g", w.low, w.high) : "-";
    text += format("  %-36s %12.5g %12.5g %25s  %s\n", w.term.key.c_str(), w.term.value, w.value, interval.c_str(),
                   judgement(w).c_str());
  }
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
    text += format("%s and %s: the demonstrations tell their ratio to each other, not their size\n",
                   fit.weights[a].term.key.c_str(), fit.weights[b].term.key.c_str());
  return text;
}

}  // namespace

std::string imitate_text(const RobotFile& robot, const ImitateOptions& options, const Imitated& result) {
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
