#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <set>
#include <string>
#include <vector>

#include "core/arena.hpp"
#include "core/ring.hpp"
#include "core/rng.hpp"
#include "tiller/tiller.h"

namespace tiller {
namespace {

struct Layout {
  double* a;
  char* b;
  float* c;
};
Layout lay_out(Arena& arena) { return {arena.take<double>(3), arena.take<char>(65), arena.take<float>(1)}; }

TEST(Arena, MeasuresWhatItPlaces) {
  Arena measure;
  lay_out(measure);
  alignas(64) unsigned char block[512];
  ASSERT_LE(measure.used(), sizeof block);
  std::memset(block, 0xAB, sizeof block);
  Arena place(block, measure.used());
  const Layout l = lay_out(place);
  EXPECT_TRUE(place.fits());
  EXPECT_EQ(place.used(), measure.used());
  EXPECT_EQ(reinterpret_cast<unsigned char*>(l.a), block);
  EXPECT_EQ(reinterpret_cast<unsigned char*>(l.b), block + 64);
  EXPECT_EQ(reinterpret_cast<unsigned char*>(l.c), block + 64 + 128);
  EXPECT_EQ(l.a[2], 0.0);  // value-initialised
  EXPECT_EQ(block[measure.used()], 0xAB);
}

TEST(Arena, SaysWhenABlockIsTooSmall) {
  Arena measure;
  lay_out(measure);
  alignas(64) unsigned char block[512];
  Arena place(block, measure.used() - 1);
  EXPECT_EQ(lay_out(place).c, nullptr);
  EXPECT_FALSE(place.fits());
}

TEST(Arena, NoObjectsTakeNoPlace) {
  alignas(64) unsigned char block[64];
  Arena place(block, sizeof block);
  EXPECT_EQ(place.take<double>(0), nullptr);
  EXPECT_EQ(place.used(), 0u);
  EXPECT_EQ(reinterpret_cast<unsigned char*>(place.take<double>(8)), block);
  EXPECT_EQ(place.take<double>(0), nullptr);
  EXPECT_TRUE(place.fits());
}

// The vectors published with the generator (Random123 kat_vectors, philox4x32-10).
TEST(Philox, KnownAnswers) {
  const auto zero = Philox::draw(0, 0, 0);
  EXPECT_EQ(zero.w[0], 0x6627e8d5u);
  EXPECT_EQ(zero.w[1], 0xe169c58du);
  EXPECT_EQ(zero.w[2], 0xbc57ac4cu);
  EXPECT_EQ(zero.w[3], 0x9b00dbd8u);
  const auto ones = Philox::draw(~0ull, ~0ull, ~0ull);
  EXPECT_EQ(ones.w[0], 0x408f276du);
  EXPECT_EQ(ones.w[1], 0x41c83b0eu);
  EXPECT_EQ(ones.w[2], 0xa20bc7c6u);
  EXPECT_EQ(ones.w[3], 0x6d5451fdu);
}

TEST(Rng, StreamsAreIndependentOfEachOther) {
  std::set<std::uint32_t> seen;
  for (std::uint32_t purpose = 1; purpose <= 5; ++purpose)
    for (std::uint64_t index : {0ull, 1ull, 1ull << 32, (1ull << 32) + 1}) {
      Rng rng(42, purpose, index);
      for (int i = 0; i < 16; ++i) seen.insert(rng.next_u32());
    }
  EXPECT_EQ(seen.size(), 5u * 4u * 16u);  // 320 draws of 2^32 collide with probability 1e-5
}

TEST(Rng, MomentsOfUniformAndNormal) {
  Rng rng(7, 1, 0);
  const int n = 200000;
  double sum = 0, square = 0, fourth = 0, u = 0;
  for (int i = 0; i < n; ++i) {
    const double z = rng.normal();
    sum += z;
    square += z * z;
    fourth += z * z * z * z;
    const double v = rng.uniform();
    ASSERT_GT(v, 0.0);
    ASSERT_LT(v, 1.0);
    u += v;
  }
  // five standard errors: sd of z, z^2, z^4 are 1, sqrt 2, sqrt 96; of a uniform sqrt(1/12)
  const double root = std::sqrt(double(n));
  EXPECT_NEAR(sum / n, 0.0, 5 / root);
  EXPECT_NEAR(square / n, 1.0, 5 * std::sqrt(2.0) / root);
  EXPECT_NEAR(fourth / n, 3.0, 5 * std::sqrt(96.0) / root);
  EXPECT_NEAR(u / n, 0.5, 5 * std::sqrt(1.0 / 12.0) / root);
}

TEST(Ring, NamesItemsByTheirPositionInTheSequence) {
  std::vector<int> storage(4);
  Ring<int> ring(storage.data(), 4);
  EXPECT_EQ(ring.size(), 0u);
  for (int i = 0; i < 11; ++i) ring.push() = i;
  EXPECT_EQ(ring.begin(), 7u);
  EXPECT_EQ(ring.end(), 11u);
  EXPECT_FALSE(ring.holds(6));
  EXPECT_TRUE(ring.holds(7));
  EXPECT_TRUE(ring.holds(10));
  EXPECT_FALSE(ring.holds(11)) << "not yet";
  EXPECT_EQ(ring[7], 7);
  EXPECT_EQ(ring.newest(), 10);
  EXPECT_EQ(ring.newest(3), 7);
  ring.clear();
  EXPECT_EQ(ring.size(), 0u);
}

TEST(Status, EveryCodeHasItsBandNameAndText) {
  std::set<int> codes;
  std::set<std::string> names;
  struct Row {
    int code;
    const char* name;
    const char* band;
  };
  const Row rows[] = {
#define TILLER_STATUS(code, name, band, text) {code, #name, #band},
#include "tiller/status.def"
#undef TILLER_STATUS
  };
  for (const Row& row : rows) {
    EXPECT_TRUE(codes.insert(row.code).second) << row.code << " stands twice";
    EXPECT_TRUE(names.insert(row.name).second) << row.name << " stands twice";
    EXPECT_STREQ(tiller_status_name(static_cast<tiller_status_t>(row.code)), row.name);
    EXPECT_GT(std::strlen(tiller_status_text(static_cast<tiller_status_t>(row.code))), 5u);
    if (row.code == 0) continue;
    const std::string band = row.code < 100 ? "usage" : row.code < 200 ? "fault" : "limited";
    EXPECT_EQ(band, row.band) << row.name;
  }
  EXPECT_STREQ(tiller_status_name(static_cast<tiller_status_t>(9999)), "unknown");
  EXPECT_STREQ(tiller_status_text(static_cast<tiller_status_t>(9999)), "not a status of tiller");
}

}  // namespace
}  // namespace tiller
