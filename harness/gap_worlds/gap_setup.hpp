#pragma once

// The set-up between a case and its runs: the plant with its true parameters, and the robot file that an honest
// engineer has of it. Inside of gap_worlds.hpp.

#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "harness/gap_worlds/gap_worlds.hpp"
#include "sim/mechanisms/noise.hpp"
#include "sim/plant/plant.hpp"

namespace tiller::bench {

constexpr double kWorldPeriod = 0.01, kWorldStep = 0.0005;

/// One kind of plant as worlds use it.
struct WorldPlant {
  struct Parameter {
    std::string name;
    double low, high;  ///< the nominal value is drawn here, evenly in the logarithm
    bool weighed;      ///< known to +-5 % only
  };
  struct Motor {
    std::size_t state;               ///< position that it drives; its rate is half the states further
    double natural_hz;               ///< of the PD controller
    double weight;                   ///< in the planner's cost
    double target_low, target_high;  ///< of the planner
  };
  std::string kind;
  std::vector<Parameter> parameters;
  std::vector<double> rest;       ///< (nx) where runs begin
  std::vector<double> excursion;  ///< (positions) typical size of a rich motion
  std::vector<Motor> motors;      ///< (nu)
  double slow_hz, fast_hz;        ///< of the sums of sines
  double pd_share;                ///< of the excursion, RMS, that the PD controller follows
  bool drifts;                    ///< nothing brings it back: open-loop commands are made to
};
const WorldPlant* find_world_plant(const std::string& kind);

/// A case made concrete.
struct Setup {
  const WorldPlant* plant = nullptr;
  WorldCase world;
  sim::PlantOptions options;                  ///< true parameters and effects; no noise yet
  std::map<std::string, double> nominal;      ///< parameters as the engineer has them
  std::map<std::string, std::string> priors;  ///< their text in the robot file
  std::vector<double> inertia;                ///< (nu) that a motor moves, about
  double sensor_sd = 0;
};
bool make_setup(const WorldCase& world, Setup& setup, std::string& error);
std::string robot_text(const Setup& setup, const sim::Plant& plant, const std::vector<double>& amplitude);

/// Draws of a stream in turn.
class Draws {
 public:
  Draws(std::uint64_t seed, const std::string& name) : stream_(seed, name) {}
  double uniform() { return stream_.uniform(next_++); }
  double between(double low, double high) { return low + (high - low) * uniform(); }
  double log_between(double low, double high) { return low * std::pow(high / low, uniform()); }
  double normal() { return stream_.normal(next_++); }
  std::size_t index(std::size_t count) { return static_cast<std::size_t>(uniform() * static_cast<double>(count)); }

 private:
  sim::NoiseStream stream_;
  std::uint64_t next_ = 0;
};

/// Where commands come from.
class Commander {
 public:
  virtual ~Commander() = default;
  virtual void next(std::size_t row, const double* measured, double* command) = 0;
};
/// For the run `name`. Null: error says why.
std::unique_ptr<Commander> make_commander(const Setup& setup, const std::vector<double>& amplitude,
                                          const std::string& name, std::size_t rows, std::string& error);
/// Amplitudes (nu) of the open-loop commands that move the plant without effects as far as is typical.
std::vector<double> calibrate(const Setup& setup);

/// The same for one run: its first seconds are tried, effects and all, until it moves as far as is drawn for it.
std::vector<double> fit_amplitude(const Setup& setup, std::vector<double> amplitude, const std::string& name);

/// One run. The noise belongs to the run's name.
bool record(const Setup& setup, const std::vector<double>& amplitude, const std::string& name, double seconds,
            Series& series, std::string& error);
bool record(const Setup& setup, Commander& commander, const std::string& name, std::size_t rows, Series& series,
            std::string& error);
/// Squared errors per channel of 1 s rollouts of the plant without effects, and how many.
struct RolloutError {
  std::vector<double> squares;
  double count = 0;
};
void add_rollout_error(const Setup& setup, const Series& series, RolloutError& error);
double rms_r(const RolloutError& error, double sensor_sd);

}  // namespace tiller::bench
