#include "tools/gap/pipeline/gap.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <set>

#include "effects/effect_info.hpp"
#include "effects/effect_roles.hpp"
#include "tiller/config.hpp"
#include "tools/base/text.hpp"
#include "tools/gap/fit/fine_steps.hpp"
#include "tools/gap/fit/identifiability.hpp"
#include "tools/gap/localise/localise.hpp"
#include "tools/gap/pipeline/change.hpp"
#include "tools/gap/pipeline/data.hpp"
#include "tools/gap/pipeline/data_quality.hpp"
#include "tools/gap/pipeline/holdout.hpp"
#include "tools/gap/pipeline/time_scale.hpp"
#include "tools/gap/pipeline/verdict.hpp"
#include "tools/gap/result/thresholds.hpp"
#include "tools/gap/search/confirm.hpp"
#include "tools/gap/search/cross_validate.hpp"
#include "tools/gap/search/memory.hpp"
#include "tools/gap/search/search.hpp"
#include "tools/robot/units.hpp"

namespace tiller::tools::gap {
namespace {

constexpr std::uint32_t kNoParameter = UINT32_MAX;

double cpu_now_s() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

bool is_measured(const tiller_config_t& config, std::uint32_t state) {
  for (std::uint32_t i = 0; i < config.measurement_count; ++i)
    if (config.measured_state[i] == state) return true;
  return false;
}

// False for an effect of a drive whose command does not change in any log.
bool is_driven(const tiller_model_t& model, const EffectInfo& info, std::uint32_t port,
               const std::vector<bool>& moves) {
  if (port == TILLER_EVERY_PORT) {
    bool all = true;
    for_ports(info, port, model, [&](std::uint32_t p) { all = all && is_driven(model, info, p, moves); });
    return all;
  }
  if (info.port == PortKind::input) return moves[port];
  return info.port != PortKind::joint || !info.needs_drive || moves[model.joints[port].drive - 1u];
}

// Where an effect of one kind is looked for: at every port that it fits, and at all inputs at once, as of one bus, one
// supply or one drive's firmware, if its parameters mean the same at all of them. A rotor and its spring or play are
// each drive's own.
std::vector<std::uint32_t> places_of(const tiller_model_t& model, const EffectInfo& info) {
  std::vector<std::uint32_t> places;
  for_ports(info, TILLER_EVERY_PORT, model, [&](std::uint32_t port) { places.push_back(port); });
  bool alike = info.port == PortKind::input && !info.needs_drive && places.size() > 1;
  for (int i = 0; i < info.param_count; ++i)
    for (const std::uint32_t port : places)
      alike = alike && unit_of_effect(info, i, port, model) == unit_of_effect(info, i, places[0], model);
  if (alike) places.push_back(TILLER_EVERY_PORT);
  return places;
}

// The fixed parameter of an effect that has no other, as an import writes friction that a description states: what the
// robot file says of it may be wrong. None: no such effect, one that may be off or in a dead spot (a limit, a width) or
// that sizes the memory (a delay), or a fit moves it anyway.
std::uint32_t fixed_parameter(const tiller_config_t& config, std::uint32_t effect) {
  std::uint32_t at = config.model->param_count;
  for (std::uint32_t i = 0; i < effect; ++i)
    at += static_cast<std::uint32_t>(effect_info(config.effects[i].kind).param_count);
  const std::uint32_t kind = config.effects[effect].kind;
  const bool only = effect_info(kind).param_count == 1 && !has_role(kind, kDelay | kLimit | kWidth);
  return only && config.priors[at].kind == tiller_prior_fixed ? at : kNoParameter;
}

// Everything of the catalogue at every place that it fits; where the robot file has it there, its other value.
std::vector<EffectAt> candidates_of(const tiller_config_t& config, const Options& options,
                                    const std::vector<bool>& moves, std::size_t sensors) {
  if (!options.given.empty()) return options.given;
  std::vector<EffectAt> list;
  if (options.before) list = changeable_parameters(config);
  for (std::uint32_t kind = 0; kind < effect_kind_count(); ++kind) {
    const EffectInfo& info = effect_info(kind);
    if (info.unnamed) continue;  // what is offered when nothing has a name
    if (!options.only.empty() && std::find(options.only.begin(), options.only.end(), info.name) == options.only.end())
      continue;
    for (const std::uint32_t port : places_of(*config.model, info)) {
      if (info.port == PortKind::sensor && !is_measured(config, port)) continue;
      // all readings late together are the inputs late, and nobody could tell
      if (has_role(kind, kLate) && sensors < 2) continue;
      if (!is_driven(*config.model, info, port, moves)) continue;
      const EffectAt e{kind, port};
      bool there = false;
      for (std::uint32_t i = 0; i < config.effect_count; ++i) {
        if (config.effects[i].kind != kind || config.effects[i].port != port) continue;
        there = true;
        const std::uint32_t param = options.before ? kNoParameter : fixed_parameter(config, i);
        if (param != kNoParameter) list.push_back({kChangedParameter, param});
      }
      if (!there) list.push_back(e);
    }
  }
  return list;
}

void index_windows(Session& s) {
  for (std::size_t i = 0; i < s.windows.size(); ++i) {
    if (s.windows[i].test) {
      s.test.push_back(i);
      continue;
    }
    s.work.push_back(i);
    s.fold[s.windows[i].fold].push_back(i);
  }
  const std::size_t stride = std::max<std::size_t>(1, s.work.size() / kScreenWindows);
  for (std::size_t i = 0; i < s.work.size(); i += stride) s.screen.push_back(s.work[i]);
}

// Where a gap is left: whether it goes if the inputs are those at the rows and change in between, instead of holding
// from row to row.
void try_inputs_at_rows(Session& s, const Candidate& nominal, Result& result) {
  if (result.verdict == Verdict::no_gap || result.verdict == Verdict::named || s.stopped()) return;
  std::vector<Grid> grids = s.data.grids;
  for (Grid& grid : grids)
    for (auto& input : grid.input)
      for (std::size_t k = 0; k + 1 < input.size(); ++k) input[k] = 0.5 * (input[k] + input[k + 1]);
  const WindowData data = make_window_data(std::move(grids), s.config);
  Shooting shooting(data, s.windows, s.config, s.scales, s.threads.get());
  shooting.prepare_whitening(nominal.hypothesis, nominal.fit);
  Fit fit = shooting.begin(nominal.hypothesis, nominal.fit.params, nullptr);
  shooting.fit(nominal.hypothesis, s.work, {}, fit);
  if (!fit.finite || fit.total() > kOtherInputs * nominal.fit.total()) return;
  result.notes.push_back("The gap shrinks to " +
                         format("%.2f", result.nominal_sigma * std::sqrt(fit.total() / nominal.fit.total())) +
                         " sigma if the logged inputs are what acted at the rows and changed in between, as measured "
                         "forces do: [log] input = \"mean\".");
}

// "The logs' further sensors count as the robot's own do: imu_x (cart_velocity_m_s, derivative 1)."
std::string sensors_note(const std::vector<Grid>& grids) {
  Words words;
  for (const Grid& grid : grids) {
    if (!words.empty()) break;
    for (const GridSensor& sensor : grid.sensor)
      words.push_back(sensor.is.column + " (" + sensor.is.of +
                      (sensor.is.accelerometer    ? ", accelerometer"
                       : sensor.is.derivative > 0 ? ", derivative " + std::to_string(sensor.is.derivative)
                                                  : "") +
                      ")");
  }
  return "The logs' further sensors count as the robot's own do: " + join(words) + ".";
}

// Errors count in what the model of before leaves on its own logs: noise, and what is not known of the robot anyway.
Config in_units_of_before(const tiller_config_t& config, double sigma) {
  Config c = config;
  for (std::uint32_t k = 0; k < c.measurement_count; ++k) c.measurement_sd[k] *= sigma;
  for (std::uint32_t i = 0; i < c.model->state_count; ++i) c.process_sd[i] *= sigma;
  return c;
}

ModelFit in_units_of_before(ModelFit fit) {
  for (double& v : fit.information) v /= fit.sigma * fit.sigma;
  return fit;
}

// What was proven is in the model that a robot goes on with; the rest is not.
void keep_model(const SearchResult& found, Result& result) {
  const bool proven =
      result.verdict == Verdict::named || result.verdict == Verdict::ambiguous || result.verdict == Verdict::partly;
  const std::size_t entry = proven ? found.best : 0;
  for (std::size_t i = 0; !proven && i < result.ranking.size(); ++i)
    if (result.ranking[i].effects.empty()) result.model_place = i;
  result.model = model_fit(found.entries[entry], result.ranking[result.model_place].remaining_sigma);
}

std::string scale_note(double scale) {
  return "The motion is " + format("%.3g", scale > 1 ? scale : 1 / scale) + " times " +
         (scale > 1 ? "slower" : "faster") +
         " than that of a machine that moves within a second: windows and rollouts are " +
         format("%.3g s", kWindow_s * scale) + " long.";
}

// True with a reason in `result`.
bool has_too_little(const Session& s, Result& result) {
  if (static_cast<double>(s.work.size()) * kWindow_s >= kLeast_s && s.fold[0].size() >= 2 && s.fold[1].size() >= 2)
    return false;
  result.reasons.push_back("the logs hold " + format("%.1f", s.data.data_s) + " s in stretches of which " +
                           format("%zu", s.work.size()) + " windows of " + format("%.3g s", kWindow_s * s.time_scale) +
                           " can be cut; at least " + format("%.0f", kLeast_s) +
                           " are needed: record longer, without gaps");
  return true;
}

// The search compares costs, which needs one whitening: the nominal model's. Estimates need that of their own model:
// process noise dies out sooner where the friction found damps it. By the nominal model's weights the friction of an
// arm's six joints comes 0.7 % too large, three to five of its deviations. Costs stay those of the search.
void refit_by_own_weights(Session& s, Candidate& e, const FitSettings& settings) {
  Fit own = e.fit;
  for (int round = 0; round < 2; ++round) {
    s.shooting->prepare_whitening(e.hypothesis, own);
    s.shooting->fit(e.hypothesis, s.work, settings, own);
    if (!own.finite || s.stopped()) return;
  }
  own.dispersion = dispersion_of(s, e.hypothesis, own);
  own.cost = e.fit.cost;
  own.unseen_cost = e.fit.unseen_cost;
  own.data_cost = e.fit.data_cost;
  own.penalty = e.fit.penalty;
  e.fit = own;
}

// Fits of all that is reported, with the information that intervals are made of.
void fit_with_information(Session& s, SearchResult& found) {
  FitSettings last;
  last.information = true;
  std::set<std::size_t> told = {0, found.best, found.leading};
  told.insert(found.ambiguity.begin(), found.ambiguity.end());
  told.insert(found.beside.begin(), found.beside.end());
  for (const std::size_t i : told) {
    s.shooting->fit(found.entries[i].hypothesis, s.work, last, found.entries[i].fit);
    found.entries[i].fit.dispersion = s.dispersion;
  }
  if (!s.shooting->weights_have_models()) return;
  for (const std::size_t i : told)
    if (i != 0) refit_by_own_weights(s, found.entries[i], last);
  s.shooting->prepare_whitening(found.entries[0].hypothesis, found.entries[0].fit);
}

void note_untold(const Candidate& nominal, const std::vector<std::string>& param_names, Result& result) {
  for (const UntoldDirection& d : untold_directions(nominal.hypothesis, nominal.fit, param_names))
    result.notes.push_back(untold_text(nominal.hypothesis, d, param_names));
}

}  // namespace

Result find_gap_on(const tiller_config_t& as_told, const std::vector<std::string>& param_names, std::vector<Grid> work,
                   std::vector<Grid> hold_out, const Options& options) {
  const double start_s = cpu_now_s();
  Result result;
  result.before_sigma = options.before ? options.before->sigma : 1.0;
  const Config config = in_units_of_before(as_told, result.before_sigma);
  const ModelFit before = options.before ? in_units_of_before(*options.before) : ModelFit{};
  const std::size_t own = work.size(), all = own + hold_out.size();
  for (Grid& grid : hold_out) work.push_back(std::move(grid));
  for (Grid& grid : work)
    for (GridSensor& sensor : grid.sensor) sensor.is.sd *= result.before_sigma;
  const double scale = measure_time_scale(config, work);
  for (Grid& grid : work) grid.time_scale = scale;
  const Config fine = work.empty() ? config : with_fine_steps(config, work.front());
  Session s{fine, config.substeps, options, make_window_data(std::move(work), config), scale};
  s.windows = make_windows(s.data, config, kWindow_s, 0, own);
  split_windows(s.windows, hold_out.empty() ? kTestShare : 0.0);
  for (Window& w : make_windows(s.data, config, kWindow_s, own, all)) {
    w.test = true;
    s.windows.push_back(w);
  }
  index_windows(s);
  check_data_quality(as_told, s.data.grids, options.stop, result);
  if (!result.reasons.empty()) return result;
  result.fit_windows = result.decide_windows = s.work.size();
  result.test_windows = s.test.size();
  result.data_s = s.data.data_s;
  if (scale != 1) result.notes.push_back(scale_note(scale));
  if (s.data.gauges.count() > 0) result.notes.push_back(sensors_note(s.data.grids));
  if (has_too_little(s, result)) return result;
  s.scales = measure_scales(s.data, s.windows, config, prior_centre(config).data());
  if (options.before) s.scales.before = &before;
  s.candidates = candidates_of(config, options, inputs_that_move(config, s.data.grids),
                               config.measurement_count + s.data.gauges.count());
  s.threads = std::make_unique<ThreadPool>(std::max(1u, options.threads));
  s.shooting = std::make_unique<Shooting>(s.data, s.windows, config, s.scales, s.threads.get());
  s.shooting->stop_at(options.stop);
  result.memory_bytes = memory_bound(s);

  SearchResult found = search(s);
  confirm(s, found);
  fit_with_information(s, found);
  if (!options.before) note_untold(found.entries[0], param_names, result);
  result.interrupted = found.interrupted;
  Candidate frozen;
  if (options.before) {
    frozen = frozen_model(s, found.entries[0]);
    result.frozen_sigma = s.sigma(frozen.fit.cost, s.work);
  }
  const Candidate& reference = options.before ? frozen : found.entries[0];
  s.progress("localising", 0);
  // by parameters that stand far from their priors a force would be told in units of their mistake
  const std::size_t by = centre_of_own(s, found.entries[0]).empty() ? 0 : found.best;
  const Candidate& shown = options.before ? frozen : found.entries[by];
  localise(config, s.data.grids, shown.fit.params.data(), options.seed, result);
  s.progress("proof", 0);
  test_on_holdout(s, reference, found.entries[found.best], result);
  if (options.before) tell_changes(s, found, result);
  conclude(s, found, param_names, result);
  keep_model(found, result);
  try_inputs_at_rows(s, found.entries[0], result);
  if (result.interrupted) result.sentence = "Stopped before the search came to its end. So far: " + result.sentence;
  s.progress("done", 1);
  result.cpu_s = cpu_now_s() - start_s;
  return result;
}

Result find_gap_in(const RobotFile& robot, const std::vector<Log>& logs, const std::vector<Log>& hold_out,
                   const Options& options) {
  std::vector<Grid> grids[2];
  for (int part = 0; part < 2; ++part)
    for (const Log& log : part == 0 ? logs : hold_out)
      for (Grid& grid : make_grids(log, robot.log, robot.config)) grids[part].push_back(std::move(grid));
  return find_gap_on(robot.config, robot.names.params, std::move(grids[0]), std::move(grids[1]), options);
}

Result find_gap(const RobotFile& robot, const Options& options) {
  Result loaded;
  std::vector<Log> logs;
  std::vector<Grid> grids[2];
  std::string hash[2];
  load_logs(robot, options.logs, options.most_steps, false, logs, grids[0], &hash[0], loaded);
  load_logs(robot, options.hold_out, options.most_steps, true, logs, grids[1], &hash[1], loaded);
  Result result = loaded;
  if (loaded.reasons.empty()) {
    result = find_gap_on(robot.config, robot.names.params, std::move(grids[0]), std::move(grids[1]), options);
    result.notes.insert(result.notes.begin(), loaded.notes.begin(), loaded.notes.end());
  }
  if (!result.reasons.empty()) result.sentence = "The logs cannot be used.";
  result.data_hash = options.hold_out.empty() ? hash[0] : hash[0] + " " + hash[1];
  result.model_hash = hash_of_files({robot.path});
  return result;
}

}  // namespace tiller::tools::gap
