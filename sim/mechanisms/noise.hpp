#pragma once

#include <cmath>
#include <cstdint>
#include <string>

namespace tiller::sim {

/// Counter-based random numbers: the value depends on (seed, stream name, counter) alone. A sequential
/// generator shared by the channels was rejected: one channel more, or one read more, would shift the noise
/// of all others, and no two experiments could be compared.
class NoiseStream {
 public:
  NoiseStream() = default;
  NoiseStream(std::uint64_t seed, const std::string& name) : key_(mix(seed) ^ hash(name)) {}

  /// One draw of the standard normal distribution (Box-Muller). Same counter, same bits.
  double normal(std::uint64_t counter) const {
    constexpr double two_pi = 6.283185307179586;
    const double u = uniform(2 * counter), v = uniform(2 * counter + 1);
    return std::sqrt(-2.0 * std::log(u)) * std::cos(two_pi * v);
  }

  /// Uniform in the open interval (0, 1): log(0) cannot happen.
  double uniform(std::uint64_t counter) const {
    const std::uint64_t bits = mix(key_ ^ mix(counter + 1));
    return (static_cast<double>(bits >> 11) + 0.5) * 0x1.0p-53;
  }

 private:
  /// The finaliser of splitmix64 (Steele, Lea, Flood 2014): a bijection with full avalanche.
  static std::uint64_t mix(std::uint64_t x) {
    x += 0x9e3779b97f4a7c15u;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
    return x ^ (x >> 31);
  }

  /// FNV-1a, so that a stream is found by its channel's name and not by its place in a list.
  static std::uint64_t hash(const std::string& name) {
    std::uint64_t h = 0xcbf29ce484222325u;
    for (const char c : name) h = (h ^ static_cast<unsigned char>(c)) * 0x100000001b3u;
    return mix(h);
  }

  std::uint64_t key_ = 0;
};

}  // namespace tiller::sim
