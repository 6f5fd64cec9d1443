#include "lander.h"

static void dynamics(const double* x, const double* u, const double* f, const tiller_body_t* body, const double* p,
                     double* dxdt) {
  (void)body;
  for (int i = 0; i < 3; ++i) {
    dxdt[i] = x[3 + i];
    dxdt[3 + i] = (u[i] + f[i]) / p[0];
  }
  dxdt[5] -= 9.81;
}

static const char* const state_names[] = {"x_m", "y_m", "z_m", "x_m_s", "y_m_s", "z_m_s"};
static const char* const input_names[] = {"x_N", "y_N", "z_N"};
static const char* const param_names[] = {"mass_kg"};
static const char* const force_names[] = {"slide_x_N", "slide_y_N", "slide_z_N"};
static const tiller_joint_t joints[] = {{"slide_x", 0, 3, 0, 0}, {"slide_y", 1, 4, 1, 0}, {"slide_z", 2, 5, 2, 0}};

const tiller_model_t lander = {
    sizeof(tiller_model_t),
    TILLER_MODEL_VERSION,
    "lander",
    6,
    3,
    1,
    3,
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
