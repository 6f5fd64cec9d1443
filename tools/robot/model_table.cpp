// A table from outside: its numbers, its names and what lies behind its pointers.
#include "tools/robot/model_table.hpp"

#include <algorithm>
#include <cctype>
#include <cstddef>
#include <cstring>
#include <map>
#include <set>

#include "tools/base/text.hpp"
#include "tools/robot/model_loader.hpp"
#include "tools/robot/object_memory.hpp"

namespace tiller::tools {
namespace {

std::string check_count(const char* what, std::uint32_t count, std::uint32_t low, std::uint32_t high) {
  if (count >= low && count <= high) return "";
  return std::string(what) + " is " + std::to_string(count) + "; allowed: " + std::to_string(low) + " to " +
         std::to_string(high);
}

/// What stands in robot files, in the heads of logs and in formulas of figures.
bool is_name(const std::string& text) {
  return std::all_of(text.begin(), text.end(),
                     [](unsigned char c) { return std::isalnum(c) || std::strchr("_.-/", c); });
}

class TableCheck {
 public:
  TableCheck(const tiller_model_t& model, const ObjectMemory& memory) : model_(model), memory_(memory) {}

  std::string problem() {
    using Part = std::string (TableCheck::*)();
    for (const Part part : {&TableCheck::counts, &TableCheck::names, &TableCheck::joints, &TableCheck::functions}) {
      const std::string found = (this->*part)();
      if (!found.empty()) return found;
    }
    return "";
  }

 private:
  // before the names, whose arrays are read as far as the counts say
  std::string counts() {
    for (const std::string& found : {check_count("state_count", model_.state_count, 1, TILLER_MAX_STATES),
                                     check_count("input_count", model_.input_count, 1, TILLER_MAX_INPUTS),
                                     check_count("param_count", model_.param_count, 0, TILLER_MAX_PARAMS),
                                     check_count("joint_count", model_.joint_count, 0, TILLER_MAX_JOINTS),
                                     check_count("output_count", model_.output_count, 0, TILLER_MAX_OUTPUTS)})
      if (!found.empty()) return found;
    return "";
  }

  std::string names() {
    const struct {
      const char *what, *count_name;
      const char* const* names;
      std::uint32_t count;
      bool apart;  // a column of logs or a key of its own, or both
    } lists[] = {{"state_names", "state_count", model_.state_names, model_.state_count, true},
                 {"input_names", "input_count", model_.input_names, model_.input_count, true},
                 {"param_names", "param_count", model_.param_names, model_.param_count, true},
                 {"force_names", "joint_count", model_.force_names, model_.joint_count, false},
                 {"output_names", "output_count", model_.output_names, model_.output_count, false}};
    std::map<std::string, std::string> seen;  // name, and the list that has it
    for (const auto& list : lists) {
      std::string found = check_room(list.what, list.count_name, list.names, list.count, sizeof(char*));
      std::set<std::string> own;
      for (std::uint32_t i = 0; found.empty() && i < list.count; ++i) {
        std::string name;
        found = read_name(list.what + ("[" + std::to_string(i) + "]"), list.names + i, name);
        if (!found.empty()) break;
        if (!own.insert(name).second) return std::string(list.what) + " has '" + name + "' twice";
        if (list.apart && !seen.emplace(name, list.what).second)
          return "'" + name + "' stands in " + seen[name] + " and in " + list.what +
                 "; rename one, or make the counts agree with the lengths of these arrays";
      }
      if (!found.empty()) return found;
    }
    return "";
  }

  /// Whether `count` elements stand there, as far as one can know.
  std::string check_room(const std::string& what, const char* count_name, const void* array, std::uint32_t count,
                         std::size_t element) const {
    if (count == 0) return "";
    if (!array) return what + " is null";
    const std::size_t there = memory_.room(array) / element;
    if (there >= count) return "";
    return std::string(count_name) + " is " + std::to_string(count) + " and " + what + " has " + std::to_string(there) +
           (there == 1 ? " element" : " elements") + "; make them agree";
  }

