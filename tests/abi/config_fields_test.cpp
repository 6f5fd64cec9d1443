// config.def against tiller.h: no setting is left out, each default is in its range, and a value beyond is refused by
// name.
#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <vector>

#include "abi/config_fields.hpp"
#include "rig.hpp"
#include "tiller/config.hpp"

namespace {

using tiller::ConfigField;
using tiller::FieldKind;

bool is_whole(FieldKind kind) {
  return kind == FieldKind::count || kind == FieldKind::flag || kind == FieldKind::choice;
}

std::size_t bytes_of(const ConfigField& field) {
  if (is_whole(field.kind)) return sizeof(std::uint32_t);
  if (field.kind == FieldKind::states) return sizeof(double) * TILLER_MAX_STATES;
  return sizeof(double) * (field.kind == FieldKind::inputs ? TILLER_MAX_INPUTS : 1);
}

struct Bytes {
  std::size_t begin, size;
};

/// Bytes of [begin, begin + size) that neither config.def nor `others` lists.
std::vector<std::size_t> unlisted(std::size_t begin, std::size_t size, const std::vector<Bytes>& others) {
  std::vector<bool> listed(sizeof(tiller_config_t), false);
  const auto mark = [&](std::size_t from, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) listed[from + i] = true;
  };
  for (const ConfigField& field : tiller::config_fields()) mark(field.offset, bytes_of(field));
  for (const Bytes& other : others) mark(other.begin, other.size);
  std::vector<std::size_t> missing;
  for (std::size_t i = begin; i < begin + size; ++i)
    if (!listed[i]) missing.push_back(i - begin);
  return missing;
}

#define FIELD(name) \
  { offsetof(tiller_config_t, name), sizeof(tiller_config_t{}.name) }

TEST(ConfigFields, NoSettingOfPosteriorAndPlannerIsLeftOut) {
  const Bytes posterior = FIELD(posterior), planner = FIELD(planner), body = FIELD(body);
  // rates of forgetting and parameters that drift are lists, which the robot file's reader counts
  EXPECT_TRUE(unlisted(posterior.begin, posterior.size,
                       {FIELD(posterior.forgetting_count), FIELD(posterior.forgetting), FIELD(posterior.reserved),
                        FIELD(posterior.drift)})
                  .empty());
  EXPECT_TRUE(unlisted(planner.begin, planner.size, {}).empty());
  EXPECT_TRUE(unlisted(body.begin, body.size, {}).empty());
}

TEST(ConfigFields, FieldsDoNotOverlapAndStandInTheirStructsOrder) {
  std::string group;
  std::size_t end = 0;
  for (const ConfigField& field : tiller::config_fields()) {
    const std::string name = field.name();
    const std::string now = name.substr(0, name.find('.') == std::string::npos ? 0 : name.find('.'));
    if (now != group || now.empty()) end = 0;
    group = now;
    EXPECT_GE(field.offset, end) << name;
    end = field.offset + bytes_of(field);
  }
}

TEST(ConfigFields, DefaultsAreInRange) {
  const tiller::Config config = rig::pendulum_config();
  tiller::Config defaults;
  ASSERT_EQ(tiller_config_default(&defaults, config.model), tiller_status_ok);
  for (const ConfigField& field : tiller::config_fields()) {
    EXPECT_TRUE(field.range.holds(field.fallback)) << field.name();
    if (field.group == tiller::FieldGroup::noise) continue;  // process noise goes by the model's joints
    EXPECT_EQ(tiller::config_value(defaults, field, 0), field.fallback) << field.name();
  }
}

/// The field that tiller_config_check names for a configuration with one wrong value.
std::string refused(const ConfigField& field, double value) {
  tiller::Config config = rig::pendulum_config();
  tiller::set_config_value(config, field, 0, value);
  const char* name = "";
  return tiller_config_check(&config, &name) == tiller_status_ok ? "nothing" : name;
}

TEST(ConfigFields, ValuesBeyondTheRangeAreRefusedByName) {
  for (const ConfigField& field : tiller::config_fields()) {
    const std::string name = field.name();
    if (is_whole(field.kind)) {
      EXPECT_EQ(refused(field, field.range.high + 1), name);
      if (field.range.low > 0) {
        EXPECT_EQ(refused(field, field.range.low - 1), name);
      }
      if (field.multiple > 1) {
        EXPECT_EQ(refused(field, field.range.low + field.multiple - 1), name);
      }
      continue;
    }
    EXPECT_EQ(refused(field, 2 * field.range.high + 1), name);
    EXPECT_EQ(refused(field, field.range.low - std::fabs(field.range.low) - 1), name);
    EXPECT_EQ(refused(field, std::numeric_limits<double>::quiet_NaN()), name);
    if (!field.range.unlimited) {
      EXPECT_EQ(refused(field, HUGE_VAL), name);
    }
    if (field.range.least > 0) {
      EXPECT_EQ(refused(field, field.range.least / 2), name);
    }
    if (field.range.low_open) {
      EXPECT_EQ(refused(field, field.range.low), name);
    }
  }
}

}  // namespace
