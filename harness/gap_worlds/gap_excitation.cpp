#include <algorithm>
#include <cmath>

#include "harness/gap_worlds/gap_setup.hpp"

namespace tiller::bench {
namespace {

constexpr double kTwoPi = 6.283185307179586;
// of the typical excursion: a pendulum that goes over once, and comes to rest somewhere
constexpr double kMostReach = 2.2;

/// A sum of sines of unit RMS, frequencies even in the logarithm.
class Multisine {
 public:
  Multisine(Draws& draws, double slow_hz, double fast_hz) {
    constexpr std::size_t kSines = 6;
    double power = 0;
    for (std::size_t i = 0; i < kSines; ++i) {
      // one sine in each part of the band, so that no draw leaves a part of it empty
      const double part = (static_cast<double>(i) + draws.uniform()) / kSines;
      const double hz = slow_hz * std::pow(fast_hz / slow_hz, part);
      const double size = draws.between(0.5, 1.5);
      sines_.push_back({kTwoPi * hz, draws.between(0, kTwoPi), size});
      power += 0.5 * size * size;
    }
    for (Sine& s : sines_) s.size /= std::sqrt(power);
  }
  double at(double t) const {
    double sum = 0;
    for (const Sine& s : sines_) sum += s.size * std::sin(s.rate * t + s.phase);
    return sum;
  }

 private:
  struct Sine {
    double rate, phase, size;
  };
  std::vector<Sine> sines_;
};

/// Levels held for half a second to one and a half.
std::vector<double> steps(Draws& draws, std::size_t rows) {
  std::vector<double> out;
  while (out.size() < rows) {
    const double level = draws.between(-1, 1);
    const auto length = static_cast<std::size_t>(draws.between(0.5, 1.5) / kWorldPeriod);
    out.insert(out.end(), std::min(length, rows - out.size()), level);
  }
  return out;
}

/// Takes from a force what would leave a free mass moving, and away from its start, after the run.
void balance(std::vector<double>& force) {
  const auto n = static_cast<double>(force.size());
  double sum = 0, moment = 0;
  for (std::size_t k = 0; k < force.size(); ++k) {
    const double from_middle = static_cast<double>(k) - 0.5 * (n - 1);
    sum += force[k];
    moment += force[k] * from_middle;
  }
  const double slope = moment / (n * (n * n - 1) / 12), mean = sum / n;
  for (std::size_t k = 0; k < force.size(); ++k) force[k] -= mean + slope * (static_cast<double>(k) - 0.5 * (n - 1));
}

class OpenLoop final : public Commander {
 public:
  OpenLoop(const Setup& setup, const std::vector<double>& amplitude, const std::string& name, std::size_t rows) {
    for (std::size_t i = 0; i < amplitude.size(); ++i) {
      Draws draws(setup.world.seed, "open_loop." + name + "." + std::to_string(i));
      const double sines = draws.between(0.4, 1.0), size = amplitude[i] * draws.between(0.75, 1.25);
      const Multisine sum(draws, setup.plant->slow_hz, setup.plant->fast_hz);
      std::vector<double> force = steps(draws, rows);
      for (std::size_t k = 0; k < rows; ++k) {
        force[k] = size * (sines * sum.at(kWorldPeriod * static_cast<double>(k)) + (1.3 - sines) * force[k]);
      }
      if (setup.plant->drifts) balance(force);
      force_.push_back(force);
    }
  }
  void next(std::size_t row, const double*, double* command) override {
    for (std::size_t i = 0; i < force_.size(); ++i) command[i] = force_[i][row];
  }

 private:
  std::vector<std::vector<double>> force_;
};

/// A PD controller on the joints with motors. It knows the inertia alone, and takes rates as filtered differences.
class PdTracking final : public Commander {
 public:
  PdTracking(const Setup& setup, const std::vector<double>& amplitude, const std::string& name)
      : setup_(setup), amplitude_(amplitude) {
    for (std::size_t i = 0; i < amplitude.size(); ++i) {
      Draws draws(setup.world.seed, "pd_tracking." + name + "." + std::to_string(i));
      size_.push_back(setup.plant->pd_share * setup.plant->excursion[setup.plant->motors[i].state] *
                      draws.between(0.6, 1.2));
      sum_.emplace_back(draws, 0.1, 1.2);
    }
    rate_.assign(amplitude.size(), 0.0);
    last_.assign(amplitude.size(), 0.0);
  }
  void next(std::size_t row, const double* measured, double* command) override {
    const double t = kWorldPeriod * static_cast<double>(row), ramp = std::min(t, 1.0);
    for (std::size_t i = 0; i < sum_.size(); ++i) {
      const WorldPlant::Motor& motor = setup_.plant->motors[i];
      const double here = measured[motor.state];
      if (row > 0) rate_[i] += 0.3 * ((here - last_[i]) / kWorldPeriod - rate_[i]);
      last_[i] = here;
      const auto wanted = [&](double s) { return ramp * size_[i] * sum_[i].at(s); };
      const double rate = (wanted(t + 1e-3) - wanted(t - 1e-3)) / 2e-3, w = kTwoPi * motor.natural_hz;
      const double error = setup_.plant->rest[motor.state] + wanted(t) - here;
      const double most = 4 * amplitude_[i];
      command[i] = std::clamp(setup_.inertia[i] * (w * w * error + 1.4 * w * (rate - rate_[i])), -most, most);
    }
  }