  std::string read_name(const std::string& what, const char* const* from, std::string& name) const {
    const char* pointer = nullptr;
    if (!memory_.copy(from, sizeof pointer, &pointer)) return what + " lies beyond what can be read";
    if (!pointer) return what + " is null: it has no name";
    if (!memory_.text(pointer, name)) return what + " points to no text";
    if (name.empty()) return what + " has no name";
    if (!is_name(name)) return what + " is no name: letters, digits and _ . - / may stand in it";
    return "";
  }

  std::string joints() {
    std::string found = check_room("joints", "joint_count", model_.joints, model_.joint_count, sizeof(tiller_joint_t));
    for (std::uint32_t i = 0; found.empty() && i < model_.joint_count; ++i) {
      const std::string who = "joints[" + std::to_string(i) + "]";
      tiller_joint_t joint;
      if (!memory_.copy(model_.joints + i, sizeof joint, &joint)) return who + " lies beyond what can be read";
      std::string name;
      found = read_name(who + ".name", &model_.joints[i].name, name);
      const auto outside = [&](const char* field, unsigned index, std::uint32_t count, const char* of) {
        if (found.empty() && index >= count)
          found = who + "." + field + " is " + std::to_string(index) + ", no index of " + of + " (0 to " +
                  std::to_string(count - 1) + ")";
      };
      if (joint.position != TILLER_NO_POSITION) outside("position", joint.position, model_.state_count, "a state");
      outside("velocity", joint.velocity, model_.state_count, "a state");
      outside("force", joint.force, model_.joint_count, "a force");
      if (found.empty() && joint.drive > model_.input_count)
        found = who + ".drive is " + std::to_string(joint.drive) + ", no input: they count from 1 to " +
                std::to_string(model_.input_count) + " here, and 0 says that none drives the joint";
    }
    return found;
  }

  std::string functions() {
    if (!model_.dynamics && !model_.kernels) return "the table has no dynamics";
    if (model_.output_count > 0 && !model_.outputs)
      return "output_count is " + std::to_string(model_.output_count) + " and outputs is null";
    const struct {
      const char* what;
      std::uint32_t bits;
    } masks[] = {{"angle_mask", model_.angle_mask}, {"quaternion_mask", model_.quaternion_mask}};
    for (const auto& mask : masks)
      if (model_.state_count < 32 && mask.bits >> model_.state_count)
        return std::string(mask.what) + " has bits beyond the " + std::to_string(model_.state_count) +
               " states; bit i stands for state i";
    return "";
  }

  const tiller_model_t& model_;
  const ObjectMemory& memory_;
};

}  // namespace

// Counts, names, joints, and the lengths of their arrays as far as the object's symbol table tells them; then, of a
// table without kernels, its functions: a template's cannot miss its arrays.
std::string check_model_table(const tiller_model_t* model) {
  if (!model) return "tiller_model() returned null";
  const ObjectMemory memory(model);
  struct {
    std::uint32_t size, version;
  } head;
  static_assert(offsetof(tiller_model_t, size) == 0 && offsetof(tiller_model_t, version) == sizeof head.size, "head");
  if (!memory.copy(model, sizeof head, &head)) return "tiller_model() returned no address of a table";
  if (head.size != sizeof(tiller_model_t) || head.version != TILLER_MODEL_VERSION)
    return "the table's size or version is not this tiller's; set size = sizeof(tiller_model_t) and version = "
           "TILLER_MODEL_VERSION, and compile against these headers";
  std::string name;
  if (!model->name || !memory.text(model->name, name) || name.empty()) return "the table has no name";
  std::string problem = TableCheck(*model, memory).problem();
  if (problem.empty() && !model->kernels) problem = check_model_functions(*model);
  return problem.empty() ? "" : "model '" + name + "': " + problem;
}

}  // namespace tiller::tools
