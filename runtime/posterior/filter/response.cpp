#include "posterior/filter/response.hpp"

#include <cmath>

namespace tiller {

DisturbanceResponse* DisturbanceResponse::lay_out(Arena& arena, const tiller_config_t& config, std::uint32_t states) {
  const std::uint32_t nu = config.model->input_count, ny = config.measurement_count;
  auto* r = arena.take<DisturbanceResponse>(1);
  auto* joint = arena.take<double>(std::size_t{ny} * kInputs * states);
  auto* input = arena.take<double>(std::size_t{2} * nu * states);
  auto* next = arena.take<double>(states);
  if (arena.measuring() || !arena.fits()) return nullptr;
  r->config_ = &config;
  r->nx_ = config.model->state_count;
  r->nf_ = states;
  r->nu_ = nu;
  r->ny_ = ny;
  r->joint_ = joint;
  r->input_ = input;
  r->next_ = next;
  return r;
}

void DisturbanceResponse::begin() {
  for (std::uint32_t i = 0; i < ny_ * kInputs * nf_; ++i) joint_[i] = 0.0;
  for (std::uint32_t i = 0; i < 2 * nu_ * nf_; ++i) input_[i] = 0.0;
  course_.begin();
}

double* DisturbanceResponse::trace_of(std::uint32_t channel, std::uint32_t disturbance) {
  if (disturbance >= kInputs) return input_ + (disturbance - kInputs) * nf_;
  return joint_ + (channel * kInputs + disturbance) * nf_;
}

void DisturbanceResponse::predict(const ErrorDynamics& error, double period_s, const double* velocity,
                                  const double* position, const double* input, Innovation& now) {
  const auto advance = [&](double* trace) {
    for (std::uint32_t r = 0; r < nf_; ++r) {
      next_[r] = 0.0;
      for (std::uint32_t c = 0; c < nf_; ++c) next_[r] += error.a[(r * nf_ + c) * error.stride] * trace[c];
    }
    for (std::uint32_t r = 0; r < nf_; ++r) trace[r] = next_[r];
  };
  double phi[TILLER_MAX_MEASUREMENTS][kMaxDisturbances];
  course_.observe(ny_, nu_, velocity, position, input, phi);
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
  double p[triangle_rows(kMaxFilterStates)], column[kMaxFilterStates];
  for (std::uint32_t i = 0; i < triangle_rows(nf_); ++i) p[i] = error.covariance[i];
  for (std::uint32_t k = 0; k < ny_; ++k) {
    if (!used[k]) continue;
    const std::uint32_t m = config_->measured_state[k];
    for (std::uint32_t i = 0; i < nf_; ++i) column[i] = p[i < m ? triangle_row(nf_, i, m) : triangle_row(nf_, m, i)];
    const double inverse = 1.0 / std::fmax(kVarianceFloor, column[m] + measurement_variance[k]);
    const auto pull = [&](double* trace) {
      const double seen = trace[m] * inverse;
      for (std::uint32_t r = 0; r < nf_; ++r) trace[r] -= column[r] * seen;
    };
    for (std::uint32_t i = 0; i < ny_ * kInputs; ++i) pull(joint_ + i * nf_);
    for (std::uint32_t i = 0; i < 2 * nu_; ++i) pull(input_ + i * nf_);
    for (std::uint32_t r = 0; r < nf_; ++r)
      for (std::uint32_t c = r; c < nf_; ++c) p[triangle_row(nf_, r, c)] -= column[r] * inverse * column[c];
  }
}

}  // namespace tiller
