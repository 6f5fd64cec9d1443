#include "tools/gap/residual/residual_writer.hpp"

#include <cmath>

#include "posterior/prior.hpp"
#include "tools/base/text.hpp"
#include "tools/base/toml.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools::gap {
namespace {

/// Of the rollouts' errors with the effect to those without: what is no better there is not offered.
constexpr double kMostRatio = 0.95;

/// Byte of a position that toml++ gives; what stands before it in the line is ASCII in [noise].
std::size_t byte_of(const std::string& text, const toml::source_position& at) {
  std::size_t line = 0;
  for (std::size_t k = 1; k < at.line; ++k) line = text.find('\n', line) + 1;
  return line + at.column - 1;
}

}  // namespace

std::string with_process_sd(std::string text, const RobotFile& robot, const double* process_sd) {
  std::string table = "{ ";
  for (std::uint32_t i = 0; i < robot.config.model->state_count; ++i) {
    const double sd = std::max(process_sd[i], robot.config.process_sd[i]);
    if (sd > 0.0) table += (table.size() > 2 ? ", " : "") + robot.names.states[i] + " = " + format("%.4g", sd);
  }
  table += " }";
  const toml::table root = toml::parse(text);
  const toml::node* old = root["noise"]["process_sd"].node();
  if (table.size() <= 4) return text;
  if (old) {
    const std::size_t from = byte_of(text, old->source().begin), to = byte_of(text, old->source().end);
    return text.replace(from, to - from, table);
  }
  if (const toml::node* noise = root["noise"].node()) {
    const std::size_t end = text.find('\n', byte_of(text, noise->source().begin));
    return text.insert(end == std::string::npos ? text.size() : end + 1, "process_sd = " + table + "\n");
  }
  return text + "\n[noise]\nprocess_sd = " + table + "\n";
}

bool offer_residual(const std::string& text, const std::string& path, const std::vector<Grid>& grids, double least_nats,
                    ResidualOffer& offer, std::string& error, const ResidualSearch& search) {
  const auto robot = parse_robot_file(text, path, error);
  if (!robot) return false;
  std::vector<double> params;
  for (std::uint32_t i = 0; i < robot->config.param_count; ++i) {
    const tiller_prior_t& prior = robot->config.priors[i];
    params.push_back(prior.kind == tiller_prior_uniform ? 0.5 * (prior.low + prior.high) : prior.a);
  }
  bool found = false;
  std::string why;
  std::vector<std::uint32_t> joints = search.joints;
  for (std::uint32_t j = 0; search.joints.empty() && j < robot->config.model->joint_count; ++j) joints.push_back(j);
  for (const std::uint32_t joint : joints) {
    if (search.stop != nullptr && *search.stop != 0) break;
    if (search.begins) search.begins(joint);
    ResidualFit fit;
    if (!fit_residual(robot->config, grids, params.data(), joint, fit, why)) continue;
    if (!found || fit.log_evidence > offer.fit.log_evidence) offer.fit = fit;
    found = true;
  }
  if (!found && why.empty()) why = "residual: stopped before the first joint was fitted";
  if (!found || !(offer.fit.evidence_nats >= least_nats)) {
    error = found ? format("residual: the logs speak for it by %.1f nats only", offer.fit.evidence_nats) : why;
    return false;
  }
  if (!(offer.fit.rollout_ratio < kMostRatio)) {
    error =
        format("residual: rollouts of one second would be %.2f times as wrong as without it", offer.fit.rollout_ratio);
    return false;
  }
  offer.text = with_process_sd(text, *robot, offer.fit.config.process_sd);
  if (offer.text.back() != '\n') offer.text += '\n';
  offer.text +=
      format(
          "\n# No known effect explains the rest: a force learnt over position and velocity, %.0f nats better "
          "than without it.\n",
          offer.fit.evidence_nats) +
      residual_toml(offer.fit);
  const auto read = parse_robot_file(offer.text, path, error);
  if (!read) return false;
  offer.posterior = residual_posterior(offer.fit, read->names.params, read->name);
  Words problems;
  if (take_prior(offer.posterior, path, *read, problems)) return true;
  error = join(problems, "\n");
  return false;
}

}  // namespace tiller::tools::gap