 private:
  const Setup& setup_;
  std::vector<double> amplitude_, size_, rate_, last_;
  std::vector<Multisine> sum_;
};

}  // namespace

const char* excitation_name(Excitation excitation) {
  static constexpr const char* kNames[] = {"open_loop", "pd_tracking", "planner"};
  return kNames[static_cast<int>(excitation)];
}

bool find_excitation(const std::string& name, Excitation& excitation) {
  for (const Excitation e : {Excitation::open_loop, Excitation::pd_tracking, Excitation::planner}) {
    if (name != excitation_name(e)) continue;
    excitation = e;
    return true;
  }
  return false;
}

std::unique_ptr<Commander> make_planner(const Setup& setup, const std::vector<double>& amplitude,
                                        const std::string& name, std::string& error);

std::unique_ptr<Commander> make_commander(const Setup& setup, const std::vector<double>& amplitude,
                                          const std::string& name, std::size_t rows, std::string& error) {
  switch (setup.world.excitation) {
    case Excitation::open_loop: return std::make_unique<OpenLoop>(setup, amplitude, name, rows);
    case Excitation::pd_tracking: return std::make_unique<PdTracking>(setup, amplitude, name);
    case Excitation::planner: return make_planner(setup, amplitude, name, error);
  }
  return nullptr;
}

namespace {

/// How far a run goes, in the plant's typical excursions.
double reach(const Setup& setup, const std::vector<double>& amplitude, const std::string& name, double seconds) {
  Series series;
  std::string error;
  if (!record(setup, amplitude, name, seconds, series, error)) return 0;
  double most = 0;
  for (std::size_t i = 0; i < setup.plant->excursion.size(); ++i) {
    for (const double q : series.truth[i])
      most = std::max(most, std::fabs(q - setup.plant->rest[i]) / setup.plant->excursion[i]);
  }
  return most;
}

/// Only the commands' size is sought: open loop, coarse steps.
Setup rehearsal(const Setup& setup) {
  Setup trial = setup;
  trial.world.excitation = Excitation::open_loop;
  trial.options.step_s = 0.001;
  return trial;
}

void scale(std::vector<double>& amplitude, double factor) {
  for (double& a : amplitude) a *= factor;
}

}  // namespace

std::vector<double> calibrate(const Setup& setup) {
  Setup plain = rehearsal(setup);
  plain.world.effects.clear();
  plain.options.effects.clear();
  std::vector<double> amplitude = setup.inertia;
  scale(amplitude, 0.3 * kTwoPi * kTwoPi * setup.plant->slow_hz * setup.plant->fast_hz);
  for (int round = 0; round < 6; ++round) {
    const double factor = std::clamp(1 / reach(plain, amplitude, "calibration", 8.0), 0.6, 2.0);
    scale(amplitude, factor);
    if (std::fabs(factor - 1) < 0.1) break;
  }
  return amplitude;
}

std::vector<double> fit_amplitude(const Setup& setup, std::vector<double> amplitude, const std::string& name) {
  if (setup.world.excitation != Excitation::open_loop) return amplitude;
  const Setup trial = rehearsal(setup);
  const double wanted = Draws(setup.world.seed, "reach." + name).between(0.5, 1.4);
  double whole = 1;
  for (int round = 0; round < 10; ++round) {
    const double is = reach(trial, amplitude, name, 8.0);
    // near enough, or a motion that will not be tuned finer; one that whirls without end is not left so
    if (std::fabs(std::log(std::max(is, 1e-9) / wanted)) < 0.15 || (round >= 2 && is < kMostReach)) break;
    const double next = std::clamp(whole * std::clamp(wanted / std::max(is, 1e-9), 0.65, 1.6), 0.1, 3.0);
    scale(amplitude, next / whole);
    whole = next;
  }
  return amplitude;
}

}  // namespace tiller::bench
