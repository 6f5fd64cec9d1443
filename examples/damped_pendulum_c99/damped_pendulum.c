/* A damped pendulum in plain C99: what a tiller_model_t needs, and nothing else.
 *
 * Only `dynamics` is required; `jacobian` is given here because it costs four lines (leave it null and tiller
 * takes central differences). The robot file names this source, and every tiller command compiles it once. */
#include <math.h>
#include <stddef.h>

#include "tiller/model.h"

enum { angle_rad, rate_rad_s };
enum { mass_kg, length_m, damping_Nms };

static double inertia_kgm2(const tiller_body_t* body, const double* p) {
  return (p[mass_kg] + body->payload_kg) * p[length_m] * p[length_m] + body->payload_kgm2;
}

/* Torque of a gravity vector that may be tilted, about the joint. */
static double gravity_Nm(double angle, const tiller_body_t* body, const double* p) {
  const double moment = (p[mass_kg] + body->payload_kg) * p[length_m];
  return moment * (body->gravity_x_m_s2 * cos(angle) + body->gravity_z_m_s2 * sin(angle));
}

static void dynamics(const double* x, const double* u, const double* f, const tiller_body_t* body, const double* p,
                     double* dxdt) {
  const double torque = u[0] + f[0] - p[damping_Nms] * x[rate_rad_s] + gravity_Nm(x[angle_rad], body, p);
  dxdt[angle_rad] = x[rate_rad_s];
  dxdt[rate_rad_s] = torque / inertia_kgm2(body, p);
}

static void jacobian(const double* x, const double* u, const double* f, const tiller_body_t* body, const double* p,
                     double* a, double* b) {
  const double inertia = inertia_kgm2(body, p);
  const double quarter_turn = 1.57079632679489662;
  (void)u;
  (void)f;
  a[0] = 0.0;
  a[1] = 1.0;
  a[2] = gravity_Nm(x[angle_rad] + quarter_turn, body, p) / inertia; /* cos' = cos(. + pi/2), sin' likewise */
  a[3] = -p[damping_Nms] / inertia;
  b[0] = 0.0;
  b[1] = 1.0 / inertia;
}

static const char* const state_names[] = {"angle_rad", "rate_rad_s"};
static const char* const input_names[] = {"torque_Nm"};
static const char* const param_names[] = {"mass_kg", "length_m", "damping_Nms"};
static const char* const force_names[] = {"joint_Nm"};
static const tiller_joint_t joints[] = {{"joint", angle_rad, rate_rad_s, 0, 1}};

static const tiller_model_t model = {
    .size = sizeof(tiller_model_t),
    .version = TILLER_MODEL_VERSION,
    .name = "damped_pendulum_c99",
    .state_count = 2,
    .input_count = 1,
    .param_count = 3,
    .joint_count = 1,
    .state_names = state_names,
    .input_names = input_names,
    .param_names = param_names,
    .force_names = force_names,
    .joints = joints,
    .angle_mask = 1u << angle_rad,
    .dynamics = dynamics,
    .jacobian = jacobian,
    .kernels = NULL,
};

/* What tiller looks for in the compiled file. */
const tiller_model_t* tiller_model(void);
const tiller_model_t* tiller_model(void) { return &model; }
