#include <cmath>

#include "tools/tune/tune.hpp"

namespace tiller::tools::tune {
namespace {

// FNV-1a: tells files apart, protects nothing.
std::uint64_t checksum(const std::string& text) {
  std::uint64_t sum = 14695981039346656037ull;
  for (const char c : text) sum = (sum ^ static_cast<unsigned char>(c)) * 1099511628211ull;
  return sum;
}

std::string seeds_text(std::uint64_t first, std::uint32_t count) {
  const std::string low = std::to_string(first);
  return count == 1 ? "seed " + low : "seeds " + low + ".." + std::to_string(first + count - 1);
}

std::string cell(const Trial& trial) {
  std::string text = format("%.4g +- %.2g", trial.mean(), trial.sd());
  if (trial.safe > 0) text += format(" (%d SAFE)", trial.safe);
  return text;
}

std::string row(const char* name, const Judged& judged) {
  return format("  %-8s %26s %26s\n", name, cell(judged.train).c_str(), cell(judged.test).c_str());
}

/// Seed against seed: the plants' differences cancel.
std::string gain_text(const Tuned& result) {
  const auto &before = result.before.test.scores, &after = result.after.test.scores;
  Trial gain;
  int better = 0;
  for (std::size_t s = 0; s < after.size() && s < before.size(); ++s) {
    gain.scores.push_back(after[s] - before[s]);
    better += after[s] > before[s] ? 1 : 0;
  }
  if (gain.scores.empty() || !std::isfinite(gain.mean()))
    return "  a plant's state was not finite on the other seeds: no difference can be given\n";
  if (gain.scores.size() < 2)
    return format("on the other seed: %+.4g; one seed tells no error: raise --test\n", gain.mean());
  const double error = gain.sd() / std::sqrt(static_cast<double>(gain.scores.size()));
  std::string text =
      format("on the other seeds, seed against seed: %+.4g +- %.2g (standard error), better on %d of %zu\n",
             gain.mean(), error, better, gain.scores.size());
  if (gain.mean() < 2 * error)
    text += "that is within two standard errors: more --train seeds, or more --trials, before it is believed\n";
  return text;
}

}  // namespace

std::string settings_text(const std::string& text, const TuneOptions& options) {
  std::string all =
      format("tiller tune 1; robot file %016llx; seconds %s; %s", static_cast<unsigned long long>(checksum(text)),
             number_text(options.seconds).c_str(), seeds_text(options.first_seed, options.train).c_str());
  for (const SearchKey& key : options.keys)
    all += "; " + key.path + "=" + (key.log ? "log:" : "") + number_text(key.low) + ":" + number_text(key.high);
  return all;
}

std::string progress_text(const TuneOptions& options, std::size_t index, const std::vector<Trial>& trials) {
  std::size_t best = 0;
  for (std::size_t k = 1; k < trials.size(); ++k)
    if (trials[k].mean() > trials[best].mean()) best = k;
  const Trial& now = trials[index];
  const std::string result = now.refused.empty() ? "return " + cell(now) : "refused: " + trimmed(now.refused);
  return format("trial %zu of %u: %s; best %.4g (trial %zu)", index + 1, options.trials, result.c_str(),
                trials[best].mean(), best + 1);
}

std::string report_text(const TuneOptions& options, const Tuned& result) {
  std::string text = format(
      "return (minus the mean stage cost of the robot file as it was), mean +- deviation over seeds\n  %-8s %26s %26s\n",
      "", ("trained on " + seeds_text(options.first_seed, options.train)).c_str(),
      ("others: " + seeds_text(options.first_seed + options.train, options.test)).c_str());
  text += row("before", result.before);
  if (result.best == 0)
    return text +
           format("none of %zu trials is better than the robot file as it is; widen --search, or raise --trials\n",
                  result.trials.size() - 1);
  text += row("after", result.after) + gain_text(result);
  for (std::size_t j = 0; j < options.keys.size(); ++j) {
    const std::string& before = result.before.values[j];
    text += format("  %-32s %14s -> %s\n", options.keys[j].path.c_str(), before.empty() ? "(default)" : before.c_str(),
                   result.after.values[j].c_str());
  }
  return text;
}

}  // namespace tiller::tools::tune
