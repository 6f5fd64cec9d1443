#pragma once

#include <cstdint>
#include <cstring>

#include "core/arena.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// The inputs of the last periods, newest first: what delays read.
class InputHistory {
 public:
  static InputHistory lay_out(Arena& arena, const tiller_config_t& config) {
    InputHistory h;
    h.nu_ = config.model->input_count;
    h.rows_ = arena.take<double>(std::size_t{kRows} * h.nu_);
    return h;
  }
  /// As if this input (nu) had been there all the time.
  void begin(const double* input) {
    for (std::uint32_t i = 0; i < kRows; ++i) std::memcpy(rows_ + i * nu_, input, sizeof(double) * nu_);
  }
  void push(const double* input) {
    std::memmove(rows_ + nu_, rows_, sizeof(double) * (kRows - 1) * nu_);
    std::memcpy(rows_, input, sizeof(double) * nu_);
  }
  const double* rows() const { return rows_; }  // (kRows x nu)
  /// The first `rows` of them; to: nullable.
  void copy(std::uint32_t rows, float* to) const {
    for (std::uint32_t i = 0; i < rows * nu_ && to; ++i) to[i] = static_cast<float>(rows_[i]);
  }

 private:
  static constexpr std::uint32_t kRows = TILLER_MAX_DELAY_STEPS + 2;

  std::uint32_t nu_ = 0;
  double* rows_ = nullptr;
};

}  // namespace tiller
