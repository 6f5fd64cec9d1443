#pragma once

// Proposals in lanes. Included by transition_lanes_isa.cpp alone.

#include "posterior/transition/proposal_lanes.hpp"
#include "scalar/lane_random.hpp"

TILLER_ISA_NAMESPACE_BEGIN

namespace proposal {

using P = Pack<double>;
constexpr std::uint32_t kMax = kMaxCoordinates;
constexpr std::uint32_t kGroup = 16;  // lanes at a time
// words: kind, whole difference, length, acceptance, two partners, the chi square's four, the normals
constexpr std::uint32_t kChi = 6, kNormals = 10, kWords = kProposalWords;

// as posterior/proposals.cpp, where the reasons stand
constexpr double kOptimalStep = 2.38, kEvolution = 0.7, kWholeDifference = 0.1, kJitter = 0.05;
/// Degrees of freedom of the independent draws: tails heavier than any posterior's of noise known to a few values.
constexpr double kFreedom = 8.0;

/// Mean and lower Cholesky factor of the particles that stand still.
struct Spread {
  double mean[kMax] = {}, factor[kMax * kMax] = {};  // row-major, stride d
  bool whole = true;                                 // the factor is regular
};

/// Elements of the second moments that are summed up at a time: more take more stack. All of eight coordinates, and one
/// row of the most.
constexpr std::uint32_t kMostAtOnce = kMax > 36 ? kMax : 36;

/// Weighted sums over particles [begin, end) about `origin`: first and second moments of rows [from, to).
inline void add_rows(const ProposalJob& job, std::uint32_t begin, std::uint32_t end, const double* origin,
                     std::uint32_t from, std::uint32_t to, double& weight, double* first, double* second) {
  P w_sum(0.0), sum[kMax], square[kMostAtOnce];
  for (std::uint32_t r = from, i = 0; r < to; ++r) {
    sum[r] = P(0.0);
    for (std::uint32_t c = 0; c <= r; ++c) square[i++] = P(0.0);
  }
  for (std::uint32_t k = begin; k < end; k += static_cast<std::uint32_t>(P::width)) {
    const P w = P::load(job.weight + k);
    P off[kMax];
    w_sum = w_sum + w;
    const auto distance = [&](std::uint32_t r) { return P::load(job.coordinate + r * job.n + k) - P(origin[r]); };
    for (std::uint32_t r = 0; r < from; ++r) off[r] = distance(r);
    for (std::uint32_t r = from, i = 0; r < to; ++r) {
      off[r] = distance(r);
      const P weighted = w * off[r];
      sum[r] = sum[r] + weighted;
      for (std::uint32_t c = 0; c <= r; ++c, ++i) square[i] = fma(weighted, off[c], square[i]);
    }
  }
  if (from == 0) weight += reduce_add(w_sum);
  for (std::uint32_t r = from, i = 0; r < to; ++r) {
    first[r] += reduce_add(sum[r]);
    for (std::uint32_t c = 0; c <= r; ++c, ++i) second[r * (r + 1) / 2 + c] += reduce_add(square[i]);
  }
}

inline void add_moments(const ProposalJob& job, std::uint32_t begin, std::uint32_t end, const double* origin,
                        double& weight, double* first, double* second) {
  if (begin >= end) return;
  for (std::uint32_t from = 0, to = 0; from < job.d; from = to) {
    for (std::uint32_t elements = 0; to < job.d && elements + to + 1 <= kMostAtOnce; ++to) elements += to + 1;
    add_rows(job, begin, end, origin, from, to, weight, first, second);
  }
}

inline void find_spread(const ProposalJob& job, Spread& s) {
  const std::uint32_t d = job.d, end = job.cursor + job.moves;
  double weight = 0.0, first[kMax] = {}, second[kMax * (kMax + 1) / 2] = {}, origin[kMax];
  for (std::uint32_t r = 0; r < d; ++r) origin[r] = job.coordinate[r * job.n + end % job.n];
  if (end <= job.n) {
    add_moments(job, 0, job.cursor, origin, weight, first, second);
    add_moments(job, end, job.n, origin, weight, first, second);
  } else {
    add_moments(job, end - job.n, job.cursor, origin, weight, first, second);
  }
  if (!(weight > 0.0)) {
    s.whole = false;
    return;
  }
  for (std::uint32_t r = 0; r < d; ++r) s.mean[r] = first[r] / weight;
  for (std::uint32_t r = 0, i = 0; r < d; ++r) {
    for (std::uint32_t c = 0; c <= r; ++c, ++i) {
      const double variance = second[i] / weight - s.mean[r] * s.mean[c];
      double rest = variance;
      for (std::uint32_t k = 0; k < c; ++k) rest -= s.factor[r * d + k] * s.factor[c * d + k];
      const double pivot = s.factor[c * d + c];
      if (r != c) {
        s.factor[r * d + c] = pivot > 0.0 ? rest / pivot : 0.0;
      } else {
        // coordinates that are functions of one another leave nothing: the walk then stays on their line
        if (!(rest > 1e-10 * variance)) s.whole = false;
        s.factor[r * d + r] = rest > 0.0 ? __builtin_sqrt(rest) : 0.0;
      }
    }
  }
  for (std::uint32_t r = 0; r < d; ++r) s.mean[r] += origin[r];
}

/// The random numbers of a group of lanes: words keyed by (seed, batch, row) at the particles' numbers.
struct Draws {
  alignas(64) std::uint32_t words[kWords][kGroup];
  alignas(64) double uniform[kWords][kGroup];

