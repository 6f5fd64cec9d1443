#include "tools/identify/laboratory.hpp"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <nlohmann/json.hpp>

#include "effects/effect_info.hpp"
#include "tools/base/python_worker.hpp"
#include "tools/base/report.hpp"
#include "tools/identify/span_rollouts.hpp"
#include "tools/robot/prior_json.hpp"

namespace tiller::tools {
namespace {

using nlohmann::json;

// ---- processes ----------------------------------------------------------------------------------------

using Worker = std::unique_ptr<PythonWorker>;

/// Processes without a fit.
struct Idle {
  std::mutex mutex;
  std::vector<Worker> workers;
};
Idle& idle() {
  static Idle one;
  return one;
}

Worker take_worker(std::string& error) {
  if (!laboratory_is_ready(error)) return nullptr;
  {
    const std::lock_guard<std::mutex> lock(idle().mutex);
    if (!idle().workers.empty()) {
      Worker worker = std::move(idle().workers.back());
      idle().workers.pop_back();
      return worker;
    }
  }
  return PythonWorker::start("laboratory", {"--methods"}, error);
}

void give_back(Worker worker) {
  const std::lock_guard<std::mutex> lock(idle().mutex);
  idle().workers.push_back(std::move(worker));
}

// ---- what is told -------------------------------------------------------------------------------------

bool send_block(PythonWorker& to, const void* data, std::uint64_t size) {
  return to.send(&size, sizeof size) && to.send(data, size);
}

json options_json(const MethodOptions& how, double period_s) {
  json scale;
  if (how.scale) scale = *how.scale;
  return {{"simulations", how.simulations},
          {"iterations", how.iterations},
          {"kl", std::isnan(how.kl) ? 1.0 : how.kl},
          {"eta", how.eta},
          {"epsilon", how.epsilon},
          {"accept", how.accept},
          {"discrepancy", how.discrepancy},
          {"smoothing_steps", how.smoothing_s / period_s},
          {"weight_l1", how.weight_l1},
          {"weight_l2", how.weight_l2},
          {"scale", scale}};
}

std::string problem_json(const std::string& method, const MethodProblem& problem) {
  const tiller_config_t& c = *problem.config;
  std::vector<bool> angle;
  for (std::uint32_t r = 0; r < c.model->state_count; ++r) angle.push_back((c.model->angle_mask >> r) & 1u);
  const json out = {{"method", method},
                    {"seed", c.seed},
                    {"period_s", c.period_s},
                    {"angle", angle},
                    {"input_count", c.model->input_count},
                    {"process_sd", std::vector<double>(c.process_sd, c.process_sd + c.model->state_count)},
                    {"parameters", parameters_json(c, problem.params)},
                    {"prior_mixture", mixture_json(c.prior_mixture)},
                    {"options", options_json(problem.options, c.period_s)}};
  return out.dump(-1, ' ', false, json::error_handler_t::replace);
}

// ---- what is answered ---------------------------------------------------------------------------------

double number_or_nan(const json& value) { return value.is_null() ? std::nan("") : value.get<double>(); }

MethodIteration iteration_of(const json& from) {
  MethodIteration out;
  out.mean = from.at("mean").get<std::vector<double>>();
  out.sd = from.at("sd").get<std::vector<double>>();
  out.temperature = number_or_nan(from.at("temperature"));
  out.kl = number_or_nan(from.at("kl"));
  out.effective_samples = from.at("effective_samples").get<double>();
  out.discrepancy = number_or_nan(from.at("discrepancy"));
  out.best = number_or_nan(from.at("smallest_discrepancy"));
  return out;
}

/// All but the draws.
void take_result(const std::string& text, MethodResult& out) {
  const json found = json::parse(text);
  for (const json& iteration : found.at("iterations")) out.history.push_back(iteration_of(iteration));
  out.effective_samples = found.at("effective_samples").get<double>();
  out.simulations = found.at("simulations").get<std::uint64_t>();
  out.diverged = found.at("diverged").get<std::uint64_t>();
  out.gaussian = !found.at("mean").is_null();
  if (!out.gaussian) return;
  out.mean = found.at("mean").get<std::vector<double>>();
  out.covariance = found.at("covariance").get<std::vector<double>>();
}

/// (count x (np + 1)): parameters and weight.
bool take_draws(const std::vector<double>& rows, std::size_t np, MethodResult& out) {
  for (std::size_t at = 0; at + np < rows.size(); at += np + 1) {
    out.params.insert(out.params.end(), rows.begin() + static_cast<std::ptrdiff_t>(at),
                      rows.begin() + static_cast<std::ptrdiff_t>(at + np));
    out.weight.push_back(rows[at + np]);
  }
  return true;
}

/// A fit as the laboratory asks for it: simulations, then the result or why there is none.
class Conversation {
 public:
  Conversation(PythonWorker& worker, const MethodProblem& problem, SpanRollouts& rollouts)
      : worker_(worker), problem_(problem), rollouts_(rollouts) {}

