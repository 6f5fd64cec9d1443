#include "posterior/adequacy.hpp"

#include <algorithm>
#include <cmath>

#include "tiller/math.hpp"

namespace tiller {

namespace {

/// Values beyond this many deviations count as this many: a glitch that came through the gate is no trend, and S^2 / V,
/// which is largest where all terms are alike, gains by it where the effect is large.
constexpr double kClip = 2.5;
/// In the likelihood ratio of `size`, which grows with the square. Clipping both sides of a ratio that rises with |y|
/// only lowers it, so the level holds.
constexpr double kSizeClip = 3.0;
/// Of a feature, in units of its own root mean square where it is not zero; for the same two reasons.
constexpr double kFeatureClip = 1.5;
/// In the estimate of the noise's scale.
constexpr double kScaleClip = 4.0;
/// r, in squared deviations: some twentieth of the information at which an alarm is hoped for (V = 100 to 200 after as
/// many ticks of a feature of unit size), where log E loses least, about 2, to the mixture (Howard et al., section
/// 3.5).
constexpr double kMixing = 6.0;
/// Share of the level for the sums that begin with the run.
constexpr double kFirstShare = 0.5;
/// Deviations times this is the alternative of `size`. It gains evidence from 1.4 times on.
constexpr double kGrowth = 2.0;
/// Ticks over which a feature's size is averaged.
constexpr double kScaleTicks = 256.0;
/// Share of the newest value in the mean of those before.
constexpr double kRecent = 0.2;

/// See lay_out.
constexpr double kOverlap = 1.5;
/// Share of the usual speed below which its sign says nothing.
constexpr double kStill = 0.1;

double clip(double value, double most) { return std::fmax(-most, std::fmin(most, value)); }

}  // namespace

std::uint32_t velocity_state(const tiller_model_t& model, std::uint32_t i) {
  for (std::uint32_t j = 0; j < model.joint_count; ++j)
    if (model.joints[j].position == i || model.joints[j].velocity == i) return model.joints[j].velocity;
  return model.state_count;
}

std::uint32_t position_state(const tiller_model_t& model, std::uint32_t i) {
  for (std::uint32_t j = 0; j < model.joint_count; ++j)
    if ((model.joints[j].position == i || model.joints[j].velocity == i) &&
        model.joints[j].position != TILLER_NO_POSITION)
      return model.joints[j].position;
  return model.state_count;
}

void Disturbances::observe(std::uint32_t channels, std::uint32_t inputs, const double* velocity, const double* position,
                           const double* input, double (*phi)[kMaxDisturbances]) {
  count_ += 1.0;
  for (std::uint32_t k = 0; k < channels; ++k) {
    const double v = velocity[k];
    double& square = velocity_square_[k];
    square += (v * v - square) / std::fmin(count_, kScaleTicks);
    phi[k][kBias] = 1.0;
    phi[k][kVelocity] = v;
    phi[k][kSign] = v * v > kStill * kStill * square ? std::copysign(1.0, v) : 0.0;
    phi[k][kPosition] = position ? position[k] : 0.0;
    for (std::uint32_t j = 0; j < inputs; ++j) {
      phi[k][kInputs + 2 * j] = input[j];
      phi[k][kInputs + 2 * j + 1] = begun_ ? input[j] - before_[j] : 0.0;
    }
  }
  for (std::uint32_t j = 0; j < inputs; ++j) before_[j] = input[j];
  begun_ = true;
}

AdequacyTest* AdequacyTest::lay_out(Arena& arena, const tiller_config_t& config, bool overlap, std::uint32_t forces) {
  const std::uint32_t channels = config.measurement_count;
  const std::uint32_t disturbances = disturbance_count(config.model->input_count), features = disturbances + 2;
  auto* t = arena.take<AdequacyTest>(1);
  auto* channel_data = arena.take<Channel>(channels);
  auto* sums = arena.take<Sums>(std::size_t{channels} * features * kCohorts);
  auto* growth = arena.take<double>(std::size_t{channels} * kCohorts);
  if (arena.measuring() || !arena.fits()) return nullptr;
  t->channels_ = channels;
  t->disturbances_ = disturbances;
  t->features_ = features;
  t->shape_ = std::fmax(config.posterior.noise_scale_shape, 0.5);
  t->overlap_ = overlap;
  t->channel_data_ = channel_data;
  t->sums_ = sums;
  t->growth_ = growth;
  const double tests = 1.0 * channels * (features + 1) + forces;
  const double cohorts = std::ceil(1.0 * kLevelTicks / kSpacing);
  t->first_threshold_ = math::log(tests / (kFirstShare * kLevel));
  t->threshold_ = math::log(tests * cohorts / ((1.0 - kFirstShare) * kLevel));
  t->reset();
  return t;
}

void AdequacyTest::reset() {
  state_ = tiller_adequacy_untested;
  channel_ = 0;
  feature_ = tiller_feature_none;
  statistic_ = 0.0;
  by_force_ = false;
  restart();
}

void AdequacyTest::restart() {
  for (std::uint32_t k = 0; k < channels_; ++k) channel_data_[k] = {};
  for (std::uint32_t i = 0; i < channels_ * features_ * kCohorts; ++i) sums_[i] = {};
  for (std::uint32_t i = 0; i < channels_ * kCohorts; ++i) growth_[i] = 0.0;
  for (std::uint32_t& held : held_) held = 0;
  ticks_ = 0;
  sounds_ = false;
  begin();
}

void AdequacyTest::begin() {
  settling_ = kSettling;
  for (std::uint32_t k = 0; k < channels_; ++k)
    channel_data_[k].last = channel_data_[k].previous = channel_data_[k].recent = 0.0;
}

void AdequacyTest::begin_cohort() {
  const auto c = static_cast<std::uint32_t>(ticks_ / kSpacing % kCohorts);
  for (std::uint32_t i = 0; i < channels_ * features_; ++i) sums_[i * kCohorts + c] = {};
  for (std::uint32_t k = 0; k < channels_; ++k) growth_[k * kCohorts + c] = 0.0;
}

/// All of them are known before the innovation is.
void AdequacyTest::features_of(Channel& channel, const double* response, double* feature) const {
  for (std::uint32_t f = 0; f < disturbances_; ++f) {
    double& square = channel.response_square[f];
    if (response[f] != 0.0) {
      double& seen = channel.response_count[f];
      seen = std::fmin(seen + 1.0, kScaleTicks);
      square += (response[f] * response[f] - square) / seen;
    }
    feature[f] = square > 0.0 ? clip(response[f] / std::sqrt(square), kFeatureClip) : 0.0;
  }
  feature[disturbances_] = channel.previous;
  feature[disturbances_ + 1] = channel.recent;
}

void AdequacyTest::remember(Channel& channel, double y) const {
  channel.previous = overlap_ ? channel.last : y;
  channel.last = y;
  channel.recent += kRecent * (channel.previous - channel.recent);
}

/// Excess variance of the sum of a feature's products over that of independent ones.
double AdequacyTest::variance_share(std::uint32_t feature) const {
  const bool alternates =
      feature == disturbances_ || (feature >= kInputs && feature < disturbances_ && (feature - kInputs) % 2 == 1);
  return overlap_ && alternates ? kOverlap : 1.0;
}

void AdequacyTest::take(const Innovation& innovation) {
  const bool settled = settling_ == 0;
  if (!settled) --settling_;
  if (settled && ticks_ % kSpacing == 0) begin_cohort();
  largest_ = -HUGE_VAL;
  sounds_ = false;
  for (std::uint32_t k = 0; k < channels_; ++k) {
    Channel& channel = channel_data_[k];
    const double z = innovation.normalised[k];
    residual_[k] = NAN;
    if (!std::isfinite(z)) {
      channel.previous = overlap_ ? channel.last : 0.0;
      channel.last = 0.0;
      continue;
    }
    double feature[kMaxFeatures];
    features_of(channel, innovation.response[k], feature);
    const double scale = std::sqrt((shape_ + 0.5 * channel.squares) / (shape_ + 0.5 * channel.count));
    const double y = clip(z / scale, kClip), kept = clip(z, kScaleClip * scale);
    residual_[k] = z / scale;
    if (settled) test_channel(k, z / scale, feature);
    remember(channel, y);
    // measured states' are over the deviation that is estimated, which begins at the configured one
    if (overlap_ && !settled) continue;
    channel.squares += kept * kept;
    channel.count += 1.0;
  }
  if (!settled) return;
  ++ticks_;
  sounds_ = largest_ > 1.0;
  if (stands() || (by_force_ && !sounds_)) return;
  by_force_ = false;
  statistic_ = std::fmax(0.0, largest_);
  state_ = largest_ > 1.0 ? tiller_adequacy_inadequate : tiller_adequacy_adequate;
}

void AdequacyTest::test_channel(std::uint32_t k, double normalised, const double* feature) {
  const double y = clip(normalised, kClip);
  for (std::uint32_t f = 0; f < features_; ++f) {
    const double by = feature[f] * y, variance = variance_share(f) * feature[f] * feature[f] * (y * y + 2.0) / 3.0;
    Sums* sums = sums_ + (k * features_ + f) * kCohorts;
    for (std::uint32_t c = 0; c < kCohorts; ++c) {
      sums[c].s += by;
      sums[c].v += variance;
      if (f >= disturbances_ && sums[c].s < 0.0) continue;
      const double information = sums[c].v + kMixing, exponent = 0.5 * sums[c].s * sums[c].s / information;
      const double threshold = threshold_of(c);
      // the logarithm only where it can matter
      if (exponent > largest_ * threshold) note((exponent - 0.5 * math::log(information / kMixing)) / threshold, k, f);
    }
  }
  // Student density of nu degrees of freedom, kGrowth times as wide, over itself
  const double nu = 2.0 * shape_ + channel_data_[k].count,
               square = std::fmin(normalised * normalised, kSizeClip * kSizeClip);
  const double gain = 0.5 * (nu + 1.0) * math::log((1.0 + square / nu) / (1.0 + square / (kGrowth * kGrowth * nu))) -
                      math::log(kGrowth);
  for (std::uint32_t c = 0; c < kCohorts; ++c) {
    growth_[k * kCohorts + c] += gain;
    note(growth_[k * kCohorts + c] / threshold_of(c), k, features_);
  }
}

/// One likelihood ratio from the run's begin on, under the thresholds of the sums: that of those that begin with the
/// run while they live, later that of one cohort in all. A force that may change need not be the same in each. It must
/// stand for kSpacing ticks, which only makes alarms rarer: a blow in a still world is taken for anything at first.
void AdequacyTest::take_force(std::uint32_t force, std::uint32_t channel, tiller_feature_t feature, double evidence) {
  const double ratio = evidence / threshold_of(0);
  held_[force] = ratio > 1.0 ? std::min(held_[force] + 1, kSpacing) : 0;
  const bool alarm = held_[force] == kSpacing;
  if (state_ != tiller_adequacy_adequate || !(alarm || std::fmin(ratio, 1.0) > statistic_)) return;
  statistic_ = alarm ? ratio : std::fmin(ratio, 1.0);
  channel_ = channel;
  feature_ = feature;
  by_force_ = alarm;
  if (alarm) state_ = tiller_adequacy_inadequate;
}

/// The first cohort stands in slot 0 until its life is over.
double AdequacyTest::threshold_of(std::uint32_t cohort) const {
  return cohort == 0 && ticks_ < std::uint64_t{kSpacing} * kCohorts ? first_threshold_ : threshold_;
}

void AdequacyTest::note(double ratio, std::uint32_t k, std::uint32_t feature) {
  if (!(ratio > largest_)) return;
  largest_ = ratio;
  if (stands() || (by_force_ && ratio <= 1.0)) return;
  channel_ = k;
  feature_ = name_of(feature);
}

tiller_feature_t AdequacyTest::name_of(std::uint32_t feature) const {
  if (feature >= features_) return tiller_feature_size;
  if (feature >= disturbances_) return tiller_feature_previous;
  if (feature >= kInputs) return (feature - kInputs) % 2 == 0 ? tiller_feature_input : tiller_feature_input_change;
  switch (feature) {
    case kVelocity: return tiller_feature_velocity;
    case kSign: return tiller_feature_velocity_sign;
    case kPosition: return tiller_feature_position;
    default: return tiller_feature_bias;
  }
}

}  // namespace tiller
