// [posterior]: what is more than a key with a place in the configuration.

#include <filesystem>

#include "tools/posterior_file.hpp"
#include "tools/robot_sections.hpp"

namespace tiller::tools {

/// Where the file says nothing: `transition` has it, whose parameters come from differences of a step that a little
/// friction spoils; `filter` does not, because it would blur the friction that most models have as a parameter.
void choose_discrepancy(SectionReader& posterior, RobotFile& robot) {
  if (posterior.node("discrepancy")) return;
  tiller_posterior_config_t& c = robot.config.posterior;
  c.discrepancy = c.kind == tiller_posterior_transition ? 1 : 0;
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
    const double above = c.forgetting_count ? c.forgetting[c.forgetting_count - 1] : 1.0;
    if (!rate || !(*rate >= 0.5 && *rate <= above)) {
      posterior.error("forgetting", "has a rate that is no number in [0.5, 1] or larger than the one before it",
                      "shares of the old data that each tick keeps, largest first: [1, 0.97]");
      return;
    }
    c.forgetting[c.forgetting_count++] = *rate;
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
