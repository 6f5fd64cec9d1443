#include "tools/tune/tune_episode.hpp"

#include <cmath>
#include <limits>
#include <memory>

#include "tools/links/link.hpp"
#include "tools/links/model_plant.hpp"
#include "tools/robot/stage_cost.hpp"
#include "tools/robot/task_clock.hpp"
#include "tools/run/host_controller.hpp"

namespace tiller::tools::tune {
namespace {

/// The plant and, after it, what links to it.
struct Opened {
  std::unique_ptr<SimPlant> ode;
  std::unique_ptr<ModelPlant> model;
  std::unique_ptr<Link> link;
};

bool open_plant(const RobotFile& robot, Opened& opened, std::string& error) {
  if (robot.sim.plant == "model") {
    opened.model = ModelPlant::make(robot, error);
    if (opened.model) opened.link = make_model_link(robot, *opened.model);
  } else {
    opened.ode = make_sim_plant(robot, error);
    if (opened.ode) opened.link = make_sim_link(robot, *opened.ode, false);
  }
  return opened.link != nullptr;
}

/// Stage costs of an episode, as the ticks of `tiller run` count them.
class Judge {
 public:
  explicit Judge(const tiller_config_t& config) : config_(config) {}

  void count(const Link& link, const tiller_info_t& info, const tiller_command_t& command) {
    double truth[TILLER_MAX_STATES], x[TILLER_MAX_STATES];
    const bool known = link.truth(truth);
    for (std::uint32_t i = 0; i < config_.model->state_count; ++i)
      x[i] = known && !std::isnan(truth[i]) ? truth[i] : info.state_mean[i];
    const std::uint64_t step = task_.step(info.ticks - 1, static_cast<tiller_state_t>(info.state)).value_or(0);
    sum_ += stage_cost(config_, step, x, command.value, info.param_mean);
    ++count_;
  }
  double mean() const { return sum_ / static_cast<double>(count_); }

 private:
  const tiller_config_t& config_;
  TaskClock task_;
  double sum_ = 0;
  std::uint64_t count_ = 0;
};

}  // namespace

RobotFile seeded(const RobotFile& robot, std::uint64_t seed) {
  RobotFile now = robot;
  now.config.seed = now.sim.seed = seed;
  now.config.planner.deadline_us = 0;
  return now;
}

Outcome play(const RobotFile& robot, const tiller_config_t& judge, double seconds,
             const volatile std::sig_atomic_t& stop) {
  Outcome outcome;
  Opened opened;
  HostController host(1);
  if (!open_plant(robot, opened, outcome.error) || !host.make(robot, robot.config, false, outcome.error))
    return outcome;
  Link& link = *opened.link;
  Judge costs(judge);
  tiller_info_t info{};
  tiller_command_t command{};
  Sensed sensed = link.wait(stop);
  const std::int64_t start_us = sensed.now_us;
  bool armed = false;
  while (stop == 0 && 1e-6 * static_cast<double>(sensed.now_us - start_us) < seconds) {
    if (!armed) armed = tiller_arm(host.get()) == tiller_status_ok;
    (void)tiller_tick(host.get(), sensed.now_us, sensed.fresh ? &sensed.measurement : nullptr, &command);
    (void)link.send(command);
    tiller_get_info(host.get(), &info);
    costs.count(link, info, command);
    (void)tiller_prepare(host.get());
    sensed = link.wait(stop);
  }
  const double cost = costs.mean();
  outcome.safe = info.state == tiller_state_safe;
  outcome.score = std::isfinite(cost) ? -cost : -std::numeric_limits<double>::infinity();
  return outcome;
}

}  // namespace tiller::tools::tune
