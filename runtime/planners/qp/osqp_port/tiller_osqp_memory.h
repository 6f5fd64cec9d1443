/* OSQP's four ways to the heap, all of which end in the block that the present setup works on (tiller_osqp.c). */
#ifndef TILLER_OSQP_MEMORY_H_
#define TILLER_OSQP_MEMORY_H_

#include <stddef.h>

/* OSQP's names */
/* NOLINTBEGIN(readability-identifier-naming) */
#define c_malloc tiller_osqp_take
#define c_calloc tiller_osqp_take_zeroed
#define c_realloc tiller_osqp_resize
#define c_free tiller_osqp_give_back
/* NOLINTEND(readability-identifier-naming) */

void* tiller_osqp_take(size_t size);
void* tiller_osqp_take_zeroed(size_t count, size_t size);
void* tiller_osqp_resize(void* old, size_t size);
void tiller_osqp_give_back(void* piece);

#endif
