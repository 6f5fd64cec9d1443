#include <stdio.h>
#include <stdlib.h>
#include <tiller/tiller.h>

tiller_config_t robot_config(void);

/* An exported configuration in a program of C: a second of ticks at the start state, or as many ticks as are named. */
int main(int argc, char** argv) {
  const tiller_config_t config = robot_config();
  const char* field = "";
  if (tiller_config_check(&config, &field) != tiller_status_ok) return printf("%s is wrong\n", field), 1;
  const size_t size = (tiller_size(&config) + TILLER_ALIGNMENT - 1) / TILLER_ALIGNMENT * TILLER_ALIGNMENT;
  void* block = aligned_alloc(TILLER_ALIGNMENT, size);
  tiller_t* controller = NULL;
  if (tiller_init(&controller, &config, NULL, block, size) != tiller_status_ok) return puts("no controller"), 1;
  if (tiller_arm(controller) != tiller_status_ok) return puts("not armed"), 1;
  tiller_command_t command = {0};
  const int64_t ticks = argc > 1 ? atoi(argv[1]) : 50;
  for (int64_t now_us = 20000; now_us <= ticks * 20000; now_us += 20000) {
    tiller_measurement_t m = {now_us, (uint32_t)(now_us / 20000), 0, {0}};
    for (uint32_t i = 0; i < config.measurement_count; ++i)
      m.value[i] = config.initial_state[config.measured_state[i]] + 1e-3 * (double)(now_us / 20000 % 2);
    (void)tiller_tick(controller, now_us, &m, &command);
  }
  printf("%s: state %s, command %g\n", config.model->name, tiller_state_name((tiller_state_t)command.state),
         command.value[0]);
  free(block);
  return command.state == tiller_state_active ? 0 : 1;
}