  void fill(const std::uint32_t (*keys)[2], std::uint32_t d, const std::uint32_t* particle) {
    for (std::uint32_t row = 0; row < kNormals + (d + 1) / 2 * 2; ++row) {
      for (std::uint32_t l = 0; l < kGroup; l += static_cast<std::uint32_t>(IntPack::width))
        keyed_word(IntPack::load(particle + l), keys[row][0], keys[row][1]).store(words[row] + l);
      for (std::uint32_t l = 0; l < kGroup; ++l)
        uniform[row][l] = (static_cast<double>(words[row][l]) + 0.5) * (1.0 / 4294967296.0);
    }
  }
};

/// Pairs of standard normals by Box and Muller.
inline void normals(const Draws& draws, std::uint32_t d, std::uint32_t lane, P* z) {
  for (std::uint32_t j = 0; j < d; j += 2) {
    const P radius = sqrt(P(-2.0) * log(P::load(draws.uniform[kNormals + j] + lane)));
    P sine, cosine;
    sincos(P(6.283185307179586) * P::load(draws.uniform[kNormals + j + 1] + lane), sine, cosine);
    z[j] = radius * cosine;
    if (j + 1 < d) z[j + 1] = radius * sine;
  }
}

/// log density of the Student-t up to a constant, z whitened.
inline P log_student(const P* z, std::uint32_t d) {
  P square(0.0);
  for (std::uint32_t j = 0; j < d; ++j) square = fma(z[j], z[j], square);
  return P(-0.5 * (kFreedom + d)) * log(fma(square, P(1.0 / kFreedom), P(1.0)));
}

inline void propose_group(const ProposalJob& job, const Spread& spread, const std::uint32_t (*keys)[2],
                          std::uint32_t at) {
  const std::uint32_t d = job.d, n = job.n, first_still = (job.cursor + job.moves) % n, still = n - job.moves;
  alignas(64) std::uint32_t particle[kGroup];
  for (std::uint32_t l = 0; l < kGroup; ++l) {
    const std::uint32_t m = at + l < job.moves ? at + l : 0, i = job.cursor + m;
    particle[l] = i < n ? i : i - n;
  }
  Draws draws;
  draws.fill(keys, d, particle);
  alignas(64) double difference[kMax][kGroup];
  for (std::uint32_t l = 0; l < kGroup; ++l) {
    std::uint32_t a = first_still + static_cast<std::uint32_t>((std::uint64_t{draws.words[4][l]} * still) >> 32);
    std::uint32_t b = first_still + static_cast<std::uint32_t>((std::uint64_t{draws.words[5][l]} * still) >> 32);
    a = a < n ? a : a - n;
    b = b < n ? b : b - n;
    for (std::uint32_t j = 0; j < d; ++j) {
      const double* row = job.coordinate + j * n;
      difference[j][l] = row[a] - row[b];
      job.present[j * job.stride + at + l] = row[particle[l]];
    }
  }
  const double best = kOptimalStep / __builtin_sqrt(static_cast<double>(d));
  const double independent = spread.whole ? job.independent : 0.0;
  for (std::uint32_t lane = 0; lane < kGroup; lane += static_cast<std::uint32_t>(P::width)) {
    const std::uint32_t column = at + lane;
    const auto uniform = [&](std::uint32_t i) { return P::load(draws.uniform[i] + lane); };
    const P kind = uniform(0), length = uniform(2);
    const auto fresh = kind < P(independent);
    const auto evolves = kind < P(independent + (1.0 - independent) * kEvolution);
    const auto whole = uniform(1) < P(kWholeDifference);
    const P step = select(evolves, select(whole, P(1.0), P(best * 0.70710678) * fma(P(0.7), length, P(0.3))), P(0.0));
    // a decade of lengths for the walk: far and near both occur
    const P noise = select(evolves, P(kJitter), P(best) * exp(P(-2.3) * length));
    const P chi = P(-2.0) * log(uniform(kChi) * uniform(kChi + 1) * uniform(kChi + 2) * uniform(kChi + 3));
    const P scale = select(fresh, sqrt(P(kFreedom) / chi), noise);

    P z[kMax], back[kMax];
    normals(draws, d, lane, z);
    for (std::uint32_t j = 0; j < d; ++j) z[j] = z[j] * scale;
    auto inside = P(0.0) == P(0.0);
    for (std::uint32_t j = 0; j < d; ++j) {
      const P here = P::load(job.present + j * job.stride + column);
      P walk(0.0);
      for (std::uint32_t k = 0; k <= j; ++k) walk = fma(P(spread.factor[j * d + k]), z[k], walk);
      const P to = select(fresh, P(spread.mean[j]), fma(step, P::load(difference[j] + lane), here)) + walk;
      // no reflection at a bound: of one coordinate of a correlated step it is not symmetric
      inside = inside & (to >= P(job.low[j])) & (to <= P(job.high[j]));
      to.store(job.proposed + j * job.stride + column);
      // whitened present, for its density
      back[j] = here - P(spread.mean[j]);
      for (std::uint32_t k = 0; k < j; ++k) back[j] = back[j] - P(spread.factor[j * d + k]) * back[k];
      back[j] = back[j] / P(spread.whole ? spread.factor[j * d + j] : 1.0);
    }
    P change = select(fresh, log_student(back, d) - log_student(z, d), P(0.0));
    change = select(inside, change, P(-__builtin_huge_val()));
    change.store(job.log_change + column);
    log(uniform(3)).store(job.log_uniform + column);
    for (std::uint32_t j = 0; j < d; ++j) {
      double* to = job.proposed + j * job.stride + column;
      select(inside, P::load(to), P::load(job.present + j * job.stride + column)).store(to);
    }
  }
}

}  // namespace proposal

inline void propose_lanes(const ProposalJob& job) {
  proposal::Spread spread;
  proposal::find_spread(job, spread);
  *job.whole = spread.whole;
  for (std::uint32_t at = 0; at < job.moves; at += proposal::kGroup) proposal::propose_group(job, spread, job.keys, at);
}

TILLER_ISA_NAMESPACE_END
