#include "tools/robot/effects_text.hpp"

#include <algorithm>
#include <cmath>

#include "effects/effect_info.hpp"
#include "tools/base/text.hpp"

namespace tiller::tools {
namespace {

std::string bounds_text(const EffectParam& p) {
  const bool low = std::isfinite(p.low), high = std::isfinite(p.high);
  if (low && high) return number_text(p.low) + " .. " + number_text(p.high);
  return low ? ">= " + number_text(p.low) : high ? "<= " + number_text(p.high) : "any sign";
}

/// A vertical line would end the table's cell.
std::string cell(const char* text) {
  std::string escaped;
  for (const char* c = text; *c; ++c) escaped += *c == '|' ? std::string("\\|") : std::string(1, *c);
  return escaped;
}

std::string port_text(const EffectInfo& info) {
  std::string text = port_kind_name(info.port);
  if (info.port == PortKind::input && info.needs_drive) text += " that drives a joint";
  if (info.port == PortKind::joint && info.needs_drive) text += " with a drive";
  if (info.needs_position)
    text += info.needs_drive && info.port == PortKind::joint ? " and a position" : " with a position";
  return text;
}

template <std::size_t N>
Words names_of(const char* const (&list)[N]) {
  Words names;
  for (const char* name : list)
    if (name) names.push_back("`" + std::string(name) + "`");
  return names;
}

void add_rows(std::string& text, PortKind port) {
  for (std::uint32_t kind = 0; kind < effect_kind_count(); ++kind) {
    const EffectInfo& info = effect_info(kind);
    if (info.port != port) continue;
    text += "| `" + std::string(info.name) + "` | " + port_text(info) + " | ";
    for (int i = 0; i < info.param_count; ++i) {
      const EffectParam& p = info.params[i];
      text += std::string(i ? "<br>" : "") + "`" + p.name + "` (" + p.unit + "), " + bounds_text(p);
    }
    text += " | " + std::to_string(info.state_count) + " | " + cell(info.help) + " | " + cell(info.equation) + " |\n";
  }
}

}  // namespace

std::string effects_markdown() {
  std::string text = "| kind | port | parameters | states | what | equation |\n|---|---|---|---|---|---|\n";
  for (int port = 0; port < kPortKinds; ++port) add_rows(text, static_cast<PortKind>(port));
  text += "\n| kind | contains | easily taken for | what tells them apart | source |\n|---|---|---|---|---|\n";
  for (std::uint32_t kind = 0; kind < effect_kind_count(); ++kind) {
    const EffectInfo& info = effect_info(kind);
    text += "| `" + std::string(info.name) + "` | " + join(names_of(info.contains)) + " | " +
            join(names_of(info.aliases)) + " | " + cell(info.separation ? info.separation : "") + " | " +
            cell(info.source ? info.source : "") + " |\n";
  }
  return text;
}

std::string effects_help() {
  std::string text;
  for (std::uint32_t kind = 0; kind < effect_kind_count(); ++kind) {
    const EffectInfo& info = effect_info(kind);
    std::string name = info.name;
    name.resize(std::max<std::size_t>(name.size(), 20), ' ');
    text += name + " port: " + port_text(info) + "   parameters:";
    for (int i = 0; i < info.param_count; ++i)
      text += std::string(i ? "; " : " ") + info.params[i].name + " (" + info.params[i].unit + ", " +
              bounds_text(info.params[i]) + ")";
    text += "\n  " + std::string(info.help) + ": " + info.equation + "\n";
  }
  return text;
}

}  // namespace tiller::tools
