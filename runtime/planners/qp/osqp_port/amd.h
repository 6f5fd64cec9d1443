/* OSQP asks the AMD library for an order of elimination, and the sources that are built here come without it. For a
 * program along a horizon the order is known beforehand: stage by stage. The caller of the setup gives it. */
#ifndef TILLER_OSQP_AMD_H_
#define TILLER_OSQP_AMD_H_

#define AMD_INFO 1

int amd_order(int n, const int* column, const int* row, int* order, double* control, double* info);

#endif
