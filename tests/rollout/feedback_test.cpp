// Rollouts under feedback against open-loop rollouts of the inputs that the law gives, which the test works out from
// the motion itself.

#include <gtest/gtest.h>

#include <limits>

#include "batch.hpp"

namespace tiller {
namespace {

constexpr std::uint32_t kSteps = 12, kLanes = 80, kFrom = 2;

/// A batch with a law of random gains around random references, and limits that some inputs meet.
template <class T>
struct ClosedBatch : Batch<T> {
  std::vector<T> gain, reference, low, high, change, previous;
  RolloutFeedback<T> law;

  ClosedBatch(const tiller_config_t& config, bool rate) : Batch<T>(config, kLanes, kSteps) {
    Rng rng(7, 99, 0);
    const auto fill = [&](std::vector<T>& v, std::size_t n, double most) {
      v.resize(n);
      for (T& x : v) x = static_cast<T>(most * (2.0 * rng.uniform() - 1.0));
    };
    law.from = kFrom;
    law.columns = this->nx + (rate ? this->nu : 0);
    fill(gain, std::size_t{kSteps} * this->nu * law.columns, 0.8);
    fill(reference, std::size_t{kSteps} * this->nx * kLanes, 1.0);
    fill(previous, this->nu, 1.0);
    low.assign(this->nu, T(-2.5));
    high.assign(this->nu, T(2.0));
    change.assign(this->nu, T(3.0));
    law.gain = gain.data();
    law.reference = {reference.data(), kLanes};
    law.low = low.data();
    law.high = high.data();
    law.most_change = change.data();
    this->job.feedback = &law;
    this->job.previous_input = previous.data();
  }

  /// The law's inputs along the motion that stands in `trajectory`; counts those that were cut.
  std::vector<T> inputs(int& cut) const {
    std::vector<T> u = this->controls;
    for (std::uint32_t k = kFrom; k < kSteps; ++k)
      for (std::uint32_t l = 0; l < kLanes; ++l)
        for (std::uint32_t i = 0; i < this->nu; ++i) {
          const auto at = [&](const std::vector<T>& rows, std::uint32_t row) { return double(rows[row * kLanes + l]); };
          double wish = at(this->controls, k * this->nu + i);
          const T* row = &gain[(std::size_t{k} * this->nu + i) * law.columns];
          for (std::uint32_t c = 0; c < this->nx; ++c)
            wish += double(row[c]) * (at(this->trajectory, k * this->nx + c) - at(reference, k * this->nx + c));
          for (std::uint32_t c = this->nx; c < law.columns; ++c) {
            const std::uint32_t before = (k - 1) * this->nu + c - this->nx;
            wish += double(row[c]) * (at(u, before) - at(this->controls, before));
          }
          const double last = at(u, (k - 1) * this->nu + i);
          const double lowest = std::max(double(low[i]), last - double(change[i]));
          const double highest = std::min(double(high[i]), last + double(change[i]));
          cut += wish < lowest || wish > highest;
          u[(k * this->nu + i) * kLanes + l] = static_cast<T>(std::min(std::max(wish, lowest), highest));
        }
    return u;
  }
};

template <class T>
double largest_difference(const std::vector<T>& a, const std::vector<T>& b) {
  double d = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (!std::isfinite(a[i]) || !std::isfinite(b[i])) return INFINITY;
    d = std::max(d, std::abs(double(a[i]) - double(b[i])) / (1.0 + std::abs(double(b[i]))));
  }
  return d;
}

/// Random numbers are no motion: the hopper touches ground where rounding decides, and is left in the air.
tiller::Config config_of(const tiller_model_t& m, bool effects) {
  tiller::Config config = plain_config(&m);
  let_float(config);
  if (effects) {
    add_some_effect(config);
    add_effect_if_it_fits(config, tiller_effect_actuator_lag, 0);
  }
  return config;
}

class EveryModel : public ::testing::TestWithParam<const tiller_model_t*> {};
INSTANTIATE_TEST_SUITE_P(Models, EveryModel, ::testing::ValuesIn(all_models()),
                         [](const auto& model) { return std::string(model.param->name); });

template <class T>
void follows_the_law(const tiller_model_t& m, const RolloutTable& table, bool effects, bool rate, double tolerance) {
  const tiller::Config config = config_of(m, effects);
  ClosedBatch<T> closed(config, rate);
  std::vector<T> shared(TILLER_MAX_PARAMS, T(0.8));
  if (!effects) closed.job.params = {shared.data(), 0};
  closed.run(m, table);
  int cut = 0;
  const std::vector<T> u = closed.inputs(cut);
  // some inputs meet a limit, most do not: both branches are looked at
  const int all = static_cast<int>((kSteps - kFrom) * kLanes * closed.nu);
  EXPECT_GT(cut, all / 50);
  EXPECT_LT(cut, all * 49 / 50);
  Batch<T> open(config, kLanes, kSteps);
  if (!effects) open.job.params = {shared.data(), 0};
  open.controls = u;
  open.job.previous_input = closed.previous.data();
  open.run(m, table);
  EXPECT_LT(largest_difference(closed.trajectory, open.trajectory), tolerance) << isa_name(table.isa);
  EXPECT_LT(largest_difference(closed.cost, open.cost), tolerance) << isa_name(table.isa);
}

TEST_P(EveryModel, TheInputIsWhatTheLawSays) {
  const tiller_model_t& m = *GetParam();
  const tiller_model_t plain = as_c_model(m);
  for (bool effects : {false, true})
    for (bool rate : {false, true}) {
      // 12 steps of rounding, amplified by the dynamics and the gains by less than 1e4
      for (Isa isa : all_isas()) {
        follows_the_law<double>(m, select_rollout(m, isa), effects, rate, 1e-11);
        follows_the_law<float>(m, select_rollout(m, isa), effects, rate, 2e-3);
      }
      follows_the_law<double>(plain, select_rollout(plain), effects, rate, 1e-11);
    }
}

TEST_P(EveryModel, AGainOfZeroIsTheOpenLoopToTheBit) {
  const tiller_model_t& m = *GetParam();
  const tiller::Config config = config_of(m, false);
  ClosedBatch<float> closed(config, false);
  closed.gain.assign(closed.gain.size(), 0.0f);
  closed.low.assign(closed.nu, -1e15f);
  closed.high.assign(closed.nu, 1e15f);
  closed.change.assign(closed.nu, 1e15f);
  Batch<float> open(config, kLanes, kSteps);
  open.job.previous_input = closed.previous.data();
  closed.run(m, select_rollout(m));
  open.run(m, select_rollout(m));
  EXPECT_EQ(closed.cost, open.cost);
  EXPECT_EQ(closed.trajectory, open.trajectory);
}

TEST_P(EveryModel, AReferenceThatIsNotANumberLeavesNoCost) {
  const tiller_model_t& m = *GetParam();
  ClosedBatch<float> closed(config_of(m, false), false);
  closed.reference[(std::size_t{4} * closed.nx) * kLanes + 3] = std::numeric_limits<float>::quiet_NaN();
  closed.run(m, select_rollout(m));
  for (std::uint32_t l = 0; l < kLanes; ++l) EXPECT_EQ(std::isfinite(closed.cost[l]), l != 3) << l;
}

}  // namespace
}  // namespace tiller
