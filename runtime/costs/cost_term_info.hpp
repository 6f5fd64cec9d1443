#pragma once

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller {

/// One of the states that a term reads.
struct CostTermState {
  const char* key = nullptr;  ///< in a robot file: "x_state"
  const char* help = "";
};

struct CostTermParam {
  const char* key = nullptr;  ///< in a robot file; ends in its unit
  const char* unit = "";
  double low = -TILLER_LARGEST_VALUE;  ///< closed range
  double high = TILLER_LARGEST_VALUE;
  const char* help = "";
  /// The parameter is a value of the term's state of this index, from which whole turns of an angle are removed with
  /// it; -1: it is not.
  int of_state = -1;
};

/// What a term of costs.def says of itself: the robot file, its documentation, the configuration's check, the exported
/// C and the pages are made from it.
struct CostTermInfo {
  const char* name = nullptr;      ///< of one, for messages: "obstacle"
  const char* help = nullptr;      ///< one sentence
  const char* equation = nullptr;  ///< of the residual r; a period costs weight r^2
  const char* weight_unit = "";    ///< 1 / unit of r^2
  bool penalty = false;            ///< a limit: summed apart from the task's other terms (docs/reference/costs.md)
  bool circle = false;             ///< pages draw it: states 0 and 1 span its plane, parameters 0 to 2 are x, y, radius
  std::uint32_t state_count = 0;   ///< 1..TILLER_MAX_COST_TERM_STATES, each another one
  CostTermState states[TILLER_MAX_COST_TERM_STATES] = {};
  std::uint32_t param_count = 0;  ///< 0..TILLER_MAX_COST_TERM_PARAMS
  CostTermParam params[TILLER_MAX_COST_TERM_PARAMS] = {};
};

/// Of a kind (tiller_cost_term_kind_t), kind < tiller_cost_term_kind_count.
const CostTermInfo& cost_term_info(std::uint32_t kind);
/// Its key in [cost]: "obstacles", for [[cost.obstacles]].
const char* cost_term_key(std::uint32_t kind);

}  // namespace tiller
