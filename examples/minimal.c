/* Swings a pendulum up whose mass and damping nobody told us, and holds it there.
 *
 * CMakeLists.txt: find_package(tiller REQUIRED)
 *                 add_executable(minimal minimal.c)
 *                 target_link_libraries(minimal PRIVATE tiller::tiller m)
 */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <tiller/tiller.h>

/* The robot of this example: a pendulum of its own, whose angle an encoder reads. 0 hangs, pi stands. */
static double angle_rad, rate_rad_s;

static void robot_step(double torque_Nm, double time_s) {
  const double mass_kg = 1.2, length_m = 0.5, damping_Nms = 0.08, step_s = 1e-4;
  for (double t = 0.0; t < time_s - 0.5 * step_s; t += step_s) {
    const double gravity_Nm = mass_kg * 9.81 * length_m * sin(angle_rad);
    rate_rad_s += step_s * (torque_Nm - damping_Nms * rate_rad_s - gravity_Nm) / (mass_kg * length_m * length_m);
    angle_rad += step_s * rate_rad_s;
  }
}
static double robot_encoder(void) { return floor(angle_rad / 0.001 + 0.5) * 0.001; }

int main(void) {
  static unsigned char block[4u << 20];
  void* memory = (void*)(((uintptr_t)block + TILLER_ALIGNMENT - 1) / TILLER_ALIGNMENT * TILLER_ALIGNMENT);

  /* the controller: what is known of the robot, what is wanted, what is allowed */
  tiller_config_t config;
  tiller_config_default(&config, tiller_find_model("pendulum"));
  static const tiller_prior_t priors[] = {{tiller_prior_uniform, 0, 0, 0, 0.8, 1.6},  /* mass_kg */
                                          {tiller_prior_fixed, 0, 0.5, 0, 0, 0},      /* length_m, measured */
                                          {tiller_prior_uniform, 0, 0, 0, 0.0, 0.2}}; /* damping_Nms */
  config.priors = priors;
  config.cost.target[0] = 3.14159265;
  config.cost.state_weight[0] = config.cost.terminal_weight[0] = 10.0;
  config.cost.state_weight[1] = config.cost.terminal_weight[1] = 0.5;
  config.planner.noise_sd[0] = 3.0;
  config.safety.input_low[0] = -3.0; /* half of what would lift it at once */
  config.safety.input_high[0] = 3.0;

  tiller_t* t;
  const char* field;
  const size_t size = tiller_size(&config);
  const tiller_status_t status = tiller_init(&t, &config, NULL, memory, sizeof block - TILLER_ALIGNMENT);
  if (status != tiller_status_ok) {
    tiller_config_check(&config, &field);
    printf("%s: %s\n", field, tiller_status_text(status));
    return 1;
  }
  tiller_arm(t);

  /* the loop: measure, tick, send */
  for (int64_t now_us = 0; now_us < 8000000; now_us += 20000) {
    tiller_measurement_t measurement = {now_us, 0, 0, {robot_encoder()}};
    tiller_command_t command;
    tiller_tick(t, now_us, &measurement, &command); /* whatever it returns: the command is safe to send */
    robot_step(command.value[0], 0.02);
  }

  tiller_info_t info;
  tiller_get_info(t, &info);
  printf("%zu bytes, %s: angle %.3f rad, mass %.3f +- %.3f kg (truth 1.2), %s\n", size, tiller_instruction_set(),
         angle_rad, info.param_mean[0], info.param_sd[0], tiller_state_name((tiller_state_t)info.state));
  return cos(angle_rad) < -0.98 && info.state == tiller_state_active ? 0 : 1;
}
