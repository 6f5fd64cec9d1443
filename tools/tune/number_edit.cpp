#include "tools/tune/number_edit.hpp"

#include <algorithm>
#include <cctype>

namespace tiller::tools::tune {
namespace {

// Columns of toml++ count code points.
std::size_t offset_of(const std::string& text, const toml::source_position& at) {
  std::size_t offset = 0;
  for (toml::source_index line = 1; line < at.line; ++line) offset = text.find('\n', offset) + 1;
  for (toml::source_index column = 1; column < at.column && offset < text.size(); ++column) {
    ++offset;
    while (offset < text.size() && (static_cast<unsigned char>(text[offset]) & 0xC0u) == 0x80u) ++offset;
  }
  return offset;
}

const toml::node* step_into(const toml::node& node, const std::string& step) {
  if (const toml::table* table = node.as_table()) return table->get(step);
  const bool digits = !step.empty() && step.size() < 6 &&
                      std::all_of(step.begin(), step.end(), [](unsigned char c) { return std::isdigit(c) != 0; });
  const toml::array* list = node.as_array();
  return list && digits ? list->get(std::stoul(step)) : nullptr;
}

Words steps_below(const toml::node& node) {
  Words steps;
  if (const toml::table* table = node.as_table())
    for (auto&& [key, value] : *table) steps.emplace_back(key.str());
  if (const toml::array* list = node.as_array())
    for (std::size_t i = 0; i < list->size(); ++i) steps.push_back(std::to_string(i));
  return steps;
}

// A table of a single number stands for it.
const toml::node* only_number(const toml::node* node) {
  const toml::table* table = node->as_table();
  return table && table->size() == 1 && table->begin()->second.is_number() ? &table->begin()->second : node;
}

}  // namespace

Words split_path(const std::string& path) {
  Words steps(1);
  for (const char c : path) {
    if (c == '.')
      steps.emplace_back();
    else
      steps.back() += c;
  }
  return steps;
}

bool find_number(const std::string& text, const std::string& path, NumberAt& found, std::string& error) {
  const toml::table root = toml::parse(text);
  const toml::node* node = &root;
  std::string so_far;
  for (const std::string& step : split_path(path)) {
    const toml::node* next = step_into(*node, step);
    if (!next) {
      const Words known = steps_below(*node);
      const std::string near = nearest(step, known);
      error = "the file has no '" + step + "'" + (so_far.empty() ? "" : " in " + so_far) + "; " +
              (near.empty() ? "" : "did you mean " + near + "? ") + "there: " + join(known);
      return false;
    }
    node = next;
    so_far += (so_far.empty() ? "" : ".") + step;
  }
  node = only_number(node);
  if (!node->is_number()) {
    Words below = steps_below(*node);
    for (std::string& step : below) step = path + "." + step;
    error = below.empty() ? path + " is no number in the file; name one that is"
                          : path + " holds several values; name one: " + join(below);
    return false;
  }
  found.value = *node->value<double>();
  found.from = offset_of(text, node->source().begin);
  found.to = offset_of(text, node->source().end);
  return true;
}

bool set_number(std::string& text, const std::string& path, const std::string& value, std::string& error) {
  NumberAt at;
  if (find_number(text, path, at, error)) {
    text.replace(at.from, at.to - at.from, value);
    return true;
  }
  const Words steps = split_path(path);
  const toml::table root = toml::parse(text);
  const toml::table* section = root[steps[0]].as_table();
  if (steps.size() != 2 || !section || section->contains(steps[1])) return false;
  std::size_t line_end = text.find('\n', offset_of(text, section->source().begin));
  if (line_end == std::string::npos) line_end = text.size();
  text.insert(line_end, "\n" + steps[1] + " = " + value);
  error.clear();
  return find_number(text, path, at, error);
}

}  // namespace tiller::tools::tune
