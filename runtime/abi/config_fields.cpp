#include "abi/config_fields.hpp"

#include "abi/element_names.hpp"

namespace tiller {
namespace {

using namespace ranges;

// Literals, so that nothing formats text here.
#define TILLER_COUNT(section, key, field, ...) constexpr auto k_##section##_##key = single_name(#field);
#define TILLER_NUMBER TILLER_COUNT
#define TILLER_FLAG TILLER_COUNT
#define TILLER_CHOICE TILLER_COUNT
#define TILLER_STATES(section, key, field, ...) \
  constexpr auto k_##section##_##key = element_names<TILLER_MAX_STATES>(#field);
#define TILLER_INPUTS(section, key, field, ...) \
  constexpr auto k_##section##_##key = element_names<TILLER_MAX_INPUTS>(#field);
#include "tiller/config.def"

static_assert(sizeof(tiller_config_t) < 65536, "offsets are of 16 bits");

#define TILLER_ENTRY(section, key, kind, field, multiple, fallback, ...)             \
  {FieldGroup::section, FieldKind::kind, offsetof(tiller_config_t, field), multiple, \
   double(fallback),    __VA_ARGS__,     k_##section##_##key[0],           sizeof k_##section##_##key.text[0]},
#define TILLER_COUNT(section, key, field, fallback, low, high, multiple, ...) \
  TILLER_ENTRY(section, key, count, field, multiple, fallback, {low, high})
#define TILLER_NUMBER(section, key, field, fallback, range, ...) \
  TILLER_ENTRY(section, key, number, field, 1, fallback, range)
#define TILLER_FLAG(section, key, field, fallback, ...) TILLER_ENTRY(section, key, flag, field, 1, fallback, {0, 1})
#define TILLER_CHOICE(section, key, field, words, fallback, last, ...) \
  TILLER_ENTRY(section, key, choice, field, 1, fallback, {0, double(last)})
#define TILLER_STATES(section, key, field, fallback, range, ...) \
  TILLER_ENTRY(section, key, states, field, 1, fallback, range)
#define TILLER_INPUTS(section, key, field, fallback, range, ...) \
  TILLER_ENTRY(section, key, inputs, field, 1, fallback, range)
constexpr ConfigField kFields[] = {
#include "tiller/config.def"
};
#undef TILLER_ENTRY

std::uint32_t capacity(FieldKind kind) {
  return kind == FieldKind::states ? TILLER_MAX_STATES : kind == FieldKind::inputs ? TILLER_MAX_INPUTS : 1;
}

bool is_whole(FieldKind kind) {
  return kind == FieldKind::count || kind == FieldKind::flag || kind == FieldKind::choice;
}

}  // namespace

ConfigFields config_fields() { return {kFields, kFields + sizeof kFields / sizeof kFields[0]}; }

double config_value(const tiller_config_t& config, const ConfigField& field, std::uint32_t index) {
  const char* const at = reinterpret_cast<const char*>(&config) + field.offset;
  if (is_whole(field.kind)) return *reinterpret_cast<const std::uint32_t*>(at);
  return reinterpret_cast<const double*>(at)[index];
}

void set_config_value(tiller_config_t& config, const ConfigField& field, std::uint32_t index, double value) {
  char* const at = reinterpret_cast<char*>(&config) + field.offset;
  if (is_whole(field.kind))
    *reinterpret_cast<std::uint32_t*>(at) = static_cast<std::uint32_t>(value);
  else
    reinterpret_cast<double*>(at)[index] = value;
}

void set_defaults(tiller_config_t& config) {
  for (const ConfigField& field : config_fields())
    for (std::uint32_t i = 0; i < capacity(field.kind); ++i) set_config_value(config, field, i, field.fallback);
}

const char* out_of_range(const tiller_config_t& config, FieldGroup group) {
  for (const ConfigField& field : config_fields()) {
    if (field.group != group) continue;
    const std::uint32_t count = field.kind == FieldKind::states   ? config.model->state_count
                                : field.kind == FieldKind::inputs ? config.model->input_count
                                                                  : 1;
    for (std::uint32_t i = 0; i < count; ++i) {
      const double value = config_value(config, field, i);
      if (!field.range.holds(value)) return field.name(i);
      if (field.multiple > 1 && static_cast<std::uint32_t>(value) % field.multiple != 0) return field.name(i);
    }
  }
  return nullptr;
}

}  // namespace tiller
