/* A pendulum in plain C99 that brings its own cost: the swing-up by energy (Astrom and Furuta 2000). What counts is
 * not how far the angle is from upright, but how far the energy is from that of standing there; a planner that pays
 * for the difference pumps by itself, and needs to look ahead no further than a swing.
 *
 * The robot file names this source; tiller compiles it once and finds both functions in it. */
#include <math.h>
#include <stddef.h>

#include "tiller/tiller.h"

enum { angle_rad, rate_rad_s };
enum { mass_kg, length_m, damping_Nms };

static void dynamics(const double* x, const double* u, const double* f, const tiller_body_t* body, const double* p,
                     double* dxdt) {
  const double inertia = p[mass_kg] * p[length_m] * p[length_m];
  const double pull =
      p[mass_kg] * p[length_m] * (body->gravity_x_m_s2 * cos(x[angle_rad]) + body->gravity_z_m_s2 * sin(x[angle_rad]));
  dxdt[angle_rad] = x[rate_rad_s];
  dxdt[rate_rad_s] = (u[0] + f[0] - p[damping_Nms] * x[rate_rad_s] + pull) / inertia;
}

static const char* const state_names[] = {"angle_rad", "rate_rad_s"};
static const char* const input_names[] = {"torque_Nm"};
static const char* const param_names[] = {"mass_kg", "length_m", "damping_Nms"};
static const char* const force_names[] = {"joint_Nm"};
static const tiller_joint_t joints[] = {{"joint", angle_rad, rate_rad_s, 0, 1}};

static const tiller_model_t model = {
    .size = sizeof(tiller_model_t),
    .version = TILLER_MODEL_VERSION,
    .name = "energy_pendulum",
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
};

const tiller_model_t* tiller_model(void);
const tiller_model_t* tiller_model(void) { return &model; }

/* The energy that is missing, as a share of what lifting the bob from the bottom to the top takes: 0 where the
 * pendulum just reaches the top, -1 where it hangs at rest. Free of the mass: every particle of the posterior is
 * judged by its own. */
static double missing(const double* x, const double* p) {
  const double g = 9.81;
  const double height = 0.5 * (1.0 - cos(x[angle_rad]));
  return 0.25 * x[rate_rad_s] * x[rate_rad_s] * p[length_m] / g + height - 1.0;
}

static double stage(const double* x, const double* u, const double* p, double time_s, void* context) {
  const double share = missing(x, p);
  const double height = 0.5 * (1.0 - cos(x[angle_rad]));
  (void)u;
  (void)time_s;
  (void)context;
  return 10.0 * share * share + 2.0 * (1.0 - height); /* the second term chooses the top among all of that energy */
}

static double terminal(const double* x, const double* p, double time_s, void* context) {
  return 10.0 * stage(x, NULL, p, time_s, context);
}

static const tiller_own_cost_t cost = {
    .size = sizeof(tiller_own_cost_t),
    .version = TILLER_CONFIG_VERSION,
    .stage = stage,
    .terminal = terminal,
    .context = NULL,
};

/* What tiller looks for beside tiller_model(); [cost] own_weight weighs it. */
const tiller_own_cost_t* tiller_cost(void);
const tiller_own_cost_t* tiller_cost(void) { return &cost; }
