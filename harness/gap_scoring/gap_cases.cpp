#include "harness/gap_scoring/gap_cases.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "sim/mechanisms/noise.hpp"

namespace tiller::bench {
namespace {

constexpr Excitation kExcitations[] = {Excitation::open_loop, Excitation::pd_tracking, Excitation::planner};

bool wanted_in(const std::vector<std::string>& list, const std::string& name) {
  return list.empty() || std::find(list.begin(), list.end(), name) != list.end();
}

/// A random force, held for 1 ms each, that moves a run of 1 s off its path by about one deviation of the sensor: the
/// inertia that the plant's motor moves, about, times 3 sensor deviations per s^1.5.
double typical_process_sd(const std::string& plant, double noise_sd) {
  const double inertia = plant == "pendulum" ? 0.14 : plant == "cart_pole" ? 1.2 : plant == "two_link_arm" ? 0.2 : 2.0;
  return 3 * noise_sd * inertia / std::sqrt(1e-3);
}

/// The surroundings of the effect go by cell and seed: a third of the cases each has another excitation, a third a
/// coarse encoder (its step three sensor deviations: as much noise again), a quarter process noise.
void surround(CaseWanted& w, const std::string& cell) {
  const sim::NoiseStream draw(w.seed, "surroundings of " + cell);
  w.excitation = kExcitations[static_cast<int>(draw.uniform(0) * 3)];
  w.encoder_step = draw.uniform(1) < 1.0 / 3 ? 3 * w.noise_sd : 0.0;
  w.process_sd = draw.uniform(2) < 0.25 ? typical_process_sd(w.plant, w.noise_sd) : 0.0;
}

class Planner {
 public:
  Planner(const std::string& section, const CasePlan& plan) : section_(section), plan_(plan) {
    for (const std::string& p : world_plants())
      if (wanted_in(plan.plants, p)) plants_.push_back(p);
  }
  std::vector<GapCase> take() { return std::move(cases_); }

  void sealed() {
    each_seed(10, [&](std::uint64_t seed) {
      for (const std::string& plant : plants_)
        for (const std::string& kind : hidden_kinds(plant, true))
          for (const double noise : plan_.noises) add(plant, {kind}, noise, seed);
    });
  }
  void null() {
    each_seed(12, [&](std::uint64_t seed) {
      for (const std::string& plant : plants_)
        for (const double noise : plan_.noises)
          for (const Excitation e : kExcitations) {
            GapCase& c = add(plant, {}, noise, seed);
            c.wanted.excitation = e;
          }
    });
  }
  void two() {
    each_seed(12, [&](std::uint64_t seed) {
      for (const std::string& plant : plants_)
        for (const double noise : plan_.noises) add(plant, pair(plant, noise, seed), noise, seed).wanted.least_r = 5;
    });
  }
  void outside() {
    each_seed(4, [&](std::uint64_t seed) {
      for (const std::string& plant : plants_)
        for (const std::string& kind : hidden_kinds(plant, false)) {
          const double noise = plan_.noises[seed % plan_.noises.size()];
          add(plant, {kind}, noise, seed).wanted.least_r = 5;
        }
    });
  }

 private:
  template <class F>
  void each_seed(std::uint32_t usual, const F& f) {
    const std::uint32_t count = plan_.seeds ? plan_.seeds : usual;
    for (std::uint32_t i = 0; i < count; ++i) f(plan_.first_seed + i);
  }
  GapCase& add(const std::string& plant, const std::vector<std::string>& kinds, double noise, std::uint64_t seed) {
    GapCase c;
    c.section = section_;
    c.wanted.plant = plant;
    c.wanted.kinds = kinds;
    c.wanted.noise_sd = noise;
    c.seed = seed;
    const auto place = std::find(plan_.noises.begin(), plan_.noises.end(), noise) - plan_.noises.begin();
    c.wanted.seed = 16 * seed + static_cast<std::uint64_t>(place);
    surround(c.wanted, section_ + plant + joined(kinds));
    static GapCase left_out;
    if (!kinds.empty() && std::none_of(kinds.begin(), kinds.end(),
                                       [&](const std::string& k) { return wanted_in(plan_.kinds, kind_of(k)); }))
      return left_out = c;
    return cases_.emplace_back(c);
  }
  std::vector<std::string> pair(const std::string& plant, double noise, std::uint64_t seed) const {
    const auto kinds = hidden_kinds(plant, true);
    const sim::NoiseStream draw(seed, "pair " + plant + std::to_string(noise));
    const auto pick = [&](std::uint64_t k) {
      return kinds[std::min(kinds.size() - 1, static_cast<std::size_t>(draw.uniform(k) * double(kinds.size())))];
    };
    const std::string first = pick(0);
    for (std::uint64_t k = 1;; ++k)
      if (const std::string second = pick(k); !related(kind_of(first), kind_of(second)) || k > 1000)
        return {first, second};
  }

  std::string section_;
  const CasePlan& plan_;
  std::vector<std::string> plants_;
  std::vector<GapCase> cases_;
};

}  // namespace

std::string GapCase::id() const {
  char noise[32];
  std::snprintf(noise, sizeof noise, "%g", wanted.noise_sd);
  return section + "/" + wanted.plant + "/" + joined(wanted.kinds) + "/" + noise + "/" +
         excitation_name(wanted.excitation) + "/" + std::to_string(seed);
}

std::vector<GapCase> plan_cases(const std::string& section, const CasePlan& plan) {
  Planner planner(section, plan);
  if (section == "sealed") planner.sealed();
  if (section == "null") planner.null();
  if (section == "two") planner.two();
  if (section == "outside") planner.outside();
  return planner.take();
}

}  // namespace tiller::bench
