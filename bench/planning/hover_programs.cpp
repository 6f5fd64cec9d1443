#include "bench/planning/hover_programs.hpp"

#include <random>

namespace tiller::bench {
namespace {

const double kStep[12][12] = {{1, 0, 0, 0, 0, 0, 0.1, 0, 0, 0, 0, 0},
                              {0, 1, 0, 0, 0, 0, 0, 0.1, 0, 0, 0, 0},
                              {0, 0, 1, 0, 0, 0, 0, 0, 0.1, 0, 0, 0},
                              {0.0488, 0, 0, 1, 0, 0, 0.0016, 0, 0, 0.0992, 0, 0},
                              {0, -0.0488, 0, 0, 1, 0, 0, -0.0016, 0, 0, 0.0992, 0},
                              {0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0.0992},
                              {0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0},
                              {0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0},
                              {0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0},
                              {0.9734, 0, 0, 0, 0, 0, 0.0488, 0, 0, 0.9846, 0, 0},
                              {0, -0.9734, 0, 0, 0, 0, 0, -0.0488, 0, 0, 0.9846, 0},
                              {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0.9846}};
const double kPush[12][4] = {{0, -0.0726, 0, 0.0726}, {-0.0726, 0, 0.0726, 0}, {-0.0152, 0.0152, -0.0152, 0.0152},
                             {0, -0.0006, 0, 0.0006}, {0.0006, 0, -0.0006, 0}, {0.0106, 0.0106, 0.0106, 0.0106},
                             {0, -1.4512, 0, 1.4512}, {-1.4512, 0, 1.4512, 0}, {-0.3049, 0.3049, -0.3049, 0.3049},
                             {0, -0.0236, 0, 0.0236}, {0.0236, 0, -0.0236, 0}, {0.2107, 0.2107, 0.2107, 0.2107}};
const double kWeight[12] = {0, 0, 10, 10, 10, 10, 0, 0, 0, 5, 5, 5};

}  // namespace

Hover::Hover() {
  fill();
  draw_starts();
  point();
}

void Hover::fill() {
  for (int k = 0; k < kHorizon; ++k)
    for (int r = 0; r < kStates; ++r) {
      a.insert(a.end(), kStep[r], kStep[r] + kStates);
      b.insert(b.end(), kPush[r], kPush[r] + kInputs);
    }
  for (int k = 0; k <= kHorizon; ++k)
    for (int r = 0; r < kStates; ++r)
      for (int c = 0; c < kStates; ++c) qxx.push_back(r == c ? kWeight[r] : 0.0);
  for (int k = 0; k < kHorizon; ++k)
    for (int r = 0; r < kInputs; ++r)
      for (int c = 0; c < kInputs; ++c) quu.push_back(r == c ? 0.1 : 0.0);
  qx.assign((kHorizon + 1) * kStates, 0.0);
  qu.assign(kHorizon * kInputs, 0.0);
  low.assign(kHorizon * kInputs, -0.5);
  high.assign(kHorizon * kInputs, 0.5);
  state_low.assign((kHorizon + 1) * kStates, -5.0);
  state_high.assign((kHorizon + 1) * kStates, 5.0);
  start.assign(kStates, 0.0);
}

/// Positions within 1 m, angles within 0.2 rad, rates of a tenth of that a period: most of them press on the inputs.
void Hover::draw_starts() {
  std::mt19937_64 random(1);
  const auto draw = [&](double size) { return std::uniform_real_distribution<double>(-size, size)(random); };
  for (int i = 0; i < kStarts; ++i) {
    std::vector<double> x(kStates);
    for (int s = 0; s < kStates; ++s)
      x[static_cast<std::size_t>(s)] = draw(s < 3 ? 0.1 : s < 6 ? 1.0 : s < 9 ? 0.2 : 0.5);
    starts.push_back(x);
  }
}

void Hover::point() {
  LqProblem& q = qp.lq;
  q.states = kStates;
  q.inputs = kInputs;
  q.horizon = kHorizon;
  q.a = a.data();
  q.b = b.data();
  q.qxx = qxx.data();
  q.quu = quu.data();
  q.qx = qx.data();
  q.qu = qu.data();
  q.low = low.data();
  q.high = high.data();
  qp.start = start.data();
  qp.state_low = state_low.data();
  qp.state_high = state_high.data();
}

}  // namespace tiller::bench
