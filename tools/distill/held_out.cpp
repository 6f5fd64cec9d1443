#include <algorithm>
#include <cmath>

#include "core/rng.hpp"
#include "effects/effect_info.hpp"
#include "tools/distill/distill.hpp"
#include "tools/links/plant_setup.hpp"
#include "tools/tune/tune_episode.hpp"

namespace tiller::tools::distill {
namespace {

constexpr std::uint32_t kPurpose = 0x6470;

double next_uniform(void* rng) { return static_cast<Rng*>(rng)->uniform(); }

std::vector<double> draw_params(const RobotFile& robot, std::uint64_t seed) {
  std::vector<double> values;
  for (std::uint32_t p = 0; p < robot.config.param_count; ++p) {
    Rng rng(seed, kPurpose, p);
    values.push_back(draw_from_prior(robot.config.priors[p], next_uniform, &rng));
  }
  return values;
}

/// What has a prior takes the draw's value; what [sim] says of the rest stays.
void set_truth(RobotFile& robot, const std::vector<double>& values) {
  for (std::uint32_t p = 0; p < robot.model->param_count; ++p)
    if (robot.config.priors[p].kind != tiller_prior_fixed || robot.sim.line == 0)
      robot.sim.parameters[robot.params[p]] = values[p];
  std::size_t row = robot.model->param_count;
  for (std::uint32_t e = 0; e < robot.config.effect_count; ++e) {
    const tiller_effect_t& effect = robot.config.effects[e];
    const EffectInfo& info = effect_info(effect.kind);
    SimEffect drawn;
    drawn.kind = info.name;
    if (info.port != PortKind::body) drawn.port = port_name(info.port, *robot.model, effect.port);
    for (int i = 0; i < info.param_count; ++i)
      drawn.parameters[info.params[i].name] = values[row + static_cast<std::size_t>(i)];
    row += static_cast<std::size_t>(info.param_count);
    auto& all = robot.sim.effects;
    all.erase(std::remove_if(all.begin(), all.end(),
                             [&](const SimEffect& old) {
                               return old.kind == drawn.kind && (old.port == drawn.port || old.port.empty());
                             }),
              all.end());
    all.push_back(drawn);
  }
}

}  // namespace

RobotFile held_out_draw(const RobotFile& robot, std::uint64_t seed) {
  RobotFile drawn = tune::seeded(robot, seed);
  drawn.sim.draw = false;
  set_truth(drawn, draw_params(robot, seed));
  if (robot.sim.line == 0) drawn.sim.plant = "model";
  return drawn;
}

bool play_held_out(const RobotFile& teacher, const RobotFile& policy, std::uint64_t seed, double seconds,
                   const volatile std::sig_atomic_t& stop, HeldOut& result, std::string& error) {
  result.seed = seed;
  const tune::Outcome planned = tune::play(held_out_draw(teacher, seed), teacher.config, seconds, stop);
  if (!planned.error.empty()) return error = planned.error, false;
  const tune::Outcome evaluated = tune::play(held_out_draw(policy, seed), teacher.config, seconds, stop);
  if (!evaluated.error.empty()) return error = evaluated.error, false;
  result.teacher_cost = -planned.score;
  result.policy_cost = -evaluated.score;
  result.teacher_safe = planned.safe;
  result.policy_safe = evaluated.safe;
  return true;
}

double cost_ratio(const std::vector<HeldOut>& tests) {
  double policy = 0, teacher = 0;
  for (const HeldOut& test : tests) {
    policy += test.policy_cost;
    teacher += test.teacher_cost;
  }
  return policy / teacher;
}

}  // namespace tiller::tools::distill
