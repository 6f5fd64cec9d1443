#include "tools/robot/section_reader.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>

namespace tiller::tools {
namespace {

/// The allowed values in words: "a number above 0 and at most 10".
std::string number_remedy(const char* what, const KeySpec& spec) {
  const bool low = std::isfinite(spec.low);
  const bool high = std::isfinite(spec.high);
  const std::string from = (spec.low_open ? "above " : "at least ") + number_text(spec.low);
  const std::string write = std::string("write a ") + what;
  const std::string gap = spec.least > 0      ? ", but for 0 not below " + number_text(spec.least)
                          : spec.multiple > 1 ? ", a multiple of " + std::to_string(spec.multiple)
                                              : "";
  if (low && high) return write + " " + from + " and at most " + number_text(spec.high) + gap;
  if (low) return write + " " + from + gap;
  return high ? write + " at most " + number_text(spec.high) : std::string("write a finite ") + what;
}

/// A number that limits something, and may be left out.
bool is_limit(const KeySpec& spec) {
  return std::isinf(spec.high) || (spec.fallback && std::strcmp(spec.fallback, "none") == 0);
}

bool in_range(const KeySpec& spec, double value) {
  if (value != 0 && std::fabs(value) < spec.least) return false;
  return (spec.low_open ? value > spec.low : value >= spec.low) && value <= spec.high;
}

template <class T>
void store(tiller_config_t& config, int offset, std::size_t index, T value) {
  std::memcpy(reinterpret_cast<char*>(&config) + offset + index * sizeof(T), &value, sizeof(T));
}

double* numbers_at(tiller_config_t& config, int offset) {
  return reinterpret_cast<double*>(reinterpret_cast<char*>(&config) + offset);
}

}  // namespace

std::string kind_text(const toml::node& node) {
  switch (node.type()) {
    case toml::node_type::string: return "a string";
    case toml::node_type::integer: return "a whole number";
    case toml::node_type::floating_point: return "a number";
    case toml::node_type::boolean: return "true or false";
    case toml::node_type::array: return "a list";
    case toml::node_type::table: return "a table";
    default: return "a date or time";
  }
}

std::string remedy_for_unknown(const std::string& word, const Words& known) {
  const std::string near = nearest(word, known);
  return (near.empty() ? "" : "did you mean " + near + "? ") + "known: " + join(known);
}

std::optional<double> checked_number(FileErrors& errors, const toml::node& node, const std::string& path,
                                     const KeySpec& spec) {
  if (!node.is_number()) {
    errors.at(node, path, "is " + kind_text(node), number_remedy("number", spec) + ", without quotes");
    return std::nullopt;
  }
  const double value = *node.value<double>();
  if (std::isnan(value)) {
    errors.at(node, path, "is not a number", number_remedy("number", spec));
    return std::nullopt;
  }
  if (std::isinf(value)) {
    errors.at(node, path, "is infinite",
              is_limit(spec) ? "leave the key out where there is no limit" : number_remedy("number", spec));
    return std::nullopt;
  }
  if (!in_range(spec, value)) {
    errors.at(node, path, "is out of range", number_remedy("number", spec));
    return std::nullopt;
  }
  return value;
}

const KeySpec& SectionReader::spec(const std::string& key) const {
  const KeySpec* found = find_key(schema_, key);
  if (!found) std::abort();  // a reader asks for a key that the schema does not list: our own mistake
  return *found;
}

std::optional<double> SectionReader::number(const std::string& key) {
  const KeySpec& entry = spec(key);
  const toml::node* value = node(key);
  if (!value) return std::nullopt;
  return checked_number(*errors_, *value, path_of(key), entry);
}

std::optional<std::int64_t> SectionReader::count(const std::string& key) {
  const KeySpec& entry = spec(key);
  const toml::node* value = node(key);
  if (!value) return std::nullopt;
  if (!value->is_integer()) {
    error(key, "is " + kind_text(*value), number_remedy("whole number", entry));
    return std::nullopt;
  }
  const std::int64_t whole = *value->value<std::int64_t>();
  if (!in_range(entry, static_cast<double>(whole))) {
    error(key, "is out of range", number_remedy("whole number", entry));
    return std::nullopt;
  }
  if (whole % entry.multiple != 0) {
    error(key, "is not a multiple of " + std::to_string(entry.multiple), number_remedy("whole number", entry));
    return std::nullopt;
  }
  return whole;
}

std::optional<bool> SectionReader::flag(const std::string& key) {
  (void)spec(key);
  const toml::node* value = node(key);
  if (!value) return std::nullopt;
  if (!value->is_boolean()) {
    error(key, "is " + kind_text(*value), "write true or false");
    return std::nullopt;
  }
  return value->value<bool>();
}

std::optional<std::string> SectionReader::text(const std::string& key) {
  (void)spec(key);
  const toml::node* value = node(key);
  if (!value) return std::nullopt;
  if (!value->is_string()) {
    error(key, "is " + kind_text(*value), "write a text in quotes");
    return std::nullopt;
  }
  std::string found = *value->value<std::string>();
  if (found.empty()) {
    error(key, "is empty", "write a text in quotes, or leave the key out");
    return std::nullopt;
  }
  return found;
}

std::optional<std::uint32_t> SectionReader::choice(const std::string& key) {
  const Words known = spec(key).choices();
  const std::optional<std::string> word = text(key);
  if (!word) return std::nullopt;
  const auto found = std::find(known.begin(), known.end(), *word);
  if (found == known.end()) {
    error(key, "is not known", remedy_for_unknown(*word, known));
    return std::nullopt;
  }
  return static_cast<std::uint32_t>(found - known.begin());
}

const toml::table* SectionReader::subtable(const std::string& key) {
  const toml::node* value = node(key);
  if (!value) return nullptr;
  if (!value->is_table()) error(key, "is " + kind_text(*value), "write a table: { name = value, ... }");
  return value->as_table();
}

void SectionReader::numbers(const std::string& key, const Words& names, const char* what, double* out) {
  const KeySpec& entry = spec(key);
  const toml::table* table = subtable(key);
  if (!table) return;
  for (auto&& [name, value] : *table) {
    const std::string word(name.str());
    const auto found = std::find(names.begin(), names.end(), word);
    if (found == names.end()) {
      errors_->at(value, path_of(key) + "." + word, std::string("the model has no ") + what + " of that name",
                  remedy_for_unknown(word, names));
      continue;
    }
    if (const auto read = checked_number(*errors_, value, path_of(key) + "." + word, entry)) {
      out[found - names.begin()] = *read;
    }
  }
}

void SectionReader::missing(const std::string& key, std::string remedy) {
  errors_->missing(table_, path_of(key), std::move(remedy));
}

void SectionReader::error(const std::string& key, std::string problem, std::string remedy) {
  if (const toml::node* value = node(key)) {
    errors_->at(*value, path_of(key), std::move(problem), std::move(remedy));
  } else {
    errors_->missing(table_, path_of(key), std::move(remedy));
  }
}

bool SectionReader::in_order(const std::string& low_key, std::optional<double> low, const std::string& high_key,
                             std::optional<double> high) {
  if (!low || !high || *low < *high) return true;
  const std::string smaller = number_text(*high), larger = number_text(*low);
  if (*low == *high)
    error(low_key, low_key + " and " + high_key + " are both " + smaller + ", which leaves nothing between them",
          "write two numbers, the smaller one as " + low_key);
  else
    error(low_key, "is reversed: " + low_key + " = " + larger + " is above " + high_key + " = " + smaller,
          "write " + low_key + " = " + smaller + ", " + high_key + " = " + larger);
  return false;
}

void SectionReader::read_bound(tiller_config_t& config, const Words& states, const Words& inputs) {
  for (const KeySpec& entry : robot_keys()) {
    if (schema_ != entry.section || entry.offset < 0 || !has(entry.key)) continue;
    switch (entry.kind) {
      case KeyKind::flag:
        if (const auto v = flag(entry.key)) store<std::uint32_t>(config, entry.offset, 0, *v ? 1 : 0);
        break;
      case KeyKind::count:
        if (const auto v = count(entry.key)) store(config, entry.offset, 0, static_cast<std::uint32_t>(*v));
        break;
      case KeyKind::choice:
        if (const auto v = choice(entry.key)) store(config, entry.offset, 0, *v);
        break;
      case KeyKind::number:
        if (const auto v = number(entry.key)) store(config, entry.offset, 0, *v);
        break;
      case KeyKind::state_numbers: numbers(entry.key, states, "state", numbers_at(config, entry.offset)); break;
      case KeyKind::input_numbers: numbers(entry.key, inputs, "input", numbers_at(config, entry.offset)); break;
      default: std::abort();  // only these kinds have a place in the configuration
    }
  }
}

Words SectionReader::refuse_unknown(const Words& also) {
  Words meant;
  if (!table_) return meant;
  Words known = keys_of(schema_);
  known.insert(known.end(), also.begin(), also.end());
  for (auto&& [name, value] : *table_) {
    const std::string word(name.str());
    if (std::find(known.begin(), known.end(), word) != known.end()) continue;
    if (const char* now = renamed_key(schema_, word)) {
      errors_->at(value, path_of(word), std::string("is called ") + now + " now", std::string("write ") + now);
      meant.emplace_back(now);
      continue;
    }
    if (const char* why = removed_key(schema_, word)) {
      errors_->at(value, path_of(word), std::string("is no key any more: ") + why, "delete the line");
      meant.emplace_back();
      continue;
    }
    errors_->at(value, path_of(word), "unknown key", remedy_for_unknown(word, known));
    meant.push_back(nearest(word, known));
  }
  return meant;
}

}  // namespace tiller::tools
