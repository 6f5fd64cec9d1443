#include "double_integrator.h"

/* A mass on a line: the smallest system with a known optimal controller. */
static void dynamics(const double* x, const double* u, const double* f, const tiller_body_t* body, const double* p,
                     double* dxdt) {
  (void)body;
  dxdt[0] = x[1];
  dxdt[1] = (u[0] + f[0]) / p[0];
}

static const char* const state_names[] = {"position_m", "velocity_m_s"};
static const char* const input_names[] = {"force_N"};
static const char* const param_names[] = {"mass_kg"};
static const char* const force_names[] = {"slide_N"};
static const tiller_joint_t joints[] = {{"slide", 0, 1, 0, 0}};

const tiller_model_t double_integrator = {
    sizeof(tiller_model_t),
    TILLER_MODEL_VERSION,
    "double_integrator",
    2,
    1,
    1,
    1,
    state_names,
    input_names,
    param_names,
    force_names,
    joints,
    0,
    dynamics,
    0,
    0,
    0,
    0,
    0,
    0,
};
