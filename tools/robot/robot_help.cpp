#include "tools/robot/robot_help.hpp"

#include <cmath>
#include <cstdint>
#include <cstring>

#include "tiller/config.hpp"
#include "tools/robot/robot_schema.hpp"

namespace tiller::tools {
namespace {

template <class T>
T field(const tiller_config_t& config, int offset, std::size_t index = 0) {
  T value;
  std::memcpy(&value, reinterpret_cast<const char*>(&config) + offset + index * sizeof(T), sizeof(T));
  return value;
}

/// Default of an array in tiller_config_default: one number, or that it depends on the state or input.
std::string array_default(const tiller_config_t& config, const KeySpec& key, std::size_t count) {
  const double first = field<double>(config, key.offset);
  for (std::size_t i = 1; i < count; ++i) {
    if (field<double>(config, key.offset, i) != first) return "by the model";
  }
  return number_text(first) + (count > 1 ? " each" : "");
}

std::string default_text(const tiller_config_t& config, const tiller_model_t& model, const KeySpec& key) {
  if (key.fallback) return key.fallback;
  switch (key.kind) {
    case KeyKind::flag: return field<std::uint32_t>(config, key.offset) ? "true" : "false";
    case KeyKind::count: return std::to_string(field<std::uint32_t>(config, key.offset));
    case KeyKind::number: return number_text(field<double>(config, key.offset));
    case KeyKind::choice: return key.choices()[field<std::uint32_t>(config, key.offset)];
    case KeyKind::state_numbers: return array_default(config, key, model.state_count);
    case KeyKind::input_numbers: return array_default(config, key, model.input_count);
    default: return "";
  }
}

/// Defaults are those of the first built-in model.
std::string fallback_of(const KeySpec& key) {
  const tiller_model_t* model = tiller_builtin_model(0);
  Config config;
  if (key.fallback || !model || tiller_config_default(&config, model) != tiller_status_ok) {
    return key.fallback ? key.fallback : "";
  }
  return default_text(config, *model, key);
}

std::string type_text(const KeySpec& key) {
  switch (key.kind) {
    case KeyKind::text: return "text";
    case KeyKind::flag: return "true or false";
    case KeyKind::count: return "whole number";
    case KeyKind::number: return "number";
    case KeyKind::choice: return "one of " + join(key.choices());
    case KeyKind::state_numbers: return "{ state = number }";
    case KeyKind::input_numbers: return "{ input = number }";
    default: return key.choices ? "one of " + join(key.choices()) : "";
  }
}

std::string range_text(const KeySpec& key) {
  const bool numeric = key.kind == KeyKind::count || key.kind == KeyKind::number ||
                       key.kind == KeyKind::state_numbers || key.kind == KeyKind::input_numbers;
  if (!numeric) return "";
  const bool low = std::fabs(key.low) < TILLER_LARGEST_VALUE;  // wider bounds only keep squares finite
  const bool high = std::fabs(key.high) < TILLER_LARGEST_VALUE;
  if (low && !high && key.least > 0) return "0 or >= " + number_text(key.least);
  if (low && high) return number_text(key.low) + (key.low_open ? " < .. " : " .. ") + number_text(key.high);
  if (low) return (key.low_open ? "> " : ">= ") + number_text(key.low);
  return high ? "<= " + number_text(key.high) : "";
}

std::string help_text(const KeySpec& key) { return (key.readers ? std::string(key.readers) + ": " : "") + key.help; }

std::string joined(const Words& parts, const char* separator) {
  std::string text;
  for (const std::string& part : parts) {
    if (!part.empty()) text += (text.empty() ? "" : separator) + part;
  }
  return text;
}

std::string wrapped(const std::string& text, const std::string& indent, std::size_t width) {
  std::string out;
  std::size_t column = width;
  std::size_t from = 0;
  while (from < text.size()) {
    const std::size_t space = text.find(' ', from);
    const std::size_t end = space == std::string::npos ? text.size() : space;
    if (column + end - from + 1 > width) {
      out += (out.empty() ? "" : "\n") + indent;
      column = indent.size();
    } else {
      out += ' ';
      ++column;
    }
    out += text.substr(from, end - from);
    column += end - from;
    from = end + 1;
  }
  return out + "\n";
}

std::string escaped(std::string text) {
  for (std::size_t at = 0; (at = text.find('|', at)) != std::string::npos; at += 2) text.insert(at, "\\");
  return text;
}

}  // namespace

std::string robot_file_help() {
  std::string text =
      "A robot file is TOML: sections in [brackets], keys below them. Units are SI; names carry them. \"required\"\n"
      "keys have no default. Unknown keys are refused.\n";
  for (const SectionSpec& section : robot_sections()) {
    text += "\n" + std::string(section.header) + "\n" + wrapped(section.help, "  ", 100);
    for (const KeySpec& key : robot_keys()) {
      if (std::string(key.section) != section.name) continue;
      const std::string fallback = fallback_of(key);
      text +=
          "    " + std::string(key.key) + "   " +
          joined({type_text(key), key.unit, range_text(key), fallback == kRequired ? fallback : "default " + fallback},
                 ", ") +
          "\n" + wrapped(help_text(key), "        ", 100);
    }
  }
  return text;
}

std::string robot_file_markdown() {
  std::string text;
  for (const SectionSpec& section : robot_sections()) {
    const std::string header = section.header;
    text += "### " + (header[0] == '[' ? "`" + header + "`" : header) + "\n\n" + section.help + "\n";
    std::string rows;
    for (const KeySpec& key : robot_keys()) {
      if (std::string(key.section) != section.name) continue;
      rows += "| `" + std::string(key.key) + "` | " + escaped(type_text(key)) + " | " + key.unit + " | " +
              range_text(key) + " | " + escaped(fallback_of(key)) + " | " + escaped(help_text(key)) + " |\n";
    }
    if (!rows.empty())
      text += "\n| key | value | unit | range | default | meaning |\n|---|---|---|---|---|---|\n" + rows;
    text += "\n";
  }
  return text;
}

}  // namespace tiller::tools
