#include "tools/identify/identify_method.hpp"

#include <cmath>
#include <limits>

#include "core/rng.hpp"
#include "posterior/prior.hpp"
#include "tools/base/text.hpp"
#include "tools/identify/laboratory.hpp"

namespace tiller::tools {
namespace {

constexpr std::uint32_t kSamples = 512;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

std::vector<double> prior_rows(const tiller_config_t& config) {
  const PriorDistribution law(config);
  std::vector<double> rows, v(law.dimension());
  for (std::uint32_t k = 0; k < kSamples; ++k) {
    Rng rng(config.seed, kRngPrior, k);
    law.draw_one(rng, v.data());
    std::size_t j = 0;
    for (std::uint32_t i = 0; i < config.param_count; ++i)
      rows.push_back(config.priors[i].kind == tiller_prior_fixed ? config.priors[i].a
                                                                 : from_coordinate(config.priors[i], v[j++]));
  }
  return rows;
}

void summarise(const Candidate& candidate, const MethodResult& found, Fit& result) {
  const std::size_t np = candidate.config.param_count;
  result.sample_count = kSamples;
  result.samples = resample(found.params, found.weight, np);
  result.prior_samples = prior_rows(candidate.config);
  const std::vector<double> equal(kSamples, 1.0 / kSamples);
  MethodIteration prior, posterior;
  weighted_moments(result.prior_samples, equal, np, prior);
  weighted_moments(found.params, found.weight, np, posterior);
  result.params.resize(np);
  for (std::size_t i = 0; i < np; ++i) {
    ParamSummary& p = result.params[i];
    p.name = candidate.params[i];
    p.fixed = candidate.config.priors[i].kind == tiller_prior_fixed;
    p.prior_mean = prior.mean[i], p.prior_sd = prior.sd[i];
    p.prior_low = weighted_quantile(result.prior_samples, equal, np, i, 0.05);
    p.prior_high = weighted_quantile(result.prior_samples, equal, np, i, 0.95);
    p.mean = posterior.mean[i], p.sd = posterior.sd[i];
    p.low = weighted_quantile(found.params, found.weight, np, i, 0.05);
    p.median = weighted_quantile(found.params, found.weight, np, i, 0.5);
    p.high = weighted_quantile(found.params, found.weight, np, i, 0.95);
  }
  result.covariance.assign(np * np, 0.0);
  for (std::size_t s = 0; s < found.count(); ++s)
    for (std::size_t i = 0; i < np; ++i)
      for (std::size_t j = 0; j < np; ++j)
        result.covariance[i * np + j] += found.weight[s] * (found.params[s * np + i] - posterior.mean[i]) *
                                         (found.params[s * np + j] - posterior.mean[j]);
}

// Below this many, the moments of weighted draws have errors of a tenth of a deviation and more (1 / sqrt(n)).
constexpr double kFewSamples = 100;

}  // namespace

std::vector<double> resample(const std::vector<double>& params, const std::vector<double>& weight, std::size_t np) {
  std::vector<double> rows;
  double below = 0;
  std::size_t s = 0;
  for (std::uint32_t k = 0; k < kSamples; ++k) {
    const double at = (k + 0.5) / kSamples;
    while (s + 1 < weight.size() && below + weight[s] < at) below += weight[s++];
    rows.insert(rows.end(), params.begin() + static_cast<std::ptrdiff_t>(s * np),
                params.begin() + static_cast<std::ptrdiff_t>((s + 1) * np));
  }
  return rows;
}

std::string few_draws(const std::string& method, double effective_samples, std::uint64_t simulations) {
  if (method != "reps" || effective_samples >= kFewSamples) return "";
  return format("\n  the weight lies on %.1f of %llu draws: raise --simulations, --eta or --kl, or narrow the priors",
                effective_samples, static_cast<unsigned long long>(simulations));
}

bool fit_by_method(const Candidate& candidate, const std::vector<Stretch>& stretches, const std::vector<Grid>& grids,
                   const FitOptions& options, Fit& result, std::string& error) {
  if (!find_method(options.method)) {
    error = "there is no method '" + options.method + "'; known are " + method_names();
    return false;
  }
  if (options.method == "posterior" || !candidate.learns()) return fit(candidate, stretches, options, result, error);
  if (!can_be_fitted(candidate.config, error)) return false;
  MethodProblem problem;
  problem.config = &candidate.config;
  problem.params = candidate.params;
  problem.grids = &grids;
  problem.options = options.how;
  problem.options.progress = options.progress;
  MethodResult found;
  if (!run_in_laboratory(options.method, problem, found, error)) {
    error = candidate.name + ", " + options.method + ": " + error;
    return false;
  }
  result = {};
  summarise(candidate, found, result);
  result.method = options.method;
  result.iterations = found.history;
  result.simulations = found.simulations;
  result.diverged = found.diverged;
  result.transitions = found.transitions;
  result.particles = static_cast<std::uint32_t>(found.count());
  result.effective_samples = found.effective_samples;
  result.noise_scale = result.exponent = kNaN;
  return true;
}

std::string method_text(const Fit& fit) {
  const Method& method = *find_method(fit.method);
  if (fit.method == "posterior") return "";
  const MethodIteration& last = fit.iterations.back();
  std::string text = format("  by %s: %llu simulations", method.name, static_cast<unsigned long long>(fit.simulations));
  if (fit.diverged > 0) text += format(", %llu of them diverged", static_cast<unsigned long long>(fit.diverged));
  if (fit.iterations.size() > 1) text += format(", %zu iterations", fit.iterations.size());
  if (fit.method == "reps")
    text += format("; temperature %.3g, divergence %.3g, mean log likelihood %.6g", last.temperature, last.kl,
                   -last.discrepancy);
  else if (std::isfinite(last.temperature))
    text +=
        format("; temperature %.3g, divergence %.3g, discrepancy %.3g", last.temperature, last.kl, last.discrepancy);
  else
    text += format("; tolerance %.3g", last.discrepancy);
  text += few_draws(fit.method, fit.effective_samples, fit.simulations);
  return text + "\n  mind: " + method.caveat +
         "\n  it knows of no noise scale and of no exponent; see docs/theory/methods.md\n";
}

}  // namespace tiller::tools
