#include "posterior/filter/response.hpp"

#include <cmath>

namespace tiller {

DisturbanceResponse* DisturbanceResponse::lay_out(Arena& arena, const tiller_config_t& config) {
  const std::uint32_t nx = config.model->state_count, nu = config.model->input_count, ny = config.measurement_count;
  auto* r = arena.take<DisturbanceResponse>(1);
  auto* joint = arena.take<double>(std::size_t{ny} * kInputs * nx);
  auto* input = arena.take<double>(std::size_t{2} * nu * nx);
  auto* next = arena.take<double>(nx);
  if (arena.measuring() || !arena.fits()) return nullptr;
  r->config_ = &config;
  r->nx_ = nx;
  r->nu_ = nu;
  r->ny_ = ny;
  r->joint_ = joint;
  r->input_ = input;
  r->next_ = next;
  return r;
}

void DisturbanceResponse::begin() {
  for (std::uint32_t i = 0; i < ny_ * kInputs * nx_; ++i) joint_[i] = 0.0;
  for (std::uint32_t i = 0; i < 2 * nu_ * nx_; ++i) input_[i] = 0.0;
  course_.begin();
}

double* DisturbanceResponse::trace_of(std::uint32_t channel, std::uint32_t disturbance) {
  if (disturbance >= kInputs) return input_ + (disturbance - kInputs) * nx_;
  return joint_ + (channel * kInputs + disturbance) * nx_;
}

void DisturbanceResponse::predict(const ErrorDynamics& error, double period_s, const double* velocity,
                                  const double* input, Innovation& now) {
  const auto advance = [&](double* trace) {
    for (std::uint32_t r = 0; r < nx_; ++r) {
      next_[r] = 0.0;
      for (std::uint32_t c = 0; c < nx_; ++c) next_[r] += error.a[(r * nx_ + c) * error.stride] * trace[c];
    }
    for (std::uint32_t r = 0; r < nx_; ++r) trace[r] = next_[r];
  };
  double phi[TILLER_MAX_MEASUREMENTS][kMaxDisturbances];
  course_.observe(ny_, nu_, velocity, input, phi);
  for (std::uint32_t k = 0; k < ny_; ++k) {
    const std::uint32_t state = config_->measured_state[k], rate = velocity_state(*config_->model, state);
    for (std::uint32_t f = 0; f < kInputs; ++f) {
      double* trace = trace_of(k, f);
      advance(trace);
      const double push = period_s * phi[k][f];
      if (rate < nx_) trace[rate] += push;
      if (rate != state) trace[state] += rate < nx_ ? 0.5 * period_s * push : push;
      now.response[k][f] = trace[state];
    }
  }
  for (std::uint32_t f = kInputs; f < disturbance_count(nu_); ++f) {
    const std::uint32_t j = (f - kInputs) / 2;
    double* trace = trace_of(0, f);
    advance(trace);
    for (std::uint32_t r = 0; r < nx_; ++r) trace[r] += error.b[(r * nu_ + j) * error.stride] * phi[0][f];
    for (std::uint32_t k = 0; k < ny_; ++k) now.response[k][f] = trace[config_->measured_state[k]];
  }
}

void DisturbanceResponse::correct(const ErrorDynamics& error, const unsigned char* used,
                                  const double* measurement_variance) {
  double p[triangle_rows(TILLER_MAX_STATES)], column[TILLER_MAX_STATES];
  for (std::uint32_t i = 0; i < triangle_rows(nx_); ++i) p[i] = error.covariance[i];
  for (std::uint32_t k = 0; k < ny_; ++k) {
    if (!used[k]) continue;
    const std::uint32_t m = config_->measured_state[k];
    for (std::uint32_t i = 0; i < nx_; ++i) column[i] = p[i < m ? triangle_row(nx_, i, m) : triangle_row(nx_, m, i)];
    const double inverse = 1.0 / std::fmax(kVarianceFloor, column[m] + measurement_variance[k]);
    const auto pull = [&](double* trace) {
      const double seen = trace[m] * inverse;
      for (std::uint32_t r = 0; r < nx_; ++r) trace[r] -= column[r] * seen;
    };
    for (std::uint32_t i = 0; i < ny_ * kInputs; ++i) pull(joint_ + i * nx_);
    for (std::uint32_t i = 0; i < 2 * nu_; ++i) pull(input_ + i * nx_);
    for (std::uint32_t r = 0; r < nx_; ++r)
      for (std::uint32_t c = r; c < nx_; ++c) p[triangle_row(nx_, r, c)] -= column[r] * inverse * column[c];
  }
}

}  // namespace tiller