  /// False with a sentence in `error`. `alive`: the process can be asked again.
  bool hold(MethodResult& result, std::string& error, bool& alive) {
    for (char kind = 0; (alive = alive && next(kind));) {
      if (kind == 's') alive = simulate();
      if (kind == 'r') take_result({bytes_.begin(), bytes_.end()}, result);
      if (kind == 'd') return take_draws(numbers(), problem_.config->param_count, result);
      if (kind == 'e') return error.assign(bytes_.begin(), bytes_.end()), false;
    }
    error = "the laboratory ended without an answer; what it printed stands above";
    return false;
  }

 private:
  bool next(char& kind) {
    std::uint64_t size = 0;
    if (!worker_.receive(&kind, 1) || !worker_.receive(&size, sizeof size)) return false;
    bytes_.resize(size);
    return worker_.receive(bytes_.data(), size);
  }
  std::vector<double> numbers() const {
    std::vector<double> all(bytes_.size() / sizeof(double));
    std::copy_n(bytes_.data(), all.size() * sizeof(double), reinterpret_cast<char*>(all.data()));
    return all;
  }
  bool simulate() {
    const std::vector<double> params = numbers();
    const std::size_t count = params.size() / problem_.config->param_count;
    const std::vector<double>& states = rollouts_.run(params.data(), count);
    done_ += count;
    if (problem_.options.progress)
      problem_.options.progress(std::min(1.0, static_cast<double>(done_) / problem_.options.simulations));
    return worker_.send(states.data(), states.size() * sizeof(double));
  }

  PythonWorker& worker_;
  const MethodProblem& problem_;
  SpanRollouts& rollouts_;
  std::vector<char> bytes_;
  std::size_t done_ = 0;
};

// ---- what cannot be asked -----------------------------------------------------------------------------

std::size_t rollout_steps(const std::string& method, const MethodProblem& problem) {
  if (method != "trajectory_simopt") return 1;
  const double steps = std::round(problem.options.rollout_s / problem.config->period_s);
  return problem.options.rollout_s > 0 ? static_cast<std::size_t>(std::max(1.0, steps)) : 0;
}

bool refuse(const std::string& method, const MethodProblem& problem, std::string& error) {
  if (method.find("abc") != std::string::npos && !every_state_measured(*problem.config))
    error = "ABC simulates changes from measured states, and not every state has a sensor; use posterior or simopt";
  else if (method != "trajectory_simopt")
    (void)refuse_hidden_states(*problem.config, error);
  return !error.empty();
}

}  // namespace

bool laboratory_is_ready(std::string& error) {
  static const std::string why = [] {
    std::string problem;
    return run_python_tool("laboratory", {"--check"}, problem) ? std::string() : problem;
  }();
  if (!why.empty()) error = why;
  return why.empty();
}

bool refuse_hidden_states(const tiller_config_t& config, std::string& error) {
  for (std::uint32_t e = 0; e < config.effect_count; ++e) {
    const EffectInfo& info = effect_info(config.effects[e].kind);
    if (info.state_count == 0) continue;
    error = std::string("the effect ") + info.name +
            " has a state that no log shows, so a single step cannot be simulated; use posterior or trajectory_simopt";
    return true;
  }
  return false;
}

bool run_in_laboratory(const std::string& method, const MethodProblem& problem, MethodResult& result,
                       std::string& error) {
  result = {};
  error.clear();
  std::vector<Episode> episodes;
  if (refuse(method, problem, error) || !make_episodes(problem, episodes, error)) return false;
  SpanRollouts rollouts(*problem.config, episodes, rollout_steps(method, problem));
  const std::string text = problem_json(method, problem);
  const std::vector<double> table = rollouts.table();
  Worker worker = take_worker(error);
  if (!worker) return false;
  bool alive =
      send_block(*worker, text.data(), text.size()) && send_block(*worker, table.data(), table.size() * sizeof(double));
  const bool good = Conversation(*worker, problem, rollouts).hold(result, error, alive);
  if (alive) give_back(std::move(worker));
  result.transitions = rollouts.known_rows();
  return good;
}

}  // namespace tiller::tools
