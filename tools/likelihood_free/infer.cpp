#include <cmath>

#include "tools/likelihood_free/doubts.hpp"
#include "tools/likelihood_free/summary.hpp"

namespace tiller::tools {
namespace {

bool has_prior(const tiller_config_t& config) {
  for (std::uint32_t i = 0; i < config.param_count; ++i)
    if (config.priors[i].kind != tiller_prior_fixed) return true;
  return false;
}

bool check(const InferenceProblem& problem, std::string& error) {
  if (problem.pieces.empty())
    error = "the logs hold no stretch with every value measured; give a log with at least twenty rows in a row";
  else if (!has_prior(*problem.config))
    error = "every parameter is known; give one a prior";
  else if (problem.options.summary == "recurrent" && problem.options.method != "bayes_sim")
    error =
        "the summary 'recurrent' is learnt together with bayes_sim's density; choose linear or cross_correlation, or "
        "--method bayes_sim";
  return error.empty();
}

}  // namespace

const std::vector<InferenceMethod>& inference_methods() {
  static const std::vector<InferenceMethod> list = {
      {"bayes_sim", "a mixture-density network that simulations teach, in rounds around the logs",
       "Ramos, Possas, Fox, RSS 2019; Possas et al., IROS 2020: Online BayesSim",
       "as good as the network: compare with smc_abc where much depends on the width", run_bayes_sim},
      {"smc_abc", "a population whose tolerance falls, corrected by regression at the end",
       "Toni et al., J. R. Soc. Interface 2009; Beaumont et al., Biometrika 2009",
       "wider than the posterior by what the last tolerance lets in", run_smc_abc},
      {"abc", "the draws from the prior that come nearest", "Pritchard et al., Mol. Biol. Evol. 1999",
       "wider than the posterior by what the tolerance lets in", run_rejection_abc},
      {"abc_regression", "the same, corrected by local-linear regression", "Beaumont, Zhang, Balding, Genetics 2002",
       "the correction is linear within the tolerance", run_rejection_abc_adjusted}};
  return list;
}

const InferenceMethod* find_inference_method(const std::string& name) {
  for (const InferenceMethod& method : inference_methods())
    if (method.name == name) return &method;
  return nullptr;
}

bool infer(const InferenceProblem& problem, Inferred& result, std::string& error) {
  error.clear();
  if (!check(problem, error)) return false;
  return find_inference_method(problem.options.method)->run(problem, result, error) &&
         add_doubts(problem, result, error);
}

}  // namespace tiller::tools
