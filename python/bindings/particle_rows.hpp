#pragma once

#include "posterior/posterior.hpp"

namespace tiller::python {

/// Where an engine keeps its particles. They stay there as long as the controller's block does, and change with every
/// update. Null where several clouds stand side by side (delay hypotheses, rates of forgetting).
struct ParticleRows {
  const double* params = nullptr;  // (np x N)
  const double* weight = nullptr;  // (N)
};

ParticleRows particle_rows(const tiller_config_t& config, const tiller::Posterior& posterior);

}  // namespace tiller::python
