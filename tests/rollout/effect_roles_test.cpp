// The columns of effects.def beside names: roles and likeness.
#include "effects/effect_roles.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <sstream>
#include <string>

#include "effects/effect_info.hpp"

namespace tiller {
namespace {

std::uint32_t kind_of(const char* name) {
  const int kind = find_effect(name);
  EXPECT_GE(kind, 0) << name;
  return static_cast<std::uint32_t>(kind);
}

TEST(EffectRoles, AgreeWithTheEffectsOwnHeaders) {
  for (std::uint32_t kind = 0; kind < effect_kind_count(); ++kind) {
    const EffectInfo& info = effect_info(kind);
    SCOPED_TRACE(info.name);
    if (has_role(kind, kDelay | kLag | kLimit | kFollows | kLoad)) {
      EXPECT_EQ(info.port, PortKind::input);
    }
    if (has_role(kind, kDelay | kLag)) {
      EXPECT_EQ(info.params[0].scale, Scale::period);
      EXPECT_STREQ(info.params[0].unit, "s");
    }
    // the others with a state at an input are moved by the joint, too, and a clock by nothing
    const bool by_commands =
        info.port == PortKind::input && info.state_count > 0 && !info.needs_drive && !has_role(kind, kClock);
    EXPECT_EQ(by_commands, has_role(kind, kLag | kFollows | kLoad));
    if (has_role(kind, kLate)) {
      EXPECT_EQ(info.port, PortKind::sensor);
      EXPECT_STREQ(info.params[0].unit, "s");
    }
    if (has_role(kind, kLimit)) {
      EXPECT_EQ(info.params[0].scale, Scale::input);
    }
    if (has_role(kind, kLoad)) {
      ASSERT_EQ(info.param_count, 2);
      EXPECT_EQ(info.params[1].scale, Scale::period);
    }
    if (has_role(kind, kLinear | kSmooth | kWidth)) {
      EXPECT_EQ(info.state_count, 0);
    }
  }
}

TEST(EffectRoles, OneHasEach) {
  for (const std::uint32_t role : {kDelay, kLag, kLimit, kFollows, kLoad, kLinear, kWidth, kClock, kSmooth, kLate}) {
    bool found = false;
    for (std::uint32_t kind = 0; kind < effect_kind_count(); ++kind) found = found || has_role(kind, role);
    EXPECT_TRUE(found) << role;
  }
  EXPECT_FALSE(has_role(effect_kind_count(), ~0u)) << "no kind has no role";
}

TEST(EffectLikeness, NamesOtherEffectsAndGoesBothWays) {
  const char* const lists[] = {
#define TILLER_EFFECT(name, Type, roles, like) like,
#include "tiller/effects.def"
#undef TILLER_EFFECT
  };
  for (std::uint32_t kind = 0; kind < effect_kind_count(); ++kind) {
    EXPECT_FALSE(are_alike(kind, kind)) << effect_info(kind).name;
    std::istringstream words(lists[kind]);
    for (std::string word; words >> word;) {
      const std::uint32_t other = kind_of(word.c_str());
      EXPECT_TRUE(are_alike(kind, other) && are_alike(other, kind)) << effect_info(kind).name << " " << word;
      for (const char* alias : effect_info(kind).aliases)
        EXPECT_TRUE(!alias || word != alias) << word << ": said twice";
    }
  }
  EXPECT_TRUE(are_alike(kind_of("dead_zone"), kind_of("cogging")));
  EXPECT_FALSE(are_alike(kind_of("linear_spring"), kind_of("cubic_spring")))
      << "both like cogging, not like each other";
}

}  // namespace
}  // namespace tiller
