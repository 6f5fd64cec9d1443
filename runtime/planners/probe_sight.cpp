#include "planners/probe_sight.hpp"

#include <cmath>

namespace tiller {
namespace {

constexpr int kMostSteps = 400;
constexpr double kSettled = 1e-4;  // change of a variance in a step, relative

/// Covariance of position and velocity.
struct Covariance {
  double pp = 0.0, pv = 0.0, vv = 0.0;
};

/// One reading of position (velocity: of the other) with this noise: gains and innovation variance.
struct Update {
  double variance = 0.0, to_position = 0.0, to_velocity = 0.0;
};

Update read(Covariance& c, bool velocity, double noise) {
  const double own = velocity ? c.vv : c.pp, p = velocity ? c.pv : c.pp, v = velocity ? c.vv : c.pv;
  Update update;
  update.variance = own + noise;
  if (!(update.variance > 0.0)) return update;
  update.to_position = p / update.variance;
  update.to_velocity = v / update.variance;
  c.pp -= update.to_position * p;
  c.pv -= update.to_position * v;
  c.vv -= update.to_velocity * v;
  return update;
}

}  // namespace

void ProbeSight::settle(Follower& f, const StateSpread& spread) const {
  const std::size_t nx = spread.states;
  const auto process = [&](std::uint32_t i, std::uint32_t j) { return spread.process[i * nx + j]; };
  const double noise_p = spread.sensor_variance[f.position];
  const double noise_v = f.moves ? spread.sensor_variance[f.velocity] : HUGE_VAL;
  Covariance c{process(f.position, f.position), 0.0, 0.0};
  Update p, v;
  double before = -1.0;
  for (int k = 0; k < kMostSteps; ++k) {
    if (f.moves) {
      c.pp += period_s_ * (2.0 * c.pv + period_s_ * c.vv) + process(f.position, f.position);
      c.pv += period_s_ * c.vv + process(f.position, f.velocity);
      c.vv += process(f.velocity, f.velocity);
    } else {
      c.pp += process(f.position, f.position);
    }
    const double trace = c.pp + period_s_ * period_s_ * c.vv;
    if (std::isfinite(noise_p)) p = read(c, false, noise_p);
    if (std::isfinite(noise_v)) v = read(c, true, noise_v);
    if (std::fabs(trace - before) <= kSettled * trace) break;
    before = trace;
  }
  const auto take = [](const Update& update, bool used) {
    Reading reading;
    reading.used = used && update.variance > 0.0;
    if (!reading.used) return reading;
    reading.per_deviation = static_cast<float>(1.0 / std::sqrt(update.variance));
    reading.to_position = static_cast<float>(update.to_position);
    reading.to_velocity = static_cast<float>(update.to_velocity);
    return reading;
  };
  f.of_position = take(p, std::isfinite(noise_p));
  f.of_velocity = take(v, std::isfinite(noise_v));
}

void ProbeSight::design(const tiller_model_t& model, double period_s, const StateSpread& spread) {
  states_ = model.state_count;
  period_s_ = period_s;
  followers_ = signals_ = 0;
  std::uint32_t joined = 0;
  const auto add = [&](Follower f) {
    settle(f, spread);
    const std::uint32_t signals = (f.of_position.used ? 1u : 0u) + (f.of_velocity.used ? 1u : 0u);
    if (signals == 0) return;
    signals_ += signals;
    follower_[followers_++] = f;
  };
  for (std::uint32_t j = 0; j < model.joint_count; ++j) {
    if (model.joints[j].position == TILLER_NO_POSITION) continue;
    Follower f;
    f.position = model.joints[j].position;
    f.velocity = model.joints[j].velocity;
    f.moves = true;
    joined |= (1u << f.position) | (1u << f.velocity);
    add(f);
  }
  for (std::uint32_t i = 0; i < states_; ++i) {
    if ((joined >> i) & 1u) continue;
    Follower f;
    f.position = i;
    add(f);
  }
}

void ProbeSight::follow(const Follower& f, const float* trajectory, std::uint32_t steps, std::uint32_t lanes,
                        std::uint32_t row, float* signal) const {
  const auto at = [&](std::uint32_t step, std::uint32_t state) {
    return trajectory + (std::size_t{step} * states_ + state) * lanes;
  };
  const float dt = static_cast<float>(period_s_);
  constexpr std::uint32_t kBlock = 16;  // lanes that are followed at once, in registers
  for (std::uint32_t first = 0; first < lanes; first += kBlock) {
    float p[kBlock], v[kBlock];
    for (std::uint32_t l = 0; l < kBlock; ++l) {
      p[l] = at(0, f.position)[first + l];
      v[l] = f.moves ? at(0, f.velocity)[first + l] : 0.0f;
    }
    for (std::uint32_t step = 1; step <= steps; ++step) {
      float* out = signal + (std::size_t{step - 1} * signals_ + row) * lanes + first;
      for (std::uint32_t l = 0; f.moves && l < kBlock; ++l) p[l] += dt * v[l];
      const auto read = [&](const Reading& reading, const float* measured, const float* expected) {
        for (std::uint32_t l = 0; l < kBlock; ++l) {
          const float off = measured[first + l] - expected[l];
          out[l] = reading.per_deviation * off;
          p[l] += reading.to_position * off;
          v[l] += reading.to_velocity * off;
        }
        out += lanes;
      };
      if (f.of_position.used) read(f.of_position, at(step, f.position), p);
      if (f.of_velocity.used) read(f.of_velocity, at(step, f.velocity), v);
    }
  }
}

void ProbeSight::whiten(const float* trajectory, std::uint32_t steps, std::uint32_t lanes, float* signal) const {
  std::uint32_t row = 0;
  for (std::uint32_t i = 0; i < followers_; ++i) {
    follow(follower_[i], trajectory, steps, lanes, row, signal);
    row += (follower_[i].of_position.used ? 1u : 0u) + (follower_[i].of_velocity.used ? 1u : 0u);
  }
}

}  // namespace tiller
