// [figure]: the stick figure that pages draw.

#include <cctype>
#include <cmath>
#include <cstdlib>

#include "tools/robot/robot_sections.hpp"

namespace tiller::tools {
namespace {

constexpr std::size_t kMostLinks = 1000;
constexpr const char* kValueRemedy =
    "write a number, a state, a parameter, or a sum of such: \"0.1 - 2*half_length_m\"";

/// One term of a sum: numbers times at most one name.
class TermReader {
 public:
  explicit TermReader(const std::string& text) : text_(text) {}

  bool read(FigureValue& value, std::string& problem) {
    bool first = true;
    for (skip(); first || at_ < text_.size(); skip(), first = false) {
      double sign = 1.0;
      if (peek() == '+' || peek() == '-') {
        sign = text_[at_++] == '-' ? -1.0 : 1.0;
      } else if (!first) {
        problem = "has '" + text_.substr(at_) + "' where + or - is expected";
        return false;
      }
      FigureTerm term{sign, ""};
      if (!factors(term, problem)) return false;
      value.push_back(term);
    }
    return true;
  }

 private:
  char peek() const { return at_ < text_.size() ? text_[at_] : '\0'; }
  void skip() {
    while (at_ < text_.size() && text_[at_] == ' ') ++at_;
  }

  bool factors(FigureTerm& term, std::string& problem) {
    do {
      skip();
      if (!factor(term, problem)) return false;
      skip();
    } while (peek() == '*' && ++at_);
    return true;
  }

  bool factor(FigureTerm& term, std::string& problem) {
    const char c = peek();
    if (std::isdigit(static_cast<unsigned char>(c)) || c == '.') {
      char* end = nullptr;
      const double number = std::strtod(text_.c_str() + at_, &end);
      at_ = static_cast<std::size_t>(end - text_.c_str());
      term.factor *= number;
      if (std::isfinite(term.factor) && std::fabs(term.factor) <= TILLER_LARGEST_VALUE) return true;
      problem = "has a number that is out of range";
      return false;
    }
    if (!std::isalpha(static_cast<unsigned char>(c)) && c != '_') {
      problem = at_ < text_.size() ? "has '" + text_.substr(at_) + "' where a number or a name is expected"
                                   : "ends where a number or a name is expected";
      return false;
    }
    const std::size_t from = at_;
    while (std::isalnum(static_cast<unsigned char>(peek())) || peek() == '_' || peek() == '.') ++at_;
    if (!term.name.empty()) {
      problem = "multiplies two names";
      return false;
    }
    term.name = text_.substr(from, at_ - from);
    return true;
  }

  const std::string& text_;
  std::size_t at_ = 0;
};

class FigureReader {
 public:
  FigureReader(FileErrors& errors, const RobotFile& robot) : errors_(errors) {
    names_ = robot.names.states;
    names_.insert(names_.end(), robot.names.params.begin(), robot.names.params.end());
  }

  /// Points that may name outputs too.
  void read_goals(const toml::node* node, const Words& outputs, FigureSection& figure) {
    if (!node) return;
    const char* remedy = "write a list of points, [[\"tip_x_m\", 0, \"tip_z_m\"]]";
    const toml::array* list = node->as_array();
    if (!list) return errors_.at(*node, "figure.goals_m", "is " + kind_text(*node), remedy);
    Words all = names_;
    all.insert(all.end(), outputs.begin(), outputs.end());
    names_.swap(all);
    for (const toml::node& element : *list) {
      FigurePoint point;
      if (values(&element, "figure.goals_m", point.data(), 3)) figure.goals_m.push_back(point);
    }
    names_.swap(all);
  }

  void read_links(const toml::node* node, FigureSection& figure) {
    const toml::array* list = node ? node->as_array() : nullptr;
    const char* remedy = "head each link with [[figure.links]]";
    if (!list || list->empty()) {
      if (node) return errors_.at_table(*node, "figure.links", list ? "is empty" : "is " + kind_text(*node), remedy);
      return errors_.at_line(figure.line, "figure.links", "is missing", remedy);
    }
    if (list->size() > kMostLinks)
      return errors_.at_table(*node, "figure.links", "there are " + std::to_string(list->size()),
                              "write at most " + std::to_string(kMostLinks));
    for (std::size_t i = 0; i < list->size(); ++i) {
      const toml::node& element = (*list)[i];
      if (element.is_table())
        read_link(*element.as_table(), i + 1, figure);
      else
        errors_.at(element, "figure.links", "is " + kind_text(element), remedy);
    }
  }

