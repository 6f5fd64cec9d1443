#ifndef TILLER_TESTS_LANDER_H_
#define TILLER_TESTS_LANDER_H_

#include "tiller/model.h"

#ifdef __cplusplus
extern "C" {
#endif

/** A mass in space under its weight, 9.81 N a kilogram down. States x_m, y_m, z_m, x_m_s, y_m_s, z_m_s; inputs x_N, y_N,
 *  z_N; parameter mass_kg. */
extern const tiller_model_t lander;

#ifdef __cplusplus
}
#endif
#endif
