/* tiller: the model table. SPDX-License-Identifier: BSD-3-Clause
 *
 * A model says how the state of a robot changes: dx/dt = dynamics(x, u, f, body, p).
 *
 * Two ways to write one:
 *   C++  a template over its scalar type (see model.hpp). It runs in SIMD lanes and under dual numbers.
 *   C    fill a tiller_model_t. Only `dynamics` is required. In the place of what is missing stand a loop
 *        over the lanes and central differences: correct, and slower by the factor that the benchmark
 *        `rollout` prints.
 */
#ifndef TILLER_MODEL_H_
#define TILLER_MODEL_H_

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif
#define TILLER_MODEL_VERSION 3u

/** Upper bounds of every model; the block is sized for the counts actually used. A build for one robot may set lower
 *  ones on its command line, the same for every file that it links: its structs and stacks shrink with them. */
#ifndef TILLER_MAX_STATES
#define TILLER_MAX_STATES 32 /**< at most 32: sets of states are words of 32 bits */
#endif
#ifndef TILLER_MAX_JOINTS
#define TILLER_MAX_JOINTS 16
#endif
#ifndef TILLER_MAX_INPUTS
#define TILLER_MAX_INPUTS 16
#endif
#ifndef TILLER_MAX_PARAMS
#define TILLER_MAX_PARAMS 64 /**< model parameters and effect parameters together */
#endif
#ifndef TILLER_MAX_EFFECTS
#define TILLER_MAX_EFFECTS 32
#endif
#ifndef TILLER_MAX_EFFECT_STATES
#define TILLER_MAX_EFFECT_STATES 16 /**< over all effects */
#endif
#ifndef TILLER_MAX_OUTPUTS
#define TILLER_MAX_OUTPUTS 64
#endif
#define TILLER_MAX_DELAY_STEPS 16  /**< longest input delay, in control periods */
#define TILLER_MAX_SCENARIOS 8     /**< particles that a gradient planner plans over at once */

/** External influences on the body, outside of the model. Effects such as a tilt or a payload change it. */
typedef struct tiller_body {
  double gravity_x_m_s2;     /**< along +x; 0 on level ground */
  double gravity_z_m_s2;     /**< along +z (up); -9.81 on level ground */
  double payload_kg;         /**< added mass at the model's payload point */
  double payload_kgm2;       /**< added inertia about the payload point */
} tiller_body_t;

/** A joint: where its position, its velocity and its generalised force stand. */
typedef struct tiller_joint {
  const char* name;          /**< e.g. "pole" */
  uint8_t position;          /**< index into the state; TILLER_NO_POSITION for a velocity port */
  uint8_t velocity;          /**< index into the state */
  uint8_t force;             /**< index into the generalised forces */
  uint8_t drive;             /**< 1 + the input that pushes this joint one to one, in the force's unit; 0: none does */
} tiller_joint_t;
#define TILLER_NO_POSITION 255u

/** A model. All arrays outlive every tiller instance that uses the model. Names carry SI units
 *  ("angle_rad") and become the names in robot files, logs, plots and reports. */
typedef struct tiller_model {
  uint32_t size;             /**< sizeof(tiller_model_t) */
  uint32_t version;          /**< TILLER_MODEL_VERSION */
  const char* name;          /**< e.g. "pendulum" */

  uint32_t state_count;      /**< nx, 1..TILLER_MAX_STATES */
  uint32_t input_count;      /**< nu, 1..TILLER_MAX_INPUTS */
  uint32_t param_count;      /**< np, 0..TILLER_MAX_PARAMS */
  uint32_t joint_count;      /**< nf, 0..TILLER_MAX_JOINTS; also the number of generalised forces */

  const char* const* state_names;  /**< (nx) */
  const char* const* input_names;  /**< (nu) the actuators */
  const char* const* param_names;  /**< (np) */
  const char* const* force_names;  /**< (nf) */
  const tiller_joint_t* joints;    /**< (nf) */
  uint32_t angle_mask;       /**< bit i set: state i is an angle; differences of it are wrapped to +-pi */

  /** dxdt (nx) = f(x (nx), u (nu), f (nf), body, p (np)). Pure: no state, no allocation, no failure; a
   *  result that is not finite is caught by the caller. The dynamics are affine in f. Required unless
   *  `kernels` is set. */
  void (*dynamics)(const double* x, const double* u, const double* f, const tiller_body_t* body,
                   const double* p, double* dxdt);

  /** Optional: a (nx x nx, row-major) = d(dxdt)/dx and b (nx x nu) = d(dxdt)/du at the same point. */
  void (*jacobian)(const double* x, const double* u, const double* f, const tiller_body_t* body,
                   const double* p, double* a, double* b);

  /** Lanes, duals and rollouts compiled from a C++ template; NULL for a model written in C. */
  const void* kernels;

  /** Optional: what the model tells of itself beyond its state, as y (ny) = outputs(x (nx), p (np)): the pose of a
   *  tool, the distance of two parts. Costs and pages use them. Pure, and smooth where gradient planners are used. */
  uint32_t output_count;           /**< ny, 0..TILLER_MAX_OUTPUTS */
  const char* const* output_names; /**< (ny) */
  void (*outputs)(const double* x, const double* p, double* y);

  /** Bit i set: states i to i + 3 are a unit quaternion w, x, y, z (Hamilton's, body to world), no angles and no
   *  joints' positions. Every step ends at unit length, and differences are rotations, not differences of components:
   *  see docs/guide/own_model.md. */
  uint32_t quaternion_mask;
} tiller_model_t;

/** The models that this library was built with, by name; NULL if there is none of that name (tiller_model_names
 *  tells which there are). A model of your own is no name here: link it and call its tiller_model(). */
const tiller_model_t* tiller_find_model(const char* name);

/** Names of the built-in models, "pendulum, cart_pole, ..."; never NULL. */
const char* tiller_model_names(void);

/** The i-th built-in model; NULL past the last one. */
const tiller_model_t* tiller_builtin_model(uint32_t index);

#ifdef __cplusplus
}
#endif
#endif
