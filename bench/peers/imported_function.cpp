// An imported function alone: MODEL of HEADER (-D), and beside it CasADi's own C code of the same (-DC_NAME, linked
// in). Compiled by robots.py; not part of the CMake build.
//
//   imported_function values   reads rows x, u, p; prints xdot, then its slopes by x and u, row by row
//   imported_function speed    nanoseconds of an Euler step: f32, f64, scalar, and CasADi's C code

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

#include "scalar/dual.hpp"
#include "scalar/pack.hpp"
#include "tiller/model.hpp"

#include HEADER

extern "C" int f(const double** arg, double** res, long long* iw, double* w, int mem);
extern "C" int f_work(long long* sz_arg, long long* sz_res, long long* sz_iw, long long* sz_w);

namespace {

constexpr int kStates = MODEL<double>::State::count, kInputs = MODEL<double>::Input::count,
              kParams = MODEL<double>::Params::count;

template <class S>
typename MODEL<S>::State rates(const typename MODEL<S>::State& x, const typename MODEL<S>::Input& u,
                               const typename MODEL<S>::Params& p) {
  return MODEL<S>::dynamics(x, u, tiller::Body<S>{}, p);
}
/// The numbers of a struct of TILLER_FIELDS.
template <class S, class Fields>
S* numbers(Fields& fields) {
  return reinterpret_cast<S*>(&fields);
}

int values() {
  constexpr int kAll = kStates + kInputs;
  using D = tiller::Dual<double, kAll>;
  MODEL<D>::State x;
  MODEL<D>::Input u;
  MODEL<D>::Params p;
  for (double row[kAll + kParams];;) {
    for (double& v : row)
      if (std::scanf("%lf", &v) != 1) return 0;
    for (int k = 0; k < kStates; ++k) numbers<D>(x)[k] = D::seed(row[k], k);
    for (int k = 0; k < kInputs; ++k) numbers<D>(u)[k] = D::seed(row[kStates + k], kStates + k);
    for (int k = 0; k < kParams; ++k) numbers<D>(p)[k] = D(row[kAll + k]);
    MODEL<D>::State dx = rates<D>(x, u, p);
    for (int k = 0; k < kStates; ++k) std::printf("%.17g ", numbers<D>(dx)[k].v);
    for (int k = 0; k < kStates; ++k)
      for (double d : numbers<D>(dx)[k].d) std::printf("%.17g ", d);
    std::printf("\n");
  }
}

/// CasADi's C code, as a caller of it would write the call.
class Generated {
 public:
  Generated() {
    long long arg = 0, res = 0, iw = 0, w = 0;
    f_work(&arg, &res, &iw, &w);
    arg_.resize(static_cast<std::size_t>(arg));
    res_.resize(static_cast<std::size_t>(res));
    iw_.resize(static_cast<std::size_t>(iw) + 1);
    w_.resize(static_cast<std::size_t>(w) + 1);
  }
  MODEL<double>::State operator()(const MODEL<double>::State& x, const MODEL<double>::Input& u,
                                  const MODEL<double>::Params& p) {
    MODEL<double>::State out;
    arg_[0] = numbers<const double>(x), arg_[1] = numbers<const double>(u), arg_[2] = numbers<const double>(p);
    res_[0] = numbers<double>(out);
    f(arg_.data(), res_.data(), iw_.data(), w_.data(), 0);
    return out;
  }

 private:
  std::vector<const double*> arg_;
  std::vector<double*> res_;
  std::vector<long long> iw_;
  std::vector<double> w_;
};

/// The fastest of 200 rounds, which other programs disturb least, over a batch that stays in the first-level cache.
template <class S, class Rates>
double step_ns(int lanes, Rates&& step) {
  constexpr int kBatch = 16, kSteps = 200, kRounds = 200;
  std::vector<typename MODEL<S>::State> batch(kBatch);
  typename MODEL<S>::Input u;
  typename MODEL<S>::Params p;
  const S h(1e-4);
  for (int i = 0; i < kInputs; ++i) numbers<S>(u)[i] = S(0.3 + 0.1 * i);
  for (int i = 0; i < kParams; ++i) numbers<S>(p)[i] = S(1.0 + 0.1 * i);
  std::vector<double> rounds;
  for (int round = 0; round < kRounds; ++round) {
    for (int b = 0; b < kBatch; ++b)
      for (int i = 0; i < kStates; ++i)
        numbers<S>(batch[static_cast<std::size_t>(b)])[i] = S(0.5 * std::sin(i + 3.0 * b));
    const auto begin = std::chrono::steady_clock::now();
    for (int k = 0; k < kSteps; ++k)
      for (typename MODEL<S>::State& x : batch) {
        typename MODEL<S>::State dx = step(x, u, p);
        for (int i = 0; i < kStates; ++i) numbers<S>(x)[i] = numbers<S>(x)[i] + h * numbers<S>(dx)[i];
      }
    const std::chrono::duration<double, std::nano> spent = std::chrono::steady_clock::now() - begin;
    rounds.push_back(spent.count() / (double(kSteps) * kBatch * lanes));
  }
  return *std::min_element(rounds.begin(), rounds.end());
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || std::strcmp(argv[1], "speed") != 0) return values();
  using tiller::TILLER_COMPILE_ISA::Pack;
  Generated generated;
  std::printf("{\"f32\": %.4g, \"f64\": %.4g, \"scalar\": %.4g, \"casadi\": %.4g}\n",
              step_ns<Pack<float>>(Pack<float>::width, rates<Pack<float>>),
              step_ns<Pack<double>>(Pack<double>::width, rates<Pack<double>>), step_ns<double>(1, rates<double>),
              step_ns<double>(1, generated));
  return 0;
}
