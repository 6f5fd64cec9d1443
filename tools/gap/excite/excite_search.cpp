#include "tools/gap/excite/excite_search.hpp"

#include <algorithm>
#include <cmath>

#include "posterior/prior.hpp"

namespace tiller::tools::gap {
namespace {

constexpr int kSearchSteps = 3;  // of a refit while searching
constexpr int kFinalSteps = 10;  // and of what is reported
constexpr int kStartSteps = 12;  // and on the multisine that refits begin from
constexpr double kElite = 1.0 / 6;
constexpr std::uint32_t kDraws = kLanePadding - 1;  // of the priors, beside the rival's values

double infinity_to(double bound, double otherwise) { return std::isfinite(bound) ? bound : otherwise; }

}  // namespace

ExciteSearch::ExciteSearch(const std::vector<Rival>& rivals, const ExciteOptions& options)
    : rivals_(rivals), options_(options), period_s_(rivals[0].config.period_s) {
  for (const Rival& r : rivals_) {
    rollout_.push_back(std::make_unique<RivalRollout>(r));
    filter_.push_back(std::make_unique<MeanInnovations>(r));
  }
  make_pairs();
  make_truths();
  make_draws();
}

void ExciteSearch::make_pairs() {
  for (std::size_t a = 0; a < rivals_.size(); ++a)
    for (std::size_t b = a + 1; b < rivals_.size(); ++b) {
      Separation pair;
      pair.a = a, pair.b = b;
      const bool a_in_b = contains(rivals_[b], rivals_[a]), b_in_a = contains(rivals_[a], rivals_[b]);
      pair.nested = a_in_b != b_in_a;
      if (pair.nested && a_in_b) std::swap(pair.a, pair.b);
      pairs_.push_back(pair);
    }
  pair_best_.resize(pairs_.size());
}

void ExciteSearch::make_truths() {
  for (std::size_t r = 0; r < rivals_.size(); ++r) {
    const Rival& rival = rivals_[r];
    const bool guessed = std::find(rival.given.begin(), rival.given.end(), false) != rival.given.end();
    for (const double factor : guessed ? std::vector<double>{1.0, 0.4, 2.5} : std::vector<double>{1.0}) {
      Truth truth;
      truth.rival = r;
      truth.params = rival.value;
      for (std::size_t i = 0; i < truth.params.size(); ++i)
        if (!rival.given[i]) truth.params[i] = std::clamp(factor * truth.params[i], rival.low[i], rival.high[i]);
      for (const Rival& other : rivals_) truth.start.push_back(other.value);
      truths_.push_back(std::move(truth));
    }
  }
}

/// The robot file's own parameters over their priors, one slice of quantiles each; what was added stays.
void ExciteSearch::make_draws() {
  Rng rng(options_.seed, kRngPrior, 0);
  for (const Rival& rival : rivals_) {
    std::vector<std::vector<double>> draws(1, rival.value);
    const std::size_t own = rival.value.size();
    for (std::uint32_t d = 0; d < kDraws; ++d) {
      draws.push_back(rival.value);
      for (std::size_t i = 0; i < own; ++i) {
        const tiller_prior_t& prior = rival.config.priors[i];
        if (prior.kind == tiller_prior_fixed || rival.effects.empty()) continue;
        draws.back()[i] = from_coordinate(prior, prior_quantile(prior, 0.02 + 0.96 * rng.uniform()));
      }
    }
    draws_.push_back(std::move(draws));
  }
}

bool ExciteSearch::reach(const InputSequence& sequence, std::vector<double>& low, std::vector<double>& high) {
  const std::uint32_t nx = rivals_[0].config.model->state_count;
  low.assign(nx, INFINITY);
  high.assign(nx, -INFINITY);
  bool finite = true;
  std::vector<double> states;
  for (std::size_t r = 0; r < rivals_.size(); ++r) {
    finite = rollout_[r]->run(sequence, draws_[r], states) && finite;
    const std::size_t vectors = draws_[r].size();
    for (std::size_t k = 0; k < states.size(); ++k) {
      const std::size_t i = k / vectors % nx;
      low[i] = std::min(low[i], states[k]);
      high[i] = std::max(high[i], states[k]);
    }
  }
  return finite;
}

bool ExciteSearch::within(const InputSequence& sequence) {
  std::vector<double> low, high;
  if (!reach(sequence, low, high)) return false;
  return std::all_of(options_.keep.begin(), options_.keep.end(), [&](const KeepWithin& k) {
    return low[k.state] >= infinity_to(k.low, -INFINITY) && high[k.state] <= infinity_to(k.high, INFINITY);
  });
}

bool ExciteSearch::shrink_to_bounds(InputSequence& sequence) {
  if (within(sequence)) return true;
  double share = 1.0;
  while ((share *= 0.7) > 0.02) {
    const InputSequence smaller = scaled(sequence, options_.range, share);
    if (!within(smaller)) continue;
    sequence = smaller;
    return true;
  }
  return false;
}

/// Whoever is fitted first on something ordinary needs a step or two afterwards.
void ExciteSearch::prepare() {
  std::vector<double> rms;
  for (const InputRange& r : options_.range) rms.push_back(0.25 * (r.high - r.low));
  InputSequence ordinary = default_multisine(options_.range, rms, period_s_, std::min(options_.seconds, 10.0));
  (void)shrink_to_bounds(ordinary);
  for (Truth& truth : truths_) {
    const Outputs outputs = rollout_[truth.rival]->outputs(ordinary, truth.params);
    for (std::size_t b = 0; b < rivals_.size(); ++b) {
      if (b == truth.rival) continue;
      double least = INFINITY;
      for (const double factor : {1.0, 0.3, 3.0}) {
        std::vector<double> start = rivals_[b].value;
        for (std::size_t i = rivals_[0].config.model->param_count; i < start.size(); ++i)
          if (rivals_[b].spread[i] > 0) start[i] = std::clamp(factor * start[i], rivals_[b].low[i], rivals_[b].high[i]);
        const Refit fit = refit(rivals_[b], *filter_[b], ordinary, outputs, start, kStartSteps);
        if (fit.squares >= least) continue;
        least = fit.squares;
        truth.start[b] = fit.params;
      }
    }
  }
  find_nested(ordinary);
}

/// Nested by numbers: what the one does the other can do too (a robot file that infers its damping has viscous friction
/// already), though the catalogue does not say so. Only the other's being true can be shown then.
void ExciteSearch::find_nested(const InputSequence& sequence) {
  constexpr double kNothing_nats = 1.0, kPlenty_nats = 20.0;
  (void)pair_nats(sequence, kFinalSteps);
  for (Separation& pair : pairs_) {
    if (pair.nested) continue;
    const double a = direction(pair.a, pair.b), b = direction(pair.b, pair.a);
    if (std::min(a, b) > kNothing_nats || std::max(a, b) < kPlenty_nats) continue;
    pair.nested = true;
    if (b > a) std::swap(pair.a, pair.b);
  }
}

std::vector<double> ExciteSearch::pair_nats(const InputSequence& sequence, int steps) {
  direction_.assign(rivals_.size() * rivals_.size(), 0.0);
  std::vector<double> count(rivals_.size(), 0.0);
  for (const Truth& truth : truths_) {
    const Outputs outputs = rollout_[truth.rival]->outputs(sequence, truth.params);
    count[truth.rival] += 1;
    for (std::size_t b = 0; b < rivals_.size(); ++b) {
      const bool wanted = std::any_of(pairs_.begin(), pairs_.end(), [&](const Separation& p) {
        return (p.a == truth.rival && p.b == b) || (!p.nested && p.b == truth.rival && p.a == b);
      });
      if (!wanted) continue;
      const Refit fit = refit(rivals_[b], *filter_[b], sequence, outputs, truth.start[b], steps);
      direction_[truth.rival * rivals_.size() + b] += std::isfinite(fit.squares) ? 0.5 * fit.squares : 0.0;
    }
  }
  for (std::size_t i = 0; i < direction_.size(); ++i) direction_[i] /= count[i / rivals_.size()];
  std::vector<double> nats;
  for (const Separation& pair : pairs_) {
    nats.push_back(direction(pair.a, pair.b));
    if (!pair.nested) nats.back() = std::min(nats.back(), direction(pair.b, pair.a));
  }
  return nats;
}

std::vector<Separation> ExciteSearch::measure(const InputSequence& sequence) {
  std::vector<Separation> pairs = pairs_;
  const std::vector<double> nats = pair_nats(sequence, kFinalSteps);
  for (std::size_t p = 0; p < pairs.size(); ++p) pairs[p].nats = nats[p];
  return pairs;
}

/// The logarithm, so that a pair that is easy does not stand for one that is hard.
double ExciteSearch::score(const InputSequence& sequence) {
  const std::vector<double> nats = pair_nats(sequence, kSearchSteps);
  double sum = 0;
  for (std::size_t p = 0; p < nats.size(); ++p) {
    sum += std::log1p(nats[p]);
    if (nats[p] > pair_best_[p].nats) pair_best_[p] = {sequence, nats[p]};
  }
  return sum / static_cast<double>(nats.size());
}

/// Every shape by itself, at three amplitudes: what an engineer would try first.
std::vector<SequenceCode> ExciteSearch::plain_codes() const {
  std::vector<SequenceCode> all;
  for (std::uint32_t shape = 0; shape < kShapes; ++shape)
    for (const double amplitude : {1.0, 0.8, 0.55}) {
      SequenceCode code;
      code.genes.resize(law_.size());
      for (std::size_t g = 0; g < law_.size(); ++g) {
        code.genes[g].shape = static_cast<Shape>(shape);
        code.genes[g].amplitude = amplitude;
        code.genes[g].slow = 0.15 + 0.1 * static_cast<double>(g % 3);
        code.genes[g].fast = 0.85 - 0.15 * static_cast<double>(g % 3);
        code.genes[g].pattern = 0.1 + 0.37 * static_cast<double>(g % 3);
      }
      all.push_back(std::move(code));
    }
  return all;
}

SequenceCode ExciteSearch::draw(Rng& rng, const std::vector<Member>& elite) const {
  SequenceCode code;
  // half are children of the law, half a good one with a few genes redrawn
  const bool child = elite.empty() || rng.uniform() < 0.5;
  if (!child) code = elite[rng.below(static_cast<std::uint32_t>(elite.size()))].code;
  code.genes.resize(law_.size());
  for (std::size_t g = 0; g < law_.size(); ++g) {
    if (!child && rng.uniform() > 1.5 / static_cast<double>(law_.size())) continue;
    const Law& law = law_[g];
    Gene& gene = code.genes[g];
    double u = rng.uniform();
    std::uint32_t shape = 0;
    while (shape + 1 < kShapes && u > law.shape[shape]) u -= law.shape[shape++];
    if (child || rng.uniform() < 0.3) gene.shape = static_cast<Shape>(shape);
    for (int i = 0; i < kGeneNumbers; ++i) {
      if (!child && rng.uniform() < 0.5) continue;
      const double v = law.mean[i] + law.sd[i] * rng.normal();
      number_of(gene, i) = std::fabs(std::remainder(v, 2.0));  // reflected into [0, 1]
    }
  }
  return code;
}

void ExciteSearch::learn(const std::vector<Member>& elite) {
  constexpr double kNew = 0.7;
  const auto n = static_cast<double>(elite.size());
  for (std::size_t g = 0; g < law_.size(); ++g) {
    Law& law = law_[g];
    for (std::uint32_t s = 0; s < kShapes; ++s) {
      double share = 0;
      for (const Member& m : elite) share += m.code.genes[g].shape == static_cast<Shape>(s) ? 1 / n : 0;
      law.shape[s] = (1 - kNew) * law.shape[s] + kNew * share;
    }
    for (int i = 0; i < kGeneNumbers; ++i) {
      double mean = 0, square = 0;
      for (const Member& m : elite) {
        Gene gene = m.code.genes[g];
        mean += number_of(gene, i) / n;
        square += number_of(gene, i) * number_of(gene, i) / n;
      }
      law.mean[i] = (1 - kNew) * law.mean[i] + kNew * mean;
      law.sd[i] = (1 - kNew) * law.sd[i] + kNew * std::sqrt(std::max(0.0, square - mean * mean) + 1e-4);
    }
  }
}

bool ExciteSearch::run(std::string& error) {
  if (options_.progress) options_.progress("fit to a multisine", 0.0);
  prepare();
  Law wide;
  std::fill(std::begin(wide.shape), std::end(wide.shape), 1.0 / kShapes);
  std::fill(std::begin(wide.mean), std::end(wide.mean), 0.5);
  std::fill(std::begin(wide.sd), std::end(wide.sd), 0.5);
  law_.assign(stretches_of(options_.seconds) * options_.range.size(), wide);
  const auto keep = static_cast<std::size_t>(std::max(2.0, kElite * options_.population));
  std::vector<Member> elite;
  Rng rng(options_.seed, kRngPlanner, 0);
  for (std::uint32_t round = 0; round < options_.rounds && !stopped(); ++round) {
    std::vector<Member> members = elite;
    const std::vector<SequenceCode> plain = round == 0 ? plain_codes() : std::vector<SequenceCode>();
    for (std::uint32_t m = 0; m < options_.population && !stopped(); ++m) {
      Member member;
      member.code = m < plain.size() ? plain[m] : draw(rng, elite);
      InputSequence sequence = express(member.code, options_.range, period_s_, options_.seconds);
      ++tried_;
      if (options_.progress) options_.progress("search", (round + m / (1.0 * options_.population)) / options_.rounds);
      if (!shrink_to_bounds(sequence)) continue;
      member.score = score(sequence);
      if (member.score > best_score_) best_ = sequence, best_score_ = member.score;
      members.push_back(std::move(member));
    }
    std::stable_sort(members.begin(), members.end(),
                     [](const Member& a, const Member& b) { return a.score > b.score; });
    members.resize(std::min(members.size(), keep));
    elite = std::move(members);
    if (!elite.empty()) learn(elite);
  }
  if (best_score_ >= 0) return true;
  error =
      "no sequence keeps the states within their bounds over the priors of the robot file: wider bounds (--keep, "
      "[measurement] low and high), or a narrower prior";
  return false;
}

}  // namespace tiller::tools::gap
