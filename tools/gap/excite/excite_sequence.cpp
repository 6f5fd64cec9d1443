#include "tools/gap/excite/excite_sequence.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::tools::gap {
namespace {

constexpr double kSmallest = 0.02;  // of the range: what stiction and dead zones are about
constexpr double kSlowest_Hz = 0.1;
constexpr double kFastest_Hz = 8.0;
constexpr double kTaper_s = 0.3;  // at the end, to rest
constexpr int kLines = 6;         // of a multisine stretch

double frequency(double gene, double period_s) {
  const double fastest = std::min(kFastest_Hz, 0.2 / period_s);
  return kSlowest_Hz * std::pow(fastest / kSlowest_Hz, gene);
}

/// The course of a stretch in [-1, 1].
class Wave {
 public:
  Wave(const Gene& gene, double period_s, double length_s, std::uint64_t stretch)
      : shape_(gene.shape),
        length_s_(length_s),
        slow_(frequency(gene.slow, period_s)),
        fast_(frequency(gene.fast, period_s)),
        pattern_(gene.pattern),
        seed_(static_cast<std::uint64_t>(gene.pattern * 1e9) + 1000003 * stretch) {
    if (fast_ < slow_) std::swap(slow_, fast_);
    Rng rng(seed_, kRngSelect, 1);
    for (double& phase : phase_) phase = 2 * M_PI * rng.uniform();
  }

  double at(double t) const {
    switch (shape_) {
      case Shape::multisine: return multisine(t);
      case Shape::chirp: return std::sin(2 * M_PI * (slow_ * t + 0.5 * (fast_ - slow_) * t * t / length_s_));
      case Shape::steps: return level(static_cast<std::uint64_t>(t * 2 * slow_));
      case Shape::square: return std::sin(2 * M_PI * fast_ * t + phase_[0]) >= 0 ? 1.0 : -1.0;
      case Shape::hold_release: return t < (0.2 + 0.6 * pattern_) * length_s_ ? 1.0 : 0.0;
      default: return 2 / M_PI * std::asin(std::sin(2 * M_PI * slow_ * t + phase_[0]));
    }
  }

 private:
  double multisine(double t) const {
    double sum = 0;
    for (int i = 0; i < kLines; ++i)
      sum += std::sin(2 * M_PI * (slow_ + (fast_ - slow_) * i / (kLines - 1)) * t + phase_[i]);
    return std::clamp(sum / 3.0, -1.0, 1.0);  // 3: the sum of six rarely exceeds it
  }
  double level(std::uint64_t index) const {
    Rng rng(seed_, kRngSelect, 2 + index);
    return 2 * rng.uniform() - 1;
  }

  Shape shape_;
  double length_s_, slow_, fast_, pattern_;
  std::uint64_t seed_;
  double phase_[kLines];
};

double middle(const InputRange& r) { return 0.5 * (r.low + r.high); }
double half(const InputRange& r) { return 0.5 * (r.high - r.low); }

/// Rest at both ends, within range, no faster than allowed.
void tame(InputSequence& s, const std::vector<InputRange>& range) {
  const std::size_t points = s.points();
  for (std::uint32_t i = 0; i < s.inputs; ++i) {
    const InputRange& r = range[i];
    double before = r.rest;
    for (std::size_t k = 0; k < points; ++k) {
      double& u = s.value[k * s.inputs + i];
      const double left_s = s.period_s * static_cast<double>(points - 1 - k);
      u = r.rest + (u - r.rest) * std::min(1.0, left_s / kTaper_s);
      const double most = r.rate_per_s * s.period_s;
      u = std::clamp(std::clamp(u, before - most, before + most), r.low, r.high);
      before = u;
    }
  }
}

InputSequence empty_sequence(std::size_t inputs, double period_s, double seconds) {
  InputSequence s;
  s.period_s = period_s;
  s.inputs = static_cast<std::uint32_t>(inputs);
  s.value.assign(static_cast<std::size_t>(std::max(2.0, std::round(seconds / period_s))) * inputs, 0.0);
  return s;
}

}  // namespace

