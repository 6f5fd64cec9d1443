/* tiller: the transport table. SPDX-License-Identifier: BSD-3-Clause
 *
 * A transport brings measurements in and takes commands out. One source per transport exports one
 * constant table. Nothing blocks: poll and send return at once. `self` is the transport's own struct,
 * owned by the caller; open is the only call that may allocate or talk to the system at length.
 */
#ifndef TILLER_TRANSPORT_H_
#define TILLER_TRANSPORT_H_

#include "tiller/tiller.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TILLER_TRANSPORT_VERSION 1u

/** Counters per cause; never decremented. */
typedef struct tiller_transport_counters {
  uint64_t received, sent;
  uint64_t dropped_old;        /**< superseded by a newer message before it was read */
  uint64_t bad_messages;       /**< wrong length, identifier, fingerprint or content */
  uint64_t queue_full;         /**< ENOBUFS, EAGAIN: dropped, never waited for */
  uint64_t bus_errors;         /**< error frames */
  uint64_t overflows;          /**< lost in the kernel's receive queue */
} tiller_transport_counters_t;

typedef struct tiller_transport {
  uint32_t size;               /**< sizeof(tiller_transport_t) */
  uint32_t version;            /**< TILLER_TRANSPORT_VERSION */
  const char* name;            /**< "memory", "lcm", "socketcan" */
  /** The newest complete measurement; no_new_measurement if there is none; a fault (bus_off,
   *  actuator_fault, transport_closed, ...) as soon as it is known. */
  tiller_status_t (*poll)(void* self, tiller_measurement_t* measurement);
  /** Sends a command that has passed the output gate. queue_full: it was dropped and counted. */
  tiller_status_t (*send)(void* self, const tiller_command_t* command);
  /** A descriptor to wait on with poll(2); -1 if there is none. */
  int (*descriptor)(void* self);
  void (*counters)(const void* self, tiller_transport_counters_t* counters);
  void (*close)(void* self);
} tiller_transport_t;

#ifdef __cplusplus
}
#endif
#endif
