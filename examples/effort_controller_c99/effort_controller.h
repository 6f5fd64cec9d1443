/* A controller with the life cycle and the names of ros2_control, in C, around tiller_tick.
 *
 * ros2_control's headers are C++ and not needed here. A class that derives from
 * controller_interface::ControllerInterface forwards each of its functions to the one of the same name:
 *
 *   ros2_control                                    here
 *   on_configure(previous_state)                    effort_controller_configure
 *   on_activate(previous_state)                     effort_controller_activate
 *   on_deactivate(previous_state)                   effort_controller_deactivate
 *   update(time, period)                            effort_controller_update
 *   state_interface_configuration():                joint/position, read into state->position_rad
 *   command_interface_configuration():              joint/effort, written from the returned command
 *
 * update() allocates nothing, takes no lock and prints nothing. It may run at 1 kHz above a controller that plans more
 * slowly: between two ticks the last command holds.
 */
#pragma once

#include <stdint.h>
#include <tiller/tiller.h>

#ifdef __cplusplus
extern "C" {
#endif

/* As controller_interface::return_type and CallbackReturn. */
typedef enum effort_return { EFFORT_OK = 0, EFFORT_ERROR = 1 } effort_return_t;

typedef struct effort_state {
  double position_rad; /* joint/position; NaN: the driver has no reading */
} effort_state_t;

typedef struct effort_controller {
  tiller_t* tiller;
  int64_t tick_us, next_tick_us; /* period of the ticks, and when the next one is due */
  double effort_Nm;              /* holds between two ticks */
  uint32_t sequence;
  uint64_t updates, ticks;
} effort_controller_t;

/* Lays the controller into `memory` (bytes, aligned to TILLER_ALIGNMENT), which the caller keeps. EFFORT_ERROR with the
 * name of a configuration's field in *field, or NULL where the memory is too small. */
effort_return_t effort_controller_configure(effort_controller_t* self, const tiller_config_t* config, void* memory,
                                            size_t bytes, const char** field);
effort_return_t effort_controller_activate(effort_controller_t* self, int64_t time_us);
/* The effort becomes the safe one. */
effort_return_t effort_controller_deactivate(effort_controller_t* self, double safe_effort_Nm);
/* The effort in N m to write to joint/effort; safe whatever is read. */
double effort_controller_update(effort_controller_t* self, int64_t time_us, const effort_state_t* state);

#ifdef __cplusplus
}
#endif
