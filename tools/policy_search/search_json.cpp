#include "tools/policy_search/search_json.hpp"

#include "tools/base/json_number.hpp"
#include "tools/robot/units.hpp"

namespace tiller::tools::policy {
namespace {

nlohmann::json rows_of(const Matrix& m) {
  nlohmann::json rows = nlohmann::json::array();
  for (Eigen::Index i = 0; i < m.rows(); ++i) {
    const Vector row = m.row(i).transpose();
    rows.push_back(numbers({row.data(), row.data() + row.size()}));
  }
  return rows;
}

nlohmann::json units_of(const Words& names) {
  nlohmann::json units = nlohmann::json::object();
  for (const std::string& name : names) units[name] = unit_of_field(name);
  return units;
}

}  // namespace

std::string search_text(const SearchTask& task, const SearchResult& result, const std::string& robot,
                        const std::string& method) {
  const Policy& p = result.policy;
  nlohmann::json json = {{"format", "tiller policy search"},
                         {"version", 1},
                         {"robot", robot},
                         {"method", method},
                         {"kind", p.kind},
                         {"period_s", p.period_s},
                         {"states", p.states},
                         {"commands", p.commands},
                         {"units", units_of(p.states)},
                         {"command_units", units_of(p.commands)},
                         {"horizon", task.horizon}};
  json["trials"] = nlohmann::json::array();
  for (const SearchStep& step : result.steps) {
    nlohmann::json one = {
        {"predicted", number(step.predicted)}, {"cost", number(step.cost)}, {"seconds", step.seconds}};
    one["state"] = rows_of(step.trial.truth);
    one["command"] = rows_of(step.trial.command);
    one["forecast_mean"] = rows_of(step.forecast.mean);
    one["forecast_sd"] = rows_of(step.forecast.deviation);
    json["trials"].push_back(one);
  }
  return json.dump() + "\n";
}

}  // namespace tiller::tools::policy
