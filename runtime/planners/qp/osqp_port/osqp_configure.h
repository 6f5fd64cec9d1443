/* Stands in for the header that OSQP's own build writes: double, 32-bit indices, no printing, no profiling clock, no
 * signal handling, no derivatives, matrices may be updated, memory from tiller_osqp.c. */
#ifndef OSQP_CONFIGURE_H
#define OSQP_CONFIGURE_H

#define OSQP_ALGEBRA_BUILTIN
#define OSQP_CUSTOM_MEMORY "tiller_osqp_memory.h"

#endif