 private:
  void read_link(const toml::table& table, std::size_t number, FigureSection& figure) {
    const std::string name = table["name"].value<std::string>().value_or("");
    const std::string path = "figure.links[" + (name.empty() ? std::to_string(number) : name) + "]";
    SectionReader section(errors_, "figure.links[]", path, &table);
    const Words meant = section.refuse_unknown();
    FigureLink link;
    link.name = section.text("name").value_or("");
    if (!section.has("name") && index_of(meant, "name") < 0)
      section.missing("name", "write how the link is called, \"pole\"");
    for (const FigureLink& other : figure.links)
      if (!link.name.empty() && other.name == link.name)
        section.error("name", "is the name of another link", "give each link a name of its own");
    link.parent = find_parent(section, figure);
    point(section, "position_m", link.position_m);
    point(section, "rpy_rad", link.rpy_rad);
    read_quaternion(section, link);
    read_joint(section, meant, link);
    link.joined = section.flag("joined").value_or(false);
    read_lines(section, link);
    each_table(section, "circles", [&](const toml::table& one, const std::string& at) { read_circle(one, at, link); });
    each_table(section, "boxes", [&](const toml::table& one, const std::string& at) { read_box(one, at, link); });
    figure.links.push_back(link);
  }

  int find_parent(SectionReader& section, const FigureSection& figure) {
    const auto parent = section.text("parent");
    if (!parent) return -1;
    Words known;
    for (const FigureLink& link : figure.links) known.push_back(link.name);
    const int at = index_of(known, *parent);
    if (at < 0)
      section.error("parent", "no link above this one is called so",
                    known.empty() ? std::string("leave it out: the first link stands in the world; parents go first")
                                  : remedy_for_unknown(*parent, known));
    return at;
  }

  void read_quaternion(SectionReader& section, FigureLink& link) {
    if (!section.has("quaternion")) return;
    link.quaternion.resize(4);
    (void)values(section.node("quaternion"), section.path_of("quaternion"), link.quaternion.data(), 4);
    if (section.has("rpy_rad"))
      section.error("quaternion", "stands beside rpy_rad", "leave one of the two out: both turn the link");
  }

  void read_joint(SectionReader& section, const Words& meant, FigureLink& link) {
    if (const toml::node* node = section.node("turn_rad"))
      (void)value(*node, section.path_of("turn_rad"), link.turn_rad);
    if (const toml::node* node = section.node("slide_m")) (void)value(*node, section.path_of("slide_m"), link.slide_m);
    const bool moves = section.has("turn_rad") || section.has("slide_m");
    if (section.has("axis")) {
      direction(section.node("axis"), section.path_of("axis"), link.axis);
      if (!moves && index_of(meant, "turn_rad") < 0 && index_of(meant, "slide_m") < 0)
        section.error("axis", "of nothing", "write turn_rad or slide_m, what the link does about or along it");
    } else if (moves && index_of(meant, "axis") < 0) {
      section.missing("axis", "write the joint's direction in the link, [0, 0, 1]");
    }
  }

  void read_lines(SectionReader& section, FigureLink& link) {
    const toml::node* node = section.node("lines_m");
    if (!node) return;
    const char* remedy = "write lists of points, [[[0, 0, 0], [0, 0, 0.5]]]";
    const std::string path = section.path_of("lines_m");
    const toml::array* list = node->as_array();
    if (!list) return errors_.at(*node, path, "is " + kind_text(*node), remedy);
    for (const toml::node& element : *list) {
      const toml::array* line = element.as_array();
      if (!line || line->size() < 2) {
        errors_.at(element, path, line ? "a line has fewer than two points" : "a line is " + kind_text(element),
                   remedy);
        continue;
      }
      std::vector<FigurePoint> points(line->size());
      for (std::size_t i = 0; i < points.size(); ++i) (void)values(line->get(i), path, points[i].data(), 3);
      link.lines_m.push_back(points);
    }
  }

  void read_circle(const toml::table& table, const std::string& path, FigureLink& link) {
    SectionReader section(errors_, "figure.links[].circles[]", path, &table);
    const Words meant = section.refuse_unknown();
    FigureCircle circle;
    point(section, "at_m", circle.at_m);
    if (const toml::node* node = section.node("radius_m"))
      (void)value(*node, section.path_of("radius_m"), circle.radius_m);
    else if (index_of(meant, "radius_m") < 0)
      section.missing("radius_m", "write the circle's radius");
    if (section.has("normal")) direction(section.node("normal"), section.path_of("normal"), circle.normal);
    link.circles.push_back(circle);
  }

