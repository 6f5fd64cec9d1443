#ifndef TILLER_TESTS_DOUBLE_INTEGRATOR_H_
#define TILLER_TESTS_DOUBLE_INTEGRATOR_H_

#include "tiller/model.h"

#ifdef __cplusplus
extern "C" {
#endif

/** States position_m, velocity_m_s; input force_N; parameter mass_kg. */
extern const tiller_model_t double_integrator;

#ifdef __cplusplus
}
#endif
#endif
