// An imported model alone: MODEL of HEADER (-D). Compiled by robots.py; not part of the CMake build.
//
//   imported_robot values   reads rows q, v, force of n numbers each; prints accelerations and the inverse inertia
//   imported_robot slopes   the same rows; prints the slopes of the accelerations by position, then by speed
//   imported_robot speed    nanoseconds of a step (accelerations, then Euler) of one lane: f32, f64, scalar;
//                           and of the accelerations with their slopes beside the accelerations alone, f64 lanes

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <vector>

#include "rollout/model_adapter.hpp"
#include "scalar/pack.hpp"

#include HEADER

namespace {

constexpr int kJoints = sizeof(MODEL<double>::joints) / sizeof(MODEL<double>::joints[0]);

template <class S>
typename MODEL<S>::State rates(const typename MODEL<S>::State& x, const typename MODEL<S>::Force& f) {
  const tiller::Body<S> body = {S(0.0), S(-9.81), S(0.0), S(0.0)};
  return MODEL<S>::dynamics(x, {}, f, body);
}

/// False at the end of the input.
bool read_row(MODEL<double>::State& x, MODEL<double>::Force& f) {
  double row[3 * kJoints];
  for (double& v : row)
    if (std::scanf("%lf", &v) != 1) return false;
  std::memcpy(static_cast<void*>(&x), row, sizeof x);
  std::memcpy(static_cast<void*>(&f), row + 2 * kJoints, sizeof f);
  return true;
}

int values() {
  MODEL<double>::State x;
  MODEL<double>::Force f;
  while (read_row(x, f)) {
    const MODEL<double>::State dx = rates<double>(x, f);
    double all[2 * kJoints], column[kJoints][kJoints];
    std::memcpy(all, static_cast<const void*>(&dx), sizeof all);
    MODEL<double>::responses(x, {0.0, -9.81, 0.0, 0.0}, column);
    for (int j = 0; j < kJoints; ++j) std::printf("%.17g ", all[kJoints + j]);
    for (const auto& r : column)
      for (double v : r) std::printf("%.17g ", v);
    std::printf("\n");
  }
  return 0;
}

template <class S>
using Slopes = typename tiller::StaticModel<MODEL>::template JointSlopes<S>;

template <class S>
void slopes(const typename MODEL<S>::State& x, const typename MODEL<S>::Force& f, Slopes<S>& out) {
  if constexpr (tiller::StaticModel<MODEL>::kKnowsSlopes)
    tiller::StaticModel<MODEL>::slopes<S>(x, {}, f, {S(0.0), S(-9.81), S(0.0), S(0.0)}, {}, out);
}

int slope_values() {
  MODEL<double>::State x;
  MODEL<double>::Force f;
  while (read_row(x, f)) {
    Slopes<double> s;
    slopes<double>(x, f, s);
    for (int half = 0; half < 2; ++half)
      for (const auto& r : s.by_state)
        for (int c = 0; c < kJoints; ++c) std::printf("%.17g ", r[half * kJoints + c]);
    std::printf("\n");
  }
  return 0;
}

/// Nanoseconds of one register: accelerations alone, then with their slopes; medians of nine rounds.
void slope_ns(double* alone, double* both) {
  using S = tiller::TILLER_COMPILE_ISA::Pack<double>;
  constexpr int kCalls = 20000, kRounds = 9;
  typename MODEL<S>::State x;
  typename MODEL<S>::Force f;
  for (int i = 0; i < 2 * kJoints; ++i) reinterpret_cast<S*>(&x)[i] = S(0.1 * std::sin(i));
  for (int i = 0; i < kJoints; ++i) reinterpret_cast<S*>(&f)[i] = S(0.3 * i);
  std::vector<double> rounds[2];
  Slopes<S> s;
  S* first = reinterpret_cast<S*>(&x);
  for (int round = 0; round < kRounds; ++round)
    for (int which = 0; which < 2; ++which) {
      const auto begin = std::chrono::steady_clock::now();
      for (int call = 0; call < kCalls; ++call) {
        S rate;
        if (which == 0) {
          const auto dx = rates<S>(x, f);
          rate = reinterpret_cast<const S*>(&dx)[kJoints];
        } else {
          slopes<S>(x, f, s);
          rate = s.acceleration[0];
        }
        first[0] = first[0] + S(1e-12) * rate;  // so that calls wait for each other
      }
      const std::chrono::duration<double, std::nano> spent = std::chrono::steady_clock::now() - begin;
      rounds[which].push_back(spent.count() / kCalls);
    }
  for (auto& list : rounds) std::sort(list.begin(), list.end());
  *alone = rounds[0][kRounds / 2];
  *both = rounds[1][kRounds / 2];
}

/// Median of nine rounds over a batch that stays in the first-level cache.
template <class S>
double step_ns(int lanes) {
  constexpr int kBatch = 16, kSteps = 2000, kRounds = 9;
  using State = typename MODEL<S>::State;
  std::vector<State> batch(kBatch);
  const S h(1e-4);
  std::vector<double> rounds;
  for (int round = 0; round < kRounds; ++round) {
    for (int b = 0; b < kBatch; ++b) {
      S* x = reinterpret_cast<S*>(&batch[static_cast<std::size_t>(b)]);
      for (int i = 0; i < 2 * kJoints; ++i) x[i] = S(0.1 * std::sin(i + 3.0 * b));
    }
    typename MODEL<S>::Force f;
    for (int j = 0; j < kJoints; ++j) reinterpret_cast<S*>(&f)[j] = S(0.3 * j);
    const auto begin = std::chrono::steady_clock::now();
    for (int step = 0; step < kSteps; ++step)
      for (State& x : batch) {
        const State dx = rates<S>(x, f);
        S* to = reinterpret_cast<S*>(&x);
        const S* by = reinterpret_cast<const S*>(&dx);
        for (int i = 0; i < 2 * kJoints; ++i) to[i] = to[i] + h * by[i];
      }
    const std::chrono::duration<double, std::nano> spent = std::chrono::steady_clock::now() - begin;
    rounds.push_back(spent.count() / (double(kSteps) * kBatch * lanes));
  }
  for (std::size_t i = 0; i < rounds.size(); ++i)
    for (std::size_t k = i + 1; k < rounds.size(); ++k)
      if (rounds[k] < rounds[i]) std::swap(rounds[i], rounds[k]);
  return rounds[kRounds / 2];
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::strcmp(argv[1], "speed") == 0) {
    using tiller::TILLER_COMPILE_ISA::Pack;
    double alone = 0.0, both = 0.0;
    slope_ns(&alone, &both);
    std::printf("{\"f32\": %.4g, \"f64\": %.4g, \"scalar\": %.4g, \"alone\": %.4g, \"slopes\": %.4g}\n",
                step_ns<Pack<float>>(Pack<float>::width), step_ns<Pack<double>>(Pack<double>::width),
                step_ns<double>(1), alone, both);
    return 0;
  }
  if (argc > 1 && std::strcmp(argv[1], "slopes") == 0) return slope_values();
  return values();
}
