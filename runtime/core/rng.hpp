#pragma once

#include <cmath>
#include <cstdint>

#include "tiller/math.hpp"

namespace tiller {

/// Philox4x32-10: four 32-bit words that are a function of a counter and a key alone (Salmon et al., "Parallel
/// random numbers: as easy as 1, 2, 3", SC 2011). There is no state to share or to advance, so a draw does not
/// depend on the number of threads or on who drew before. Cost: about 10 ns for four words.
struct Philox {
  struct Words {
    std::uint32_t w[4];
  };

  static Words draw(std::uint64_t key, std::uint64_t counter_low, std::uint64_t counter_high) {
    std::uint32_t c0 = static_cast<std::uint32_t>(counter_low), c1 = static_cast<std::uint32_t>(counter_low >> 32);
    std::uint32_t c2 = static_cast<std::uint32_t>(counter_high), c3 = static_cast<std::uint32_t>(counter_high >> 32);
    std::uint32_t k0 = static_cast<std::uint32_t>(key), k1 = static_cast<std::uint32_t>(key >> 32);
    for (int round = 0; round < 10; ++round) {
      const std::uint64_t p0 = std::uint64_t{0xD2511F53u} * c0;
      const std::uint64_t p1 = std::uint64_t{0xCD9E8D57u} * c2;
      const std::uint32_t n0 = static_cast<std::uint32_t>(p1 >> 32) ^ c1 ^ k0;
      const std::uint32_t n2 = static_cast<std::uint32_t>(p0 >> 32) ^ c3 ^ k1;
      c1 = static_cast<std::uint32_t>(p1);
      c3 = static_cast<std::uint32_t>(p0);
      c0 = n0;
      c2 = n2;
      k0 += 0x9E3779B9u;
      k1 += 0xBB67AE85u;
    }
    return {{c0, c1, c2, c3}};
  }
};

/// A stream of draws named by (seed, purpose, index): nobody else's draws shift it.
class Rng {
 public:
  Rng(std::uint64_t seed, std::uint32_t purpose, std::uint64_t index)
      : key_(seed), high_((static_cast<std::uint64_t>(purpose) << 32) ^ (index >> 32)), low_(index << 32) {}

  std::uint32_t next_u32() {
    if (left_ == 0) {
      words_ = Philox::draw(key_, low_++, high_);
      left_ = 4;
    }
    return words_.w[--left_];
  }
  /// Uniform on (0, 1), 53 bits, never 0 or 1.
  double uniform() {
    const std::uint64_t high = next_u32();
    const std::uint64_t bits = (high << 21) ^ (next_u32() >> 11);
    return (static_cast<double>(bits) + 0.5) * (1.0 / 9007199254740992.0);
  }
  /// Uniform on 0..n-1 for n < 2^32 (Lemire's multiply-shift; its bias of n/2^32 is far below any use here).
  std::uint32_t below(std::uint32_t n) { return static_cast<std::uint32_t>((std::uint64_t{next_u32()} * n) >> 32); }
  /// Standard normal by Box-Muller; the second of each pair is kept.
  double normal() {
    if (has_spare_) {
      has_spare_ = false;
      return spare_;
    }
    const double radius = std::sqrt(-2.0 * math::log(uniform()));
    const double turn = 6.283185307179586 * uniform();
    spare_ = radius * math::sin(turn);
    has_spare_ = true;
    return radius * math::cos(turn);
  }

 private:
  std::uint64_t key_, high_, low_;
  Philox::Words words_{};
  int left_ = 0;
  bool has_spare_ = false;
  double spare_ = 0.0;
};

/// Purposes of random numbers: one stream per purpose, so that adding a consumer does not shift another.
enum RngPurpose : std::uint32_t {
  kRngPrior = 1,
  kRngResample = 2,
  kRngMove = 3,
  kRngSelect = 4,
  kRngPlanner = 5,
  kRngMotion = 6,
  kRngScout = 7,
  kRngRollouts = 8,
  kRngProbe = 9,
};

/// Streams of kRngPrior: a parameter's own by its place, and between them those of a draw as a whole. They do not go by
/// the capacities of model.h: builds with other ones make the same runs.
constexpr std::uint64_t kPriorStrata = 24, kPriorRepeat = 25, kPriorExtra = 26;
constexpr std::uint64_t prior_stream(std::uint32_t param) { return param < kPriorStrata ? param : 1024 + param; }

}  // namespace tiller
