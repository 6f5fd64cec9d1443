#include "tools/gap/excite/excite.hpp"

#include <algorithm>
#include <cmath>

#include "core/input_cone.hpp"
#include "effects/effect_info.hpp"
#include "tools/gap/excite/excite_search.hpp"

namespace tiller::tools::gap {
namespace {

bool names(const EffectInfo& info, std::uint32_t other) {
  const auto is = [&](const char* name) { return name && find_effect(name) == static_cast<int>(other); };
  return std::any_of(std::begin(info.aliases), std::end(info.aliases), is) ||
         std::any_of(std::begin(info.contains), std::end(info.contains), is);
}

/// What the catalogue says of the effects that one has and the other has not: first where it names the other.
std::string advice_of(const Rival& a, const Rival& b) {
  const char* any = nullptr;
  for (const auto& [one, other] : {std::pair(&a, &b), std::pair(&b, &a)}) {
    for (const EffectAt& e : one->effects) {
      const EffectInfo& info = effect_info(e.kind);
      if (!info.separation || std::find(other->effects.begin(), other->effects.end(), e) != other->effects.end())
        continue;
      const bool meant = std::any_of(other->effects.begin(), other->effects.end(),
                                     [&](const EffectAt& o) { return names(info, o.kind); });
      if (meant) return info.separation;
      if (!any) any = info.separation;
    }
  }
  return any ? any : "measure more states, or the force itself: these sensors see the same of both";
}

void judge(const std::vector<Rival>& rivals, const ExciteOptions& options, Separation& pair) {
  const auto seconds_for = [&](double nats) {
    return nats > 0 ? options.seconds * options.target_nats / nats : INFINITY;
  };
  pair.separable = seconds_for(std::max(pair.best_nats, pair.nats)) <= kLongestRecording_s;
  pair.seconds = pair.separable ? seconds_for(pair.nats) : INFINITY;
  if (!pair.separable) pair.advice = advice_of(rivals[pair.a], rivals[pair.b]);
}

/// Sequences know ranges alone: the corner of them that is farthest out has to be within every cone.
bool within_cones(const tiller_config_t& config, const std::vector<InputRange>& range, std::string& error) {
  for (std::uint32_t c = 0; c < config.safety.cone_count; ++c) {
    const tiller_input_cone_t& cone = config.safety.cones[c];
    double corner[TILLER_MAX_INPUTS] = {};
    for (std::size_t i = 0; i < range.size(); ++i)
      corner[i] = std::max(std::fabs(range[i].low), std::fabs(range[i].high));
    const double norm = cone_norm(cone, corner);
    if (cone.slope > 0.0) corner[cone.axis] = range[cone.axis].low;
    if (norm <= cone_radius(cone, corner)) continue;
    error = "sequences within the limits may leave safety.cones[" + std::to_string(c + 1) +
            "]: narrow the limits of its inputs with --limit until their corners are within it";
    return false;
  }
  return true;
}

bool check(const std::vector<Rival>& rivals, const ExciteOptions& options, std::string& error) {
  if (rivals.size() < 2) {
    error = "one candidate needs no experiment: name two or more";
    return false;
  }
  for (std::size_t a = 0; a < rivals.size(); ++a)
    for (std::size_t b = 0; b < a; ++b)
      if (rivals[a].effects == rivals[b].effects) {
        error = rivals[a].name + " stands among the candidates twice";
        return false;
      }
  for (const InputRange& r : options.range)
    if (!(r.high > r.low) || !std::isfinite(r.high - r.low) || r.rest < r.low || r.rest > r.high) {
      error = "an input's limits leave nothing to excite with, or not its safe command";
      return false;
    }
  return within_cones(rivals[0].config, options.range, error);
}

std::vector<InputRange> ranges_of(const tiller_config_t& config) {
  std::vector<InputRange> range;
  const tiller_safety_config_t& s = config.safety;
  for (std::uint32_t i = 0; i < config.model->input_count; ++i)
    range.push_back({s.input_low[i], s.input_high[i], s.input_rate_per_s[i], s.safe_command[i]});
  return range;
}

}  // namespace

bool propose_excitation(const std::vector<Rival>& rivals, const ExciteOptions& given, Proposal& proposal,
                        std::string& error) {
  ExciteOptions options = given;
  if (!rivals.empty() && options.range.empty()) options.range = ranges_of(rivals[0].config);
  if (!check(rivals, options, error)) return false;
  ExciteSearch search(rivals, options);
  if (!search.run(error)) return false;

  proposal = {};
  proposal.sequence = search.best();
  proposal.rms = rms_of(proposal.sequence, options.range);
  proposal.tried = search.tried();
  proposal.pairs = search.measure(proposal.sequence);
  const InputSequence baseline =
      default_multisine(options.range, proposal.rms, proposal.sequence.period_s, options.seconds);
  const std::vector<Separation> by_default = search.measure(baseline);
  proposal.all_separable = true;
  for (std::size_t p = 0; p < proposal.pairs.size(); ++p) {
    Separation& pair = proposal.pairs[p];
    pair.baseline_nats = by_default[p].nats;
    pair.best_nats = std::max(pair.nats, search.measure(search.best_for(p))[p].nats);
    judge(rivals, options, pair);
    proposal.all_separable = proposal.all_separable && pair.separable;
    if (pair.separable) proposal.record_s = std::max(proposal.record_s, pair.seconds);
  }
  const Outputs first = RivalRollout(rivals[0]).outputs(proposal.sequence, rivals[0].value);
  const std::uint32_t ny = rivals[0].config.measurement_count;
  for (std::size_t k = 0; k < proposal.sequence.points(); ++k)
    proposal.outputs.emplace_back(first.value.begin() + static_cast<std::ptrdiff_t>(k * ny),
                                  first.value.begin() + static_cast<std::ptrdiff_t>((k + 1) * ny));
  search.reach(proposal.sequence, proposal.state_low, proposal.state_high);
  return true;
}

std::vector<Separation> separations(const std::vector<Rival>& rivals, const InputSequence& sequence) {
  ExciteOptions options;
  options.seconds = sequence.seconds();
  options.range = ranges_of(rivals.at(0).config);
  ExciteSearch search(rivals, options);
  search.prepare();
  std::vector<Separation> pairs = search.measure(sequence);
  for (Separation& pair : pairs) {
    pair.best_nats = pair.nats;
    judge(rivals, options, pair);
  }
  return pairs;
}

}  // namespace tiller::tools::gap
