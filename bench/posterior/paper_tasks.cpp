#include "bench/posterior/paper_tasks.hpp"

#include <cmath>

namespace tiller::bench {
namespace {

tiller_prior_t fixed(double value) { return {tiller_prior_fixed, 0, value, 0.0, -INFINITY, INFINITY}; }
tiller_prior_t uniform(double low, double high) { return {tiller_prior_uniform, 0, 0.0, 0.0, low, high}; }

/// Uniform on [-1, 1], drawn again every `hold` ticks.
class Push {
 public:
  Push(std::uint64_t seed, std::uint32_t hold, std::uint32_t channel)
      : rng_(seed, kInputStream, channel), hold_(hold) {}
  double at(std::uint32_t tick) {
    if (tick % hold_ == 0) value_ = 2.0 * rng_.uniform() - 1.0;
    return value_;
  }

 private:
  Rng rng_;
  std::uint32_t hold_;
  double value_ = 0.0;
};

}  // namespace

Episode PaperTask::episode(double sigma, std::uint32_t ticks, std::uint64_t seed) const {
  return commands ? make_episode(task, sigma, ticks, seed, commands(seed)) : make_episode(task, sigma, ticks, seed);
}

PaperTask slide_friction() {
  constexpr std::uint32_t kEvery = 50, kHit = 2;  // ticks
  PaperTask t;
  t.task = measured_task("slide friction", *tiller_find_model("linear_axis"), {{tiller_effect_coulomb_friction, 0}},
                         {fixed(1.0), uniform(1.0, 9.0)}, {0.0065, 0.094});
  t.commands = [](std::uint64_t seed) -> CommandSource {
    return [push = Push(seed, kEvery, 0)](std::uint32_t tick, const double*, double* u) mutable {
      const double force_N = 25.0 + 10.0 * push.at(tick);
      u[0] = tick % kEvery < kHit ? (tick / kEvery % 2 == 0 ? force_N : -force_N) : 0.0;
    };
  };
  return t;
}

PaperTask push_friction() {
  constexpr double kAhead_m_s = 0.03, kAside_m_s = 0.06, kBack_per_s = 1.0;
  const double half_length_m = 0.05, radius_m = 0.01;
  PaperTask t;
  t.task = measured_task("push friction", *tiller_find_model("pusher_slider"), {},
                         {uniform(0.1, 0.9), fixed(0.038), fixed(half_length_m), fixed(0.05), fixed(radius_m)},
                         {0.0013, 0.00088, 0.017, 0.0016, 0.0016});
  set_period(t.task, 0.05);
  t.task.config.initial_state[3] = -(half_length_m + radius_m);  // the finger at the middle of the face behind
  t.commands = [](std::uint64_t seed) -> CommandSource {
    return [push = Push(seed, 8, 0)](std::uint32_t tick, const double* x, double* u) mutable {
      const double cosine = std::cos(x[2]), sine = std::sin(x[2]);
      const double aside_m = cosine * (x[4] - x[1]) - sine * (x[3] - x[0]);  // in the box's axes
      const double aside_m_s = kAside_m_s * push.at(tick) - kBack_per_s * aside_m;
      u[0] = cosine * kAhead_m_s - sine * aside_m_s;
      u[1] = sine * kAhead_m_s + cosine * aside_m_s;
    };
  };
  return t;
}

std::vector<PaperTask> paper_tasks() {
  std::vector<PaperTask> all;
  for (const AccuracyTask& task : accuracy_tasks()) all.push_back({task, {}});
  all.push_back(push_friction());
  all.push_back(slide_friction());
  return all;
}

}  // namespace tiller::bench