double& number_of(Gene& gene, int i) {
  double* const numbers[kGeneNumbers] = {&gene.amplitude, &gene.offset, &gene.slow, &gene.fast, &gene.pattern};
  return *numbers[i];
}

std::uint32_t stretches_of(double seconds) {
  return static_cast<std::uint32_t>(std::clamp(std::round(seconds / 2.5), 1.0, 6.0));
}

std::vector<double> rms_of(const InputSequence& s, const std::vector<InputRange>& range) {
  std::vector<double> rms(s.inputs, 0.0);
  for (std::size_t k = 0; k < s.value.size(); ++k) {
    const double off = s.value[k] - range[k % s.inputs].rest;
    rms[k % s.inputs] += off * off;
  }
  for (double& r : rms) r = std::sqrt(r / static_cast<double>(s.points()));
  return rms;
}

InputSequence express(const SequenceCode& code, const std::vector<InputRange>& range, double period_s, double seconds) {
  InputSequence s = empty_sequence(range.size(), period_s, seconds);
  const std::size_t stretches = code.genes.size() / range.size(), points = s.points();
  const double length_s = s.seconds() / static_cast<double>(stretches);
  for (std::size_t g = 0; g < code.genes.size(); ++g) {
    const Gene& gene = code.genes[g];
    const std::size_t stretch = g / range.size(), input = g % range.size();
    const InputRange& r = range[input];
    const Wave wave(gene, period_s, length_s, g);
    const double amplitude = half(r) * kSmallest * std::pow(1 / kSmallest, gene.amplitude);
    const double centre = middle(r) + half(r) * (2 * gene.offset - 1) * (1 - amplitude / half(r));
    for (std::size_t k = stretch * points / stretches; k < (stretch + 1) * points / stretches; ++k) {
      const double t = period_s * static_cast<double>(k) - static_cast<double>(stretch) * length_s;
      s.value[k * s.inputs + input] = centre + amplitude * wave.at(t);
    }
  }
  tame(s, range);
  return s;
}

InputSequence default_multisine(const std::vector<InputRange>& range, const std::vector<double>& rms, double period_s,
                                double seconds) {
  constexpr int kTones = 12;
  InputSequence s = empty_sequence(range.size(), period_s, seconds);
  const double fastest = std::min(4.0, 0.2 / period_s);
  for (std::uint32_t i = 0; i < s.inputs; ++i) {
    for (std::size_t k = 0; k < s.points(); ++k) {
      const double t = period_s * static_cast<double>(k);
      double sum = 0;
      for (int n = 0; n < kTones; ++n) {
        const double f = 0.2 + (fastest - 0.2) * n / (kTones - 1);
        sum += std::sin(2 * M_PI * f * t - M_PI * n * n / kTones + i);
      }
      s.value[k * s.inputs + i] = range[i].rest + rms[i] * std::sqrt(2.0 / kTones) * sum;
    }
  }
  tame(s, range);
  // what the taper and the limits took
  for (int pass = 0; pass < 5; ++pass) {
    const std::vector<double> is = rms_of(s, range);
    for (std::size_t k = 0; k < s.value.size(); ++k) {
      const std::size_t i = k % s.inputs;
      if (is[i] > 0) s.value[k] = range[i].rest + (s.value[k] - range[i].rest) * rms[i] / is[i];
    }
    tame(s, range);
  }
  return s;
}

InputSequence scaled(const InputSequence& sequence, const std::vector<InputRange>& range, double share) {
  InputSequence s = sequence;
  for (std::size_t k = 0; k < s.value.size(); ++k) {
    const double rest = range[k % s.inputs].rest;
    s.value[k] = rest + share * (s.value[k] - rest);
  }
  return s;
}

}  // namespace tiller::tools::gap
