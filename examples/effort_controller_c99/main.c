/* The controller at 1 kHz on a simulated pendulum: swings it up within eight seconds, or ends with 1. */
#include <math.h>
#include <stdio.h>

#include "effort_controller.h"

static double angle_rad, rate_rad_s;

static void joint_step(double effort_Nm, double time_s) {
  const double mass_kg = 1.2, length_m = 0.5, damping_Nms = 0.08, step_s = 1e-4;
  for (double t = 0.0; t < time_s - 0.5 * step_s; t += step_s) {
    const double gravity_Nm = mass_kg * 9.81 * length_m * sin(angle_rad);
    rate_rad_s += step_s * (effort_Nm - damping_Nms * rate_rad_s - gravity_Nm) / (mass_kg * length_m * length_m);
    angle_rad += step_s * rate_rad_s;
  }
}

static void set_up(tiller_config_t* config) {
  static const tiller_prior_t priors[] = {{tiller_prior_uniform, 0, 0, 0, 0.8, 1.6},  /* mass_kg */
                                          {tiller_prior_fixed, 0, 0.5, 0, 0, 0},      /* length_m */
                                          {tiller_prior_uniform, 0, 0, 0, 0.0, 0.2}}; /* damping_Nms */
  tiller_config_default(config, tiller_find_model("pendulum"));
  config->priors = priors;
  config->cost.target[0] = 3.14159265;
  config->cost.state_weight[0] = config->cost.terminal_weight[0] = 10.0;
  config->cost.state_weight[1] = config->cost.terminal_weight[1] = 0.5;
  config->planner.noise_sd[0] = 3.0;
  config->safety.input_low[0] = -3.0;
  config->safety.input_high[0] = 3.0;
}

int main(void) {
  static unsigned char block[4u << 20];
  void* memory = (void*)(((uintptr_t)block + TILLER_ALIGNMENT - 1) / TILLER_ALIGNMENT * TILLER_ALIGNMENT);
  tiller_config_t config;
  effort_controller_t controller;
  const char* field;
  set_up(&config);
  if (effort_controller_configure(&controller, &config, memory, sizeof block - TILLER_ALIGNMENT, &field) != EFFORT_OK) {
    printf("configure: %s\n", field ? field : "more memory is needed");
    return 1;
  }
  effort_controller_activate(&controller, 0);
  for (int64_t time_us = 0; time_us < 8000000; time_us += 1000) {
    const effort_state_t state = {floor(angle_rad / 0.001 + 0.5) * 0.001};
    joint_step(effort_controller_update(&controller, time_us, &state), 0.001);
  }
  const double off_rad = fabs(remainder(angle_rad - 3.14159265, 2 * 3.14159265));
  printf("%llu updates, %llu ticks, %.3f rad from upright\n", (unsigned long long)controller.updates,
         (unsigned long long)controller.ticks, off_rad);
  effort_controller_deactivate(&controller, 0.0);
  return off_rad < 0.2 ? 0 : 1;
}
