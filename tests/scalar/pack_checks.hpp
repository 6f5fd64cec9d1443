#pragma once

#include <string>

/// Errors of one instruction set's lanes; empty text for none.
struct PackReport {
  int width_f32, width_f64;
  double sincos_f32, sincos_f64;                 // largest absolute error, |x| <= 8192 and 1e6
  double exp_f32, log_f32, tanh_f32, atan2_f32;  // largest relative error
  double exp_f64, log_f64, tanh_f64, atan2_f64;
  std::string wrong;  // arithmetic, comparison, select, NaN, integers
};
