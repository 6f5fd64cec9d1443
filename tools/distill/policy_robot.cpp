#include <cstddef>

#include "tools/base/toml.hpp"
#include "tools/distill/distill.hpp"

namespace tiller::tools::distill {
namespace {

/// Byte at which a position stands; columns count code points.
std::size_t offset_of(const std::string& text, const toml::source_position& at) {
  std::size_t offset = 0;
  for (toml::source_index line = 1; line < at.line; ++line) offset = text.find('\n', offset) + 1;
  for (toml::source_index column = 1; column < at.column && offset < text.size(); ++column) {
    ++offset;
    while (offset < text.size() && (static_cast<unsigned char>(text[offset]) & 0xC0u) == 0x80u) ++offset;
  }
  return offset;
}

std::string quoted(const std::string& value) {
  std::string text = "\"";
  for (const char c : value) text += c == '"' || c == '\\' ? std::string("\\") + c : std::string(1, c);
  return text + "\"";
}

/// Writes `value` as the string at section.key; a section or key that is not there yet is added.
bool set_word(std::string& text, const std::string& section, const std::string& key, const std::string& value,
              std::string& error) {
  const toml::table root = toml::parse(text);
  const toml::node* there = root.get(section);
  if (!there) {
    text += "\n[" + section + "]\n" + key + " = " + quoted(value) + "\n";
    return true;
  }
  const toml::table* table = there->as_table();
  if (!table || table->is_inline()) {
    error = section + " is no section of its own; write it as [" + section + "] with a line a key";
    return false;
  }
  if (const toml::node* old = table->get(key)) {
    const std::size_t from = offset_of(text, old->source().begin), to = offset_of(text, old->source().end);
    text.replace(from, to - from, quoted(value));
    return true;
  }
  std::size_t line_end = text.find('\n', offset_of(text, table->source().begin));
  if (line_end == std::string::npos) line_end = text.size();
  text.insert(line_end, "\n" + key + " = " + quoted(value));
  return true;
}

}  // namespace

bool policy_robot_text(const std::string& text, const std::string& teacher, const std::string& file, std::string& out,
                       std::string& error) {
  out = text;
  return set_word(out, "planner", "kind", "policy", error) && set_word(out, "planner", "fallback", teacher, error) &&
         set_word(out, "policy", "file", file, error);
}

}  // namespace tiller::tools::distill
