/* The whole life of a controller from C, as a strict C99 program: what compiles here compiles for a C user. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <tiller/tiller.h>

static int failures = 0;
#define CHECK(condition)                                             \
  do {                                                               \
    if (!(condition)) {                                              \
      printf("%s:%d: failed: %s\n", __FILE__, __LINE__, #condition); \
      ++failures;                                                    \
    }                                                                \
  } while (0)

static void fill(tiller_config_t* c) {
  static tiller_prior_t priors[TILLER_MAX_PARAMS];
  uint32_t i;
  CHECK(tiller_config_default(c, tiller_find_model("pendulum")) == tiller_status_ok);
  for (i = 0; i < c->param_count; ++i) {
    priors[i].kind = tiller_prior_fixed;
    priors[i].a = 0.5;
  }
  c->priors = priors;
  c->safety.input_low[0] = -1.0;
  c->safety.input_high[0] = 1.0;
  c->cost.state_weight[0] = 1.0;
}

static void lifecycle(tiller_t* t) {
  tiller_measurement_t m;
  tiller_command_t u;
  tiller_info_t info;
  memset(&m, 0, sizeof m);
  CHECK(tiller_tick(t, 0, NULL, &u) == tiller_status_no_new_measurement);
  CHECK(u.state == tiller_state_init);
  m.sequence = 7;
  CHECK(tiller_tick(t, 0, &m, &u) == tiller_status_ok);
  CHECK(u.state == tiller_state_standby && u.sequence == 7 && u.value[0] == 0.0);
  CHECK(tiller_arm(t) == tiller_status_ok);
  m.stamp_us = 20000;
  (void)tiller_tick(t, 20000, &m, &u);
  CHECK(u.state == tiller_state_active);
  CHECK(u.value[0] >= -1.0 && u.value[0] <= 1.0);
  CHECK(tiller_stop(t, tiller_status_actuator_fault) == tiller_status_ok);
  CHECK(tiller_tick(t, 40000, NULL, &u) == tiller_status_actuator_fault);
  CHECK(u.state == tiller_state_safe && u.value[0] == 0.0);
  CHECK(tiller_arm(t) == tiller_status_wrong_state);
  CHECK(tiller_reset(t) == tiller_status_ok);
  tiller_get_info(t, &info);
  CHECK(info.state == tiller_state_init && info.ticks == 4);
}

int main(void) {
  static tiller_config_t config;
  const char* field = NULL;
  fill(&config);
  CHECK(tiller_config_check(&config, &field) == tiller_status_ok);
  const size_t size = tiller_size(&config);
  CHECK(size > 0);
  unsigned char* raw = malloc(size + TILLER_ALIGNMENT);
  if (raw == NULL) return 1;
  void* memory = raw + (TILLER_ALIGNMENT - (size_t)raw % TILLER_ALIGNMENT);
  tiller_t* t = NULL;
  CHECK(tiller_init(&t, &config, NULL, memory, size) == tiller_status_ok);
  if (t != NULL) lifecycle(t);
  free(raw);
  printf("tiller %s on %s: %d failures\n", tiller_version(), tiller_instruction_set(), failures);
  return failures != 0;
}
