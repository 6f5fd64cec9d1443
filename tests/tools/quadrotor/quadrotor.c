/* A quadrotor in space: twelve states, four inputs, Euler angles (roll, pitch, yaw: x, y, z). What it does within a
 * control period is smooth; under inputs that nobody would choose it tumbles through the angles' singularity. */
#include <math.h>

#include "tiller/tiller.h"

enum { x_m, y_m, z_m, roll, pitch, yaw, vx, vy, vz, p_rad_s, q_rad_s, r_rad_s };

static void dynamics(const double* x, const double* u, const double* f, const tiller_body_t* body, const double* par,
                     double* dxdt) {
  const double sr = sin(x[roll]), cr = cos(x[roll]), sp = sin(x[pitch]), cp = cos(x[pitch]);
  const double sy = sin(x[yaw]), cy = cos(x[yaw]), tp = tan(x[pitch]);
  const double p = x[p_rad_s], q = x[q_rad_s], r = x[r_rad_s];
  const double mass = par[0], lateral = par[1], vertical = par[2];
  dxdt[x_m] = x[vx];
  dxdt[y_m] = x[vy];
  dxdt[z_m] = x[vz];
  dxdt[roll] = p + tp * (q * sr + r * cr);
  dxdt[pitch] = q * cr - r * sr;
  dxdt[yaw] = (q * sr + r * cr) / cp;
  dxdt[vx] = (cy * sp * cr + sy * sr) * u[0] / mass;
  dxdt[vy] = (sy * sp * cr - cy * sr) * u[0] / mass;
  dxdt[vz] = cp * cr * u[0] / mass + body->gravity_z_m_s2 + f[0] / mass;
  dxdt[p_rad_s] = (u[1] + (lateral - vertical) * q * r) / lateral;
  dxdt[q_rad_s] = (u[2] + (vertical - lateral) * p * r) / lateral;
  dxdt[r_rad_s] = u[3] / vertical;
}

static const char* const states[] = {"x_m",    "y_m",    "z_m",    "roll_rad",   "pitch_rad",   "yaw_rad",
                                     "vx_m_s", "vy_m_s", "vz_m_s", "roll_rad_s", "pitch_rad_s", "yaw_rad_s"};
static const char* const inputs[] = {"thrust_N", "roll_Nm", "pitch_Nm", "yaw_Nm"};
static const char* const params[] = {"mass_kg", "lateral_kgm2", "vertical_kgm2"};
static const char* const forces[] = {"lift_N"};
static const tiller_joint_t joints[] = {{"lift", z_m, vz, 0, 0}};
static const tiller_model_t model = {sizeof(tiller_model_t),
                                     TILLER_MODEL_VERSION,
                                     "quadrotor",
                                     12,
                                     4,
                                     3,
                                     1,
                                     states,
                                     inputs,
                                     params,
                                     forces,
                                     joints,
                                     1u << roll | 1u << pitch | 1u << yaw,
                                     dynamics,
                                     0,
                                     0};

const tiller_model_t* tiller_model(void) { return &model; }
