#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace tiller::tools {

/// A task as linear algebra sees it: one period x+ = A x + B u around where the robot starts and where it is wanted,
/// and the cost's weights. Matrices are row-major.
struct LinearTask {
  double period_s = 0.0;
  std::size_t states = 0, inputs = 0;
  std::vector<double> start_a, start_b;    // (nx x nx), (nx x nu)
  std::vector<double> target_a, target_b;  // likewise
  std::vector<double> stage, terminal;     // (nx) weights of the states
  std::vector<double> effort;              // (nu) weights of the inputs
  std::vector<double> reach;               // (nu) half the range of each input
  std::vector<double> way;                 // (nx) target - start; empty: there is no one target
};

/// How far a plan has to look ahead.
struct HorizonAdvice {
  std::uint32_t needed = 0;  ///< periods, a multiple of five; 0: the task says nothing of it
  std::string reason;        ///< "1.1 s: ...", without the number of periods
};

/// The longer of two spans, at most `most` periods:
///
///   settling  from how many periods on the first feedback gain of the plan is that of a plan without end to a tenth,
///             and holds the robot at its target. A shorter plan leaves what falls over to its terminal weight
///   swings    where an input cannot reach the target against a swinging mode of the start at rest, it has to pump. Its
///             amplitude grows by twice the static deflection each half swing; a plan that ends before the last one
///             sees little gain in the first. No longer than a fall at the target takes to grow a thousandfold: one
///             sequence of inputs for several hypotheses does not hold them beyond
HorizonAdvice advise_horizon(const LinearTask& task, std::uint32_t most);

}  // namespace tiller::tools
