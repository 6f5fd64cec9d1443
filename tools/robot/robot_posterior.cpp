// [posterior]: what is more than a key with a place in the configuration.

#include <algorithm>
#include <filesystem>
#include <functional>

#include "posterior/posterior.hpp"
#include "tools/robot/posterior_file.hpp"
#include "tools/robot/robot_sections.hpp"

namespace tiller::tools {

/// Where the file says nothing: `transition` has it, whose parameters come from differences of a step that a little
/// friction spoils; `filter` does not, because it would blur the friction that most models have as a parameter.
void choose_discrepancy(SectionReader& posterior, RobotFile& robot) {
  if (posterior.node("disturbance")) return;
  const PosteriorTable* const engine = find_posterior(robot.config.posterior.kind);
  robot.config.posterior.disturbance = engine && engine->discrepancy_default ? 1 : 0;
}

void read_forgetting(SectionReader& posterior, RobotFile& robot) {
  const toml::node* node = posterior.node("forgetting");
  if (!node) return;
  const toml::array* list = node->as_array();
  if (!list || list->empty() || list->size() > TILLER_MAX_FORGETTING) {
    posterior.error("forgetting", "is not a list of one to three rates", "for example forgetting = [1, 0.97]");
    return;
  }
  tiller_posterior_config_t& c = robot.config.posterior;
  c.forgetting_count = 0;
  for (const toml::node& element : *list) {
    const std::optional<double> rate = element.value<double>();
    if (!rate || !(*rate >= 0.5 && *rate <= 1.0)) {
      posterior.error("forgetting", rate ? "has the rate " + number_text(*rate) : "holds " + kind_text(element),
                      "write shares of the old data that each tick keeps, 0.5 .. 1, largest first: [1, 0.97]");
      return;
    }
    c.forgetting[c.forgetting_count++] = *rate;
  }
  double* const end = c.forgetting + c.forgetting_count;
  if (std::is_sorted(c.forgetting, end, std::greater<>())) return;
  std::sort(c.forgetting, end, std::greater<>());
  Words sorted;
  for (const double* rate = c.forgetting; rate != end; ++rate) sorted.push_back(number_text(*rate));
  posterior.error("forgetting", "is in the wrong order: the largest rate stands first", "write [" + join(sorted) + "]");
}

void read_drift(SectionReader& posterior, RobotFile& robot) {
  const toml::node* node = posterior.node("drift");
  if (!node) return;
  const toml::array* list = node->as_array();
  if (!list) {
    posterior.error("drift", "is not a list of parameters",
                    "for example drift = [\"" + robot.names.params.front() + "\"]");
    return;
  }
  for (const toml::node& element : *list) {
    const std::optional<std::string> name = element.value<std::string>();
    const int row = name ? index_of(robot.names.params, *name) : -1;
    if (row < 0) {
      posterior.error("drift", name ? "names \"" + *name + "\"" : "holds " + kind_text(element),
                      "write parameters of this robot: " + join(robot.names.params));
      return;
    }
    if (robot.config.priors[row].kind == tiller_prior_fixed) {
      posterior.error("drift", "names \"" + *name + "\", which is known",
                      "give it a prior below [parameters] or [[effects]], for example { log_normal = [1, 0.2] }");
      return;
    }
    robot.config.posterior.drift |= std::uint64_t{1} << row;
  }
}

void read_prior_file(SectionReader& posterior, RobotFile& robot) {
  const auto name = posterior.text("prior_file");
  if (!name) return;
  const std::filesystem::path file = *name;
  const std::string path = (file.is_absolute() ? file : robot.model_request.robot_dir / file).string();
  if (posterior.errors().has_below("parameters") || posterior.errors().has_below("effects")) return;
  Words problems;
  StoredPosterior stored;
  if (read_posterior(path, stored, problems) && take_prior(stored, path, robot, problems)) return;
  for (const std::string& problem : problems) {
    const std::size_t remedy = problem.rfind("; ");
    posterior.error("prior_file", problem.substr(0, remedy), problem.substr(remedy + 2));
  }
}

}  // namespace tiller::tools
