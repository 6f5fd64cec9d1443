#include "effort_controller.h"

effort_return_t effort_controller_configure(effort_controller_t* self, const tiller_config_t* config, void* memory,
                                            size_t bytes, const char** field) {
  const effort_controller_t blank = {0};
  *self = blank;
  *field = NULL;
  if (tiller_config_check(config, field) != tiller_status_ok) return EFFORT_ERROR;
  if (tiller_init(&self->tiller, config, NULL, memory, bytes) != tiller_status_ok) return EFFORT_ERROR;
  self->tick_us = (int64_t)(config->period_s * 1e6 + 0.5);
  return EFFORT_OK;
}

effort_return_t effort_controller_activate(effort_controller_t* self, int64_t time_us) {
  self->next_tick_us = time_us;
  tiller_arm(self->tiller);
  return EFFORT_OK;
}

effort_return_t effort_controller_deactivate(effort_controller_t* self, double safe_effort_Nm) {
  tiller_reset(self->tiller);
  self->effort_Nm = safe_effort_Nm;
  return EFFORT_OK;
}

double effort_controller_update(effort_controller_t* self, int64_t time_us, const effort_state_t* state) {
  ++self->updates;
  if (time_us < self->next_tick_us) return self->effort_Nm;
  const tiller_measurement_t measurement = {time_us, self->sequence++, 0, {state->position_rad}};
  tiller_command_t command;
  (void)tiller_tick(self->tiller, time_us, &measurement, &command); /* the command is safe whatever it returns */
  ++self->ticks;
  self->effort_Nm = command.value[0];
  self->next_tick_us += self->tick_us;
  if (self->next_tick_us <= time_us) self->next_tick_us = time_us + self->tick_us; /* late: no burst */
  return self->effort_Nm;
}
