// [realtime]: what a run by the wall clock asks of the operating system.
#include "tools/robot/robot_sections.hpp"

namespace tiller::tools {
namespace {

constexpr std::int64_t kMostCpu = 63;

/// A list of processors, as numbers.
void read_cpus(SectionReader& section, RealtimeSection& realtime) {
  const toml::node* node = section.node("cpus");
  if (!node) return;
  const char* remedy = "write a list of processors, [2, 3], each 0 .. 63";
  const toml::array* list = node->as_array();
  if (!list) {
    section.error("cpus", "is " + kind_text(*node), remedy);
    return;
  }
  for (const toml::node& element : *list) {
    const auto cpu = element.value_exact<std::int64_t>();
    if (!cpu || *cpu < 0 || *cpu > kMostCpu) {
      section.errors().at(element, section.path_of("cpus"),
                          cpu ? "there is no processor " + std::to_string(*cpu) : "holds " + kind_text(element),
                          remedy);
    } else {
      realtime.cpus |= std::uint64_t{1} << *cpu;
    }
  }
}

}  // namespace

void read_realtime(FileErrors& errors, const toml::table& root, RobotFile& robot) {
  const toml::table* table = section_table(errors, root, "realtime");
  if (!table) return;
  SectionReader section(errors, "realtime", "realtime", table);
  RealtimeSection& realtime = robot.realtime;
  realtime.line = static_cast<int>(table->source().begin.line);
  section.refuse_unknown();
  if (const auto v = section.choice("pace")) realtime.by_clock = *v == 1;
  if (const auto v = section.count("priority")) realtime.priority = static_cast<int>(*v);
  if (const auto v = section.flag("lock_memory")) realtime.lock_memory = *v;
  if (const auto v = section.count("stack_kB")) realtime.stack_kB = static_cast<std::uint32_t>(*v);
  read_cpus(section, realtime);
}

}  // namespace tiller::tools
