// [[safety.cones]]: norms of inputs and what limits them.

#include "core/input_cone.hpp"
#include "tiller/config.hpp"
#include "tools/robot/robot_sections.hpp"

namespace tiller::tools {
namespace {

/// The inputs that the key names, as a set; 0 after an error.
std::uint32_t read_norm(SectionReader& cone, const Words& inputs) {
  const char* const remedy = "write inputs = [\"..\", \"..\"], the inputs whose norm is limited";
  if (!cone.has("inputs")) cone.missing("inputs", remedy);
  const toml::node* node = cone.node("inputs");
  if (!node) return 0;
  const toml::array* list = node->as_array();
  if (!list || list->empty()) {
    cone.error("inputs", list ? "names no input" : "is " + kind_text(*node), remedy);
    return 0;
  }
  std::uint32_t norm = 0;
  for (const toml::node& element : *list) {
    const auto name = element.value<std::string>();
    if (!element.is_string()) {
      cone.errors().at(element, cone.path_of("inputs"), "holds " + kind_text(element), remedy);
      return 0;
    }
    const int input = index_of(inputs, *name);
    if (input < 0) {
      cone.errors().at(element, cone.path_of("inputs"), "the model has no input of that name",
                       remedy_for_unknown(*name, inputs));
      return 0;
    }
    const std::uint32_t bit = 1u << input;
    if ((norm & bit) != 0) {
      cone.errors().at(element, cone.path_of("inputs"), "names " + *name + " twice", "name every input once");
      return 0;
    }
    norm |= bit;
  }
  return norm;
}

/// The axis, which goes with a slope; 0 where there is none.
std::uint32_t read_axis(SectionReader& cone, const Words& inputs) {
  const auto name = cone.text("axis");
  if (cone.has("slope") && !cone.has("axis"))
    cone.missing("axis", "write the input that the slope is of: " + join(inputs));
  if (cone.has("axis") && !cone.has("slope"))
    cone.missing("slope", "write slope = what the limit grows by for each unit of the axis, or leave axis out");
  if (!name) return 0;
  const int input = index_of(inputs, *name);
  if (input < 0) cone.error("axis", "the model has no input of that name", remedy_for_unknown(*name, inputs));
  return input < 0 ? 0 : static_cast<std::uint32_t>(input);
}

void read_cone(FileErrors& errors, const toml::table& table, std::size_t index, RobotFile& robot) {
  SectionReader section(errors, "safety.cones[]", "safety.cones[" + std::to_string(index) + "]", &table);
  const std::size_t before = errors.list().size();
  section.refuse_unknown();
  tiller_input_cone_t cone = {};
  cone.inputs = read_norm(section, robot.names.inputs);
  cone.axis = read_axis(section, robot.names.inputs);
  cone.slope = section.number("slope").value_or(0.0);
  cone.limit = section.number("limit").value_or(0.0);
  if (!section.has("slope") && !section.has("limit"))
    section.missing("limit", "write limit = the largest norm, or axis and slope, or all three");
  if (errors.list().size() != before) return;
  if (cone.slope > 0.0 && ((cone.inputs >> cone.axis) & 1u) != 0) {
    section.error("axis", "stands in the cone's own norm", "name an input that is not among inputs");
  } else if (!(cone.slope > 0.0) && !(cone.limit > 0.0)) {
    section.error(section.has("limit") ? "limit" : "slope", "leaves the inputs nothing but 0",
                  "write a limit above 0, or a slope above 0 with its axis");
  } else if (index <= TILLER_MAX_INPUT_CONES) {
    robot.config.cones[robot.config.safety.cone_count++] = cone;
  }
}

/// How a cone goes together with [limits] and the others.
void check_fit(const toml::table& table, std::size_t index, FileErrors& errors, const tiller_input_cone_t& cone,
               std::uint32_t norms, const RobotFile& robot) {
  SectionReader section(errors, "safety.cones[]", "safety.cones[" + std::to_string(index) + "]", &table);
  const tiller_safety_config_t& s = robot.config.safety;
  const bool sloped = cone.slope > 0.0;
  if (sloped && ((norms >> cone.axis) & 1u) != 0)
    section.error("axis", "stands in another cone's norm", "name an input that no cone's norm has");
  for (std::size_t i = 0; i < robot.names.inputs.size(); ++i)
    if (((cone.inputs >> i) & 1u) != 0 && !(s.input_low[i] <= 0.0 && s.input_high[i] >= 0.0))
      section.error("inputs", "0 is outside the limits of " + robot.names.inputs[i],
                    "let limits." + robot.names.inputs[i] + " contain 0, or leave the input out of the norm");
  if (sloped && !(cone_radius(cone, s.input_low) >= 0.0))
    section.error("slope",
                  "leaves nothing where " + robot.names.inputs[cone.axis] + " = " + number_text(s.input_low[cone.axis]),
                  "raise limits." + robot.names.inputs[cone.axis] + ".low until limit + slope * low is 0 or more");
  else if (!(cone_norm(cone, s.safe_command) <= cone_radius(cone, s.safe_command)))
    section.error("inputs",
                  "the safe command has a norm of " + number_text(cone_norm(cone, s.safe_command)) + ", beyond " +
                      number_text(cone_radius(cone, s.safe_command)),
                  "write smaller values for safe in [limits]");
}

}  // namespace

void read_cones(FileErrors& errors, const toml::table& root, RobotFile& robot) {
  const toml::node_view<const toml::node> node = root["safety"]["cones"];
  if (!node) return;
  const char* remedy = "head each cone with [[safety.cones]]";
  const toml::array* list = node.as_array();
  if (!list) {
    errors.at(*node.node(), "safety.cones", "is " + kind_text(*node.node()), remedy);
    return;
  }
  const std::size_t before = errors.list().size();
  std::size_t index = 0;
  for (const toml::node& element : *list) {
    ++index;
    if (const toml::table* table = element.as_table())
      read_cone(errors, *table, index, robot);
    else
      errors.at(element, "safety.cones", "is " + kind_text(element), remedy);
  }
  if (index > TILLER_MAX_INPUT_CONES)
    errors.at_table(*node.node(), "safety.cones", "there are " + std::to_string(index),
                    "keep at most " + std::to_string(TILLER_MAX_INPUT_CONES));
  if (errors.list().size() != before) return;
  std::uint32_t norms = 0;
  for (std::uint32_t c = 0; c < robot.config.safety.cone_count; ++c) norms |= robot.config.cones[c].inputs;
  for (std::size_t c = 0; c < index; ++c)
    check_fit(*list->get(c)->as_table(), c + 1, errors, robot.config.cones[c], norms, robot);
}

}  // namespace tiller::tools