  void read_box(const toml::table& table, const std::string& path, FigureLink& link) {
    SectionReader section(errors_, "figure.links[].boxes[]", path, &table);
    const Words meant = section.refuse_unknown();
    FigureBox box;
    point(section, "at_m", box.at_m);
    point(section, "size_m", box.size_m);
    if (!section.has("size_m") && index_of(meant, "size_m") < 0)
      section.missing("size_m", "write its extents, [0.4, 0.2, 0.2]");
    link.boxes.push_back(box);
  }

  template <class Read>
  void each_table(SectionReader& section, const char* key, const Read& read) {
    const toml::node* node = section.node(key);
    if (!node) return;
    const std::string remedy =
        std::string("write a list of tables, ") +
        (std::string(key) == "boxes" ? "[{ size_m = [0.4, 0.2, 0.2] }]" : "[{ radius_m = 0.1 }]");
    const toml::array* list = node->as_array();
    if (!list) return errors_.at(*node, section.path_of(key), "is " + kind_text(*node), remedy);
    for (std::size_t i = 0; i < list->size(); ++i) {
      const std::string path = section.path_of(std::string(key) + "[" + std::to_string(i + 1) + "]");
      const toml::node& element = (*list)[i];
      if (element.is_table())
        read(*element.as_table(), path);
      else
        errors_.at(element, path, "is " + kind_text(element), remedy);
    }
  }

  void point(SectionReader& section, const char* key, FigurePoint& out) {
    if (section.has(key)) (void)values(section.node(key), section.path_of(key), out.data(), 3);
  }

  bool values(const toml::node* node, const std::string& path, FigureValue* out, std::size_t count) {
    const toml::array* list = node->as_array();
    if (!list || list->size() != count) {
      errors_.at(*node, path, list ? "has " + std::to_string(list->size()) + " entries" : "is " + kind_text(*node),
                 count == 3 ? "write three, [0, 0, \"length_m\"]: along x, y and z"
                            : "write four, [\"qw\", \"qx\", \"qy\", \"qz\"]: w, x, y, z");
      return false;
    }
    bool good = true;
    for (std::size_t i = 0; i < count; ++i) good = value((*list)[i], path, out[i]) && good;
    return good;
  }

  bool value(const toml::node& node, const std::string& path, FigureValue& out) {
    if (node.is_number()) {
      const double number = *node.value<double>();
      if (!(std::fabs(number) <= TILLER_LARGEST_VALUE)) {
        errors_.at(node, path, "is no finite number", kValueRemedy);
        return false;
      }
      if (number != 0.0) out.push_back({number, ""});
      return true;
    }
    const auto text = node.value<std::string>();
    std::string problem;
    if (!text || !parse_figure_value(*text, out, problem)) {
      errors_.at(node, path, text ? problem : "is " + kind_text(node), kValueRemedy);
      return false;
    }
    for (const FigureTerm& term : out) {
      if (term.name.empty() || index_of(names_, term.name) >= 0) continue;
      errors_.at(node, path, "nothing is called " + term.name, remedy_for_unknown(term.name, names_));
      return false;
    }
    return true;
  }

  /// Three numbers, made a unit vector.
  void direction(const toml::node* node, const std::string& path, std::array<double, 3>& out) {
    const toml::array* list = node->as_array();
    double square = 0.0;
    bool good = list && list->size() == 3;
    for (std::size_t i = 0; good && i < 3; ++i) {
      const auto number = (*list)[i].value<double>();
      good = number && std::fabs(*number) <= TILLER_LARGEST_VALUE;
      if (good) square += *number * *number, out[i] = *number;
    }
    if (!good || !(square > 1e-12))
      return errors_.at(*node, path, good ? "has no length" : "is no list of three numbers",
                        "write three numbers, [0, 0, 1]");
    for (double& component : out) component /= std::sqrt(square);
  }

  FileErrors& errors_;
  Words names_;
};

}  // namespace

bool parse_figure_value(const std::string& text, FigureValue& value, std::string& problem) {
  value.clear();
  return TermReader(text).read(value, problem);
}

void read_figure(FileErrors& errors, const toml::table& root, RobotFile& robot) {
  const toml::table* table = section_table(errors, root, "figure");
  if (!table) return;
  SectionReader section(errors, "figure", "figure", table);
  FigureSection& figure = robot.figure;
  figure.line = static_cast<int>(table->source().begin.line);
  const Words meant = section.refuse_unknown();
  if (const auto view = section.choice("view")) figure.view = figure_view_names()[*view];
  FigureReader reader(errors, robot);
  if (index_of(meant, "links") < 0) reader.read_links(section.node("links"), figure);
  reader.read_goals(section.node("goals_m"), robot.names.outputs, figure);
}

}  // namespace tiller::tools
