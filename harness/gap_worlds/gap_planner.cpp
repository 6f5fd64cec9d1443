// Commands from tiller's own planner with the nominal model, new targets every two seconds.

#include <cmath>
#include <memory>
#include <new>

#include "harness/gap_worlds/gap_setup.hpp"
#include "tiller/config.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::bench {
namespace {

constexpr std::size_t kTargetRows = 200;

struct AlignedFree {
  void operator()(void* p) const { ::operator delete (p, std::align_val_t{TILLER_ALIGNMENT}); }
};

class Planner final : public Commander {
 public:
  Planner(const Setup& setup, const std::string& name, std::unique_ptr<tools::RobotFile> robot)
      : setup_(setup), draws_(setup.world.seed, "planner." + name), robot_(std::move(robot)) {
    tiller::Config& c = robot_->config;
    c.posterior.enabled = 0;
    c.seed = static_cast<std::uint64_t>(draws_.uniform() * 0x1p52);
    c.safety.frozen_ticks = 0;
    memory_.reset(::operator new (tiller_size(&c), std::align_val_t{TILLER_ALIGNMENT}));
  }

  void next(std::size_t row, const double* measured, double* command) override {
    if (row % kTargetRows == 0) aim(row, measured);
    tiller_measurement_t m{};
    m.stamp_us = 1000000 + std::llround(1e6 * kWorldPeriod * static_cast<double>(row));
    m.sequence = static_cast<std::uint32_t>(row);
    for (std::uint32_t i = 0; i < robot_->config.measurement_count; ++i) m.value[i] = measured[i];
    tiller_command_t out{};
    if (engine_ != nullptr) tiller_tick(engine_, m.stamp_us, &m, &out);
    for (std::size_t i = 0; i < setup_.inertia.size(); ++i) command[i] = out.value[i];
  }

  bool good() const { return tiller_size(&robot_->config) > 0; }

 private:
  /// A target holds for the life of an engine, so each target has its own.
  void aim(std::size_t row, const double* measured) {
    tiller::Config& c = robot_->config;
    for (std::size_t i = 0; i < setup_.plant->motors.size(); ++i) {
      const WorldPlant::Motor& motor = setup_.plant->motors[i];
      c.cost.target[motor.state] =
          setup_.plant->rest[motor.state] + draws_.between(motor.target_low, motor.target_high);
    }
    if (row > 0) {
      for (std::size_t i = 0; i < setup_.plant->excursion.size(); ++i) {
        c.initial_state[i] = measured[i];
        c.initial_state_sd[setup_.plant->excursion.size() + i] = 2.0;
      }
    }
    if (tiller_init(&engine_, &c, nullptr, memory_.get(), tiller_size(&c)) != tiller_status_ok) engine_ = nullptr;
    if (engine_ != nullptr) tiller_arm(engine_);
  }

  const Setup& setup_;
  Draws draws_;
  std::unique_ptr<tools::RobotFile> robot_;
  std::unique_ptr<void, AlignedFree> memory_;
  tiller_t* engine_ = nullptr;
};

}  // namespace

std::unique_ptr<Commander> make_planner(const Setup& setup, const std::vector<double>& amplitude,
                                        const std::string& name, std::string& error) {
  const auto plant = sim::Plant::make(setup.options, error);
  if (!plant) return nullptr;
  auto robot = tools::parse_robot_file(robot_text(setup, *plant, amplitude), "robot.toml", error);
  if (!robot) return nullptr;
  auto planner = std::make_unique<Planner>(setup, name, std::move(robot));
  if (planner->good()) return planner;
  error = "the planner refuses the robot file";
  return nullptr;
}

}  // namespace tiller::bench
