#pragma once

// What a controller knows of the parameters, and the use that it makes of it.

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller::bench {

/// Closed: plans in which each hypothesis answers where it goes. Uncorrected: expected cost over the prior, which no
/// measurement changes.
enum class Knowledge {
  nominal,
  mean,
  expected,
  cvar,
  closed_expected,
  closed_cvar,
  uncorrected,
  closed_uncorrected,
  oracle
};
const char* knowledge_name(Knowledge k);

/// Whether its parameters have a prior; else they are fixed.
bool is_unsure(Knowledge k);

/// Sets posterior, risk and hypotheses; the priors are the caller's.
void set_knowledge(tiller_config_t& config, Knowledge knowledge, std::uint32_t hypotheses);

}  // namespace tiller::bench
