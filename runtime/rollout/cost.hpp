#pragma once

// The cost of a trajectory, as the kernels hold it: every term of tiller_cost_config_t in the precision of the
// rollouts. The formulas are in cost_text.hpp, one text for numbers, lanes and duals; docs/reference/costs.md explains
// them.

#include <cstddef>
#include <cstdint>

#include "scalar/inline.hpp"
#include "tiller/tiller.h"

namespace tiller {

struct RolloutTable;
struct StepSetup;

/// Terms beyond the quadratic around one target, as bits of CostTerms::extra.
enum CostTerm : std::uint32_t {
  kCostSaturating = 1u << 0,
  kCostBounds = 1u << 1,
  kCostPenaltyTerms = 1u << 2,  // of the catalogue, those that are penalties
  kCostReference = 1u << 3,
  kCostDemonstration = 1u << 4,
  kCostToGo = 1u << 5,         // the matrix at the end of the horizon
  kCostOwnFunction = 1u << 6,  // the caller's, in C
  kCostOwnTemplate = 1u << 7,  // the one that the kernel was compiled with
  kCostOutputs = 1u << 8,      // their targets
  kCostOutputBounds = 1u << 9,
  kCostOtherTerms = 1u << 10  // of the catalogue
};

/// A term of the catalogue (tiller_cost_term_t).
template <class T>
struct CatalogueTerm {
  std::uint32_t kind;
  std::uint8_t states[TILLER_MAX_COST_TERM_STATES];
  T weight;
  T params[TILLER_MAX_COST_TERM_PARAMS];
};

/// Plain data: it may be copied, and lies in the planner's part of the block. The arrays of a reference or a
/// demonstration are the caller's doubles and are read row by row as they are; the cost-to-go is a row of the block.
template <class T>
struct CostTerms {
  T target[TILLER_MAX_STATES];
  T state[TILLER_MAX_STATES];     // Q
  T terminal[TILLER_MAX_STATES];  // Qf
  T input[TILLER_MAX_INPUTS];
  T input_rate[TILLER_MAX_INPUTS];
  T input_centre[TILLER_MAX_INPUTS];  // where R counts from: take_steady()

  std::uint32_t extra;                     // CostTerm bits; 0: quadratic around `target`, and nothing below is read
  std::uint8_t penalty_count, term_count;  // of `terms`: the penalties stand first
  T saturating_weight;
  T inverse_width[TILLER_MAX_STATES];  // 0 where a state has no say
  T low[TILLER_MAX_STATES], high[TILLER_MAX_STATES], bound[TILLER_MAX_STATES];
  CatalogueTerm<T> terms[TILLER_MAX_COST_TERMS];
  T* cost_to_go = nullptr;  // P, (nx x nx) row-major, symmetric: its owner's, set before lay_out_cost

  const double* reference;           // (reference_rows x nx)
  const double* demonstration_mean;  // (demonstration_rows x nx)
  const double* demonstration_root;  // (demonstration_rows x nx x nx)
  std::uint32_t reference_rows, demonstration_rows;
  T demonstration_weight;
  T own_weight;
  const tiller_own_cost_t* own;
  const tiller_output_cost_t* outputs;  // (ny), the configuration's
  const double* output_reference;       // (output_reference_rows x ny)
  std::uint32_t output_reference_rows;

  bool only_quadratic() const { return extra == 0; }
  bool has(CostTerm term) const { return (extra & term) != 0; }
};

/// Every term but the cost-to-go matrix, which takes a model: see lay_out_cost.
template <class T>
CostTerms<T> make_cost_terms(const tiller_cost_config_t& cost, std::uint32_t states);

/// Every term, in both precisions; either may be null. `cost_to_go` stays the array that it was, and is filled; where
/// the configuration wants one and the terms have none, null_argument. With tiller_terminal_lqr the cost-to-go of the
/// infinite horizon around the target: parameters at their priors' centres, the constant input that holds the target
/// best, the differences of state and input from there (delays, lags and dry friction left out). The discrete Riccati
/// equation is solved by structure-preserving doubling (Chu, Fan, Lin and Wang 2004, Int. J. Control 77:767).
/// bad_cost where it has no solution: an unstable motion that no input reaches, or an input without a weight; and where
/// an own cost has a weight but there is neither a function nor a template in the kernels.
/// No memory but the stack's (18 kB for four states, 250 kB for 32); about 0.1 ms.
tiller_status_t lay_out_cost(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                             CostTerms<double>* exact, CostTerms<float>* lanes);

/// What may change while the robot runs: target and references, as the configuration has them now. `angles`: bits of
/// the states that wrap, whose whole turns single precision does without.
template <class T>
void take_goal(const tiller_cost_config_t& cost, std::uint32_t states, std::uint32_t angles, CostTerms<T>& terms);

/// Target and centre of the inputs' weights are a steady state (nx) and its input (nu); null, both: the configuration's
/// target, and zeros. True if that is not what it was. `angles` as in take_goal.
template <class T>
bool take_steady(const tiller_cost_config_t& cost, std::uint32_t states, std::uint32_t inputs, std::uint32_t angles,
                 const double* state, const double* input, CostTerms<T>& terms);

/// The catalogue's terms for states that come less `origin` (nx); null: as they are.
template <class T>
void take_catalogue(const tiller_cost_config_t& cost, const double* origin, CostTerms<T>& terms);

/// Row of a table of `rows` that is due at `step`: the last row holds.
TILLER_INLINE std::size_t cost_row(std::uint64_t step, std::uint32_t rows) {
  return step < rows ? static_cast<std::size_t>(step) : std::size_t{rows} - 1;
}

}  // namespace tiller
