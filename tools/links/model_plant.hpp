#pragma once

#include <cstdint>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "rollout/rollout.hpp"
#include "tiller/config.hpp"
#include "tools/links/link.hpp"
#include "tools/links/plant_path.hpp"

namespace tiller::tools {

/// The model itself as the plant, `[sim] plant = "model"`: for models that no ODE plant stands for. True parameters
/// are those of [sim]; what it leaves out stands at its prior's centre, or is drawn with draw = true. Effects are those
/// of [sim] alone, but for servos of the robot file, without which a goal would be a force. Integrated by RK4 at ten
/// times the controller's substeps. It tries the loop, never the model: a plant with the same equations cannot
/// contradict them.
class ModelPlant {
 public:
  static std::unique_ptr<ModelPlant> make(const RobotFile& robot, std::string& error);

  void advance(const double* command);            ///< one period under a held command
  void measure(double* out);                      ///< (ny) noise, then quantisation
  const double* state() const { return state_; }  ///< (nx) the truth
  std::int64_t time_us() const { return time_us_; }
  /// By robot.names.params; NaN: no such thing.
  const std::vector<double>& true_params() const { return true_params_; }

 private:
  bool set_parameters(const RobotFile& robot, std::string& error);
  bool set_effects(const RobotFile& robot, std::string& error);
  bool set_sensors(const RobotFile& robot, std::string& error);
  double normal();

  Config config_{};  // the plant's own: hidden effects, every prior fixed
  StepSetup setup_;
  const RolloutTable* table_ = nullptr;
  double state_[TILLER_MAX_STATES] = {};
  double effect_state_[TILLER_MAX_EFFECT_STATES + 1] = {};
  std::vector<double> params_, history_, true_params_;
  PlantPath path_;
  double sensor_sd_[TILLER_MAX_MEASUREMENTS] = {}, sensor_step_[TILLER_MAX_MEASUREMENTS] = {};
  std::mt19937_64 generator_;
  std::int64_t time_us_ = 0;
  double elapsed_s_ = 0;
};

/// The plant in this process, in lockstep. The plant outlives the link.
std::unique_ptr<Link> make_model_link(const RobotFile& robot, ModelPlant& plant);

}  // namespace tiller::tools
