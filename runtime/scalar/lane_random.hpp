#pragma once

#include "scalar/pack.hpp"

TILLER_ISA_NAMESPACE_BEGIN

/// A word that is a random function of (a, b, index). A keyed version of a 32-bit mixer with three multiplications
/// (constants found by C. Wellons' search for low avalanche bias, "triple32", bias 0.02): `a` shifts the index, `b`
/// enters after the first round, so that rows with neighbouring `a` are not shifted copies of each other. Philox, which
/// makes the keys, needs 20 widening multiplications a word, which lanes lack: five times the cost.
inline IntPack keyed_word(IntPack index, std::uint32_t a, std::uint32_t b) {
  IntPack x = index + IntPack(a);
  x = (x ^ (x >> 17)) * IntPack(std::uint32_t{0xed5ad4bbu}) ^ IntPack(b);
  x = (x ^ (x >> 11)) * IntPack(std::uint32_t{0xac4c1b51u});
  x = (x ^ (x >> 15)) * IntPack(std::uint32_t{0x31848babu});
  return x ^ (x >> 14);
}

TILLER_ISA_NAMESPACE_END
