#include <cmath>
#include <nlohmann/json.hpp>

#include "effects/effect_info.hpp"
#include "tools/base/json_number.hpp"
#include "tools/gap/fit/hypothesis.hpp"
#include "tools/gap/report/outputs.hpp"
#include "tools/robot/units.hpp"

namespace tiller::tools::gap {
namespace {

using nlohmann::json;

json lists(const std::vector<std::vector<double>>& values) {
  json list = json::array();
  for (const auto& v : values) list.push_back(numbers(v));
  return list;
}

const char* force_name(const tiller_model_t& model, std::uint32_t joint) {
  return model.force_names[model.joints[joint].force];
}

json map_json(const AxisMap& map, const tiller_model_t& model) {
  json bins = json::array();
  for (const AxisMap::Bin& b : map.bins)
    bins.push_back({{"low", number(b.low)},
                    {"high", number(b.high)},
                    {"mean", number(b.mean)},
                    {"sd", number(b.sd)},
                    {"count", number(b.count)}});
  return {{"joint", model.joints[map.joint].name},
          {"force", force_name(model, map.joint)},
          {"axis", axis_name(map.axis)},
          {"axis_label", map.axis_label},
          {"statistic", number(map.statistic)},
          {"z", number(map.z)},
          {"p_value", number(map.p_value)},
          {"bins", bins},
          {"null", numbers(map.null)}};
}

json force_json(const MissingForce& f, const tiller_model_t& model) {
  return {{"joint", model.joints[f.joint].name},
          {"force", force_name(model, f.joint)},
          {"log", f.log},
          {"time_s", numbers(f.time_s)},
          {"mean", numbers(f.mean)},
          {"sd", numbers(f.sd)}};
}

json orders_json(const OrderSpectrum& o, const tiller_model_t& model) {
  return {{"joint", model.joints[o.joint].name},
          {"force", force_name(model, o.joint)},
          {"amplitude", numbers(o.amplitude)},
          {"chance", numbers(o.chance)}};
}

json region_json(const Region& region, const tiller_model_t& model) {
  if (!region.found) return nullptr;
  return {{"joint", model.joints[region.joint].name},
          {"force", force_name(model, region.joint)},
          {"axis", axis_name(region.axis)},
          {"low", number(region.low)},
          {"high", number(region.high)},
          {"mean", number(region.force)},
          {"sd", number(region.force_sd)},
          {"z", number(region.z)}};
}

json effect_json(const EffectAt& effect, const RobotFile& robot) {
  if (effect.kind == kChangedParameter)
    return {{"kind", info_of(effect.kind).name},
            {"port_kind", "parameter"},
            {"port", param_name(robot.config, effect.port)}};
  const tiller_model_t& model = *robot.config.model;
  const EffectInfo& info = info_of(effect.kind);
  return {{"kind", info.name},
          {"port_kind", port_kind_name(info.port)},
          {"port", port_name(info.port, model, effect.port)}};
}

json estimate_json(const Estimate& e, bool own) {
  return {{"name", e.name},
          {"unit", e.unit},
          {"of", own ? "robot_file" : "effect"},
          {"fixed", e.fixed},
          {"before", number(e.before)},
          {"before_sd", number(e.before_sd)},
          {"mean", number(e.mean)},
          {"sd", number(e.sd)},
          {"interval_95", {number(e.low), number(e.high)}},
          {"edge", edge_json(e.name, e.edge)}};
}

json explanation_json(const Explanation& x, const RobotFile& robot) {
  json effects = json::array(), params = json::array();
  for (const EffectAt& effect : x.effects) effects.push_back(effect_json(effect, robot));
  for (std::size_t i = 0; i < x.params.size(); ++i)
    params.push_back(estimate_json(x.params[i], i < robot.config.param_count));
  return {{"effects", effects},
          {"parameters", params},
          {"gain_nats", number(x.gain_nats)},
          {"z", number(x.z)},
          {"z_to_best", number(x.z_to_best)},
          {"robust_z_to_best", number(x.robust_z_to_best)},
          {"rollout_ratio", number(x.rollout_ratio)},
          {"remaining_sigma", number(x.remaining_sigma)},
          {"equivalent", x.equivalent}};
}

// What is known of the kinds that the ranking names.
json catalogue_json(const Result& result) {
  json kinds = json::object();
  const auto text = [](const char* t) { return t ? json(t) : json(nullptr); };
  for (const Explanation& x : result.ranking)
    for (const EffectAt& effect : x.effects) {
      const EffectInfo& info = info_of(effect.kind);
      json aliases = json::array();
      for (const char* alias : info.aliases)
        if (alias) aliases.push_back(alias);
      kinds[info.name] = {{"help", text(info.help)},
                          {"equation", text(info.equation)},
                          {"source", text(info.source)},
                          {"aliases", aliases},
                          {"separation", text(info.separation)}};
    }
  return kinds;
}

json change_json(const Change& c) {
  return {{"name", c.name},
          {"unit", c.unit},
          {"of", c.effect ? "effect" : "robot_file"},
          {"before", number(c.before)},
          {"before_sd", number(c.before_sd)},
          {"after", number(c.after)},
          {"after_sd", number(c.after_sd)},
          {"change", number(c.change)},
          {"interval_95", {number(c.low), number(c.high)}}};
}

// Null where it is not asked what changed.
json changes_json(const Result& result) {
  const BeforeTold& b = result.before;
  if (b.logs.empty()) return nullptr;
  json changed = json::array(), others = json::array();
  for (const Change& c : result.changes) changed.push_back(change_json(c));
  for (const Change& c : result.others) others.push_back(change_json(c));
  return {{"before",
           {{"logs", b.logs},
            {"hash", b.hash},
            {"seconds", number(b.data_s)},
            {"verdict", b.verdict},
            {"sentence", b.sentence},
            {"sigma", number(result.before_sigma)},
            {"robot_file", b.robot_file.empty() ? json(nullptr) : json(b.robot_file)}}},
          {"frozen_sigma", number(result.frozen_sigma)},
          {"changed", changed},
          {"others", others}};
}

json channels_json(const RobotFile& robot) {
  json list = json::array();
  for (std::uint32_t k = 0; k < robot.config.measurement_count; ++k) {
    const std::string name = robot.config.model->state_names[robot.config.measured_state[k]];
    list.push_back({{"name", name}, {"unit", unit_of_field(name)}, {"sd", number(robot.config.measurement_sd[k])}});
  }
  return list;
}

json horizons_json(const Result& result) {
  json list = json::array();
  for (const HorizonGap& h : result.horizons)
    list.push_back({{"seconds", number(h.seconds)},
                    {"before_sigma", number(h.before_sigma)},
                    {"after_sigma", number(h.after_sigma)},
                    {"before_rms", numbers(h.before_rms)},
                    {"after_rms", numbers(h.after_rms)},
                    {"windows", h.windows}});
  return list;
}

json overlays_json(const Result& result) {
  json list = json::array();
  for (const Overlay& o : result.overlays)
    list.push_back({{"log", o.log},
                    {"first_time_s", number(o.first_time_s)},
                    {"time_s", numbers(o.time_s)},
                    {"measured", lists(o.measured)},
                    {"before", lists(o.before)},
                    {"after", lists(o.after)},
                    {"input", lists(o.input)}});
  return list;
}

}  // namespace

namespace {
constexpr int kInterrupted = 130;  // as the command ends by Ctrl-C
}

int exit_code_of(const Result& result, double budget_sigma) {
  if (result.interrupted) return kInterrupted;
  if (result.verdict == Verdict::unfit) return 3;
  // a parameter off its prior is told whatever the gap: the model fits by it
  const double gap_sigma = result.before.logs.empty() ? result.nominal_sigma : result.frozen_sigma;
  if (result.verdict != Verdict::off_prior && gap_sigma <= budget_sigma) return 0;
  switch (result.verdict) {
    case Verdict::no_gap: return 0;
    case Verdict::named: return 1;
    default: return 2;
  }
}

std::string gap_json(const RobotFile& robot, const Options& options, const Result& result,
                     const std::string& robot_file) {
  const tiller_model_t& model = *robot.config.model;
  json maps = json::array(), ranking = json::array(), forces = json::array(), orders = json::array();
  for (const MissingForce& f : result.forces) forces.push_back(force_json(f, model));
  for (const OrderSpectrum& o : result.orders) orders.push_back(orders_json(o, model));
  for (const AxisMap& map : result.maps) maps.push_back(map_json(map, model));
  for (const Explanation& x : result.ranking) ranking.push_back(explanation_json(x, robot));
  const json where = {
      {"region", region_json(result.region, model)}, {"maps", maps}, {"forces", forces}, {"orders", orders}};
  const json out = {{"format", "tiller-gap"},
                    {"version", kJsonVersion},
                    {"tiller", tiller_version()},
                    {"verdict", verdict_name(result.verdict)},
                    {"exit_code", exit_code_of(result, options.budget_sigma)},
                    {"interrupted", result.interrupted},
                    {"sentence", result.sentence},
                    {"notes", result.notes},
                    {"reasons", result.reasons},
                    {"budget_sigma", number(options.budget_sigma)},
                    {"seed", options.seed},
                    {"robot",
                     {{"name", robot.name},
                      {"file", robot.path},
                      {"model", model.name},
                      {"period_s", robot.config.period_s},
                      {"inputs", robot.names.inputs},
                      {"hash", result.model_hash}}},
                    {"data",
                     {{"logs", options.logs},
                      {"hold_out", options.hold_out},
                      {"hash", result.data_hash},
                      {"seconds", number(result.data_s)},
                      {"fit_windows", result.fit_windows},
                      {"decide_windows", result.decide_windows},
                      {"test_windows", result.test_windows},
                      {"channels", channels_json(robot)}}},
                    {"gate",
                     {{"nominal_sigma", number(result.nominal_sigma)},
                      {"noise_ratio", number(result.noise_ratio)},
                      {"whiteness_p", number(result.whiteness_p)}}},
                    {"where", where},
                    {"ranking", ranking},
                    {"ambiguity", result.ambiguity},
                    {"leading", result.leading == 0 ? json(nullptr) : json(result.leading)},
                    {"more_s", number(result.more_s)},
                    {"separation", result.separation},
                    {"change", changes_json(result)},
                    {"horizons", horizons_json(result)},
                    {"remaining_sigma", number(result.remaining_sigma)},
                    {"overlays", overlays_json(result)},
                    {"catalogue", catalogue_json(result)},
                    {"robot_file", robot_file.empty() ? json(nullptr) : json(robot_file)},
                    {"cost", {{"cpu_s", number(result.cpu_s)}, {"memory_bytes", result.memory_bytes}}}};
  return out.dump(1) + "\n";
}

}  // namespace tiller::tools::gap
