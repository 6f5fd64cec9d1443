// Compiled once per instruction set. Nothing here may be an out-of-line function of the standard library (see
// tiller_isa_sources): plain arrays and packs only.

#include "planners/lane_table.hpp"
#include "scalar/lane_random.hpp"

TILLER_ISA_NAMESPACE_BEGIN
namespace {

using F = Pack<float>;
constexpr std::uint32_t kWidth = static_cast<std::uint32_t>(F::width);
constexpr float kInfinity = __builtin_huge_valf();
constexpr float kLargest = 3.402823466e38f;

// ---- noise --------------------------------------------------------------------------------------

/// Box-Muller: two independent normals from two words. The turn is folded to the half angle pi v / 2, |v| <= 1, where
/// short polynomials (minimax in v^2, errors 7e-9 and 5e-8) need no range reduction; the double-angle formulas give
/// the rest. The largest radius is sqrt(46 log 2) = 5.6, met once in 2^23 draws.
void normal_pair(IntPack radius_word, IntPack turn_word, F& first, F& second) {
  const F u = F(1.0f) - to_unit_float(radius_word);  // (0, 1]
  const F radius = sqrt(log(u) * F(-2.0f));
  const F v = fma(to_unit_float(turn_word), F(2.0f), F(-1.0f));
  const F z = v * v;
  F s = fma(z, F(0.0001516785319f), F(-0.0046741575f));
  s = fma(z, s, F(0.07968992687f));
  s = fma(z, s, F(-0.6459637613f));
  s = fma(z, s, F(1.57079632f)) * v;
  F c = fma(z, F(0.0008581906197f), F(-0.02081062755f));
  c = fma(z, c, F(0.2536507447f));
  c = fma(z, c, F(-1.233698215f));
  c = fma(z, c, F(0.9999999535f));
  first = radius * ((s + s) * c);
  second = radius * fma(s * F(-2.0f), s, F(1.0f));
}

void store_clamped(const SampleJob& job, std::uint32_t row, std::uint32_t lane, const F& normal) {
  const F x = fma(normal * F::load(job.scale + lane % kScales), F(job.sd[row]), F(job.mean[row]));
  min(max(x, F(job.low[row])), F(job.high[row])).store(job.knots + row * job.stride + lane);
}

/// Raw normals, or clamped samples around the mean.
template <bool kRaw>
void draw_rows(const SampleJob& job) {
  const auto store = [&job](std::uint32_t row, std::uint32_t lane, const F& normal) {
    if (kRaw)
      normal.store(job.knots + row * job.stride + lane);
    else
      store_clamped(job, row, lane, normal);
  };
  for (std::uint32_t pair = 0; 2 * pair < job.rows; ++pair) {
    const NoiseKey& key = job.keys[pair];
    const bool both = 2 * pair + 1 < job.rows;
    IntPack index = counting(job.first_rollout);
    for (std::uint32_t lane = 0; lane < job.lanes; lane += kWidth) {
      F first, second;
      normal_pair(keyed_word(index, key.word[0], key.word[1]), keyed_word(index, key.word[2], key.word[3]), first,
                  second);
      store(2 * pair, lane, first);
      if (both) store(2 * pair + 1, lane, second);
      index = index + IntPack(kWidth);
    }
  }
}

/// In place from the last knot back: a knot's sum reads those up to itself, which are still white.
void mix_rows(const SampleJob& job) {
  for (std::uint32_t first = 0; first < job.rows; first += job.row_knots)
    for (std::uint32_t lane = 0; lane < job.lanes; lane += kWidth)
      for (std::uint32_t j = job.row_knots; j-- > 0;) {
        const float* coefficient = job.mix + j * job.row_knots;
        F sum(0.0f);
        for (std::uint32_t i = 0; i <= j; ++i)
          sum = fma(F::load(job.knots + (first + i) * job.stride + lane), F(coefficient[i]), sum);
        store_clamped(job, first + j, lane, sum);
      }
}

void sample(const SampleJob& job) {
  if (!job.mix) return draw_rows<false>(job);
  draw_rows<true>(job);
  mix_rows(job);
}

// ---- controls -----------------------------------------------------------------------------------

/// Tangent at a knot between two secants, per knot spacing: their mean, cut to three times the flatter one, and zero at
/// a peak. That is inside the square of Fritsch and Carlson ("Monotone piecewise cubic interpolation", SIAM J. Numer.
/// Anal. 1980, section 4), so the curve is monotone between any two knots. sequence.cpp has it for numbers.
F knot_tangent(const F& a, const F& b) {
  const F steep = F(3.0f) * min(max(a, b), F(0.0f)), flat = F(3.0f) * max(min(a, b), F(0.0f));
  return min(max(F(0.5f) * (a + b), steep), flat);
}

/// Interpolation between two knots over the fraction of the way; for lines only the first two are read.
struct Segment {
  F from, slope, square, cube, low, high;
};

enum class Curve { line, cubic, stair };

template <Curve kCurve>
Segment make_segment(const F& before, const F& from, const F& to, const F& after) {
  Segment s;
  s.from = from;
  s.slope = to - from;
  if (kCurve == Curve::cubic) {
    const F secant = s.slope, begin = knot_tangent(from - before, secant), end = knot_tangent(secant, after - to);
    s.slope = begin;
    s.square = F(3.0f) * secant - begin - begin - end;
    s.cube = begin + end - secant - secant;
    s.low = min(from, to);
    s.high = max(from, to);
  }
  return s;
}

template <Curve kCurve>
F at(const Segment& s, const F& fraction) {
  if (kCurve == Curve::stair) return s.from;
  if (kCurve == Curve::line) return fma(s.slope, fraction, s.from);
  // rounding may lead a hair out of the knots' interval: the limits hold to the last bit
  return min(max(fma(fma(fma(s.cube, fraction, s.square), fraction, s.slope), fraction, s.from), s.low), s.high);
}

/// `kVectors` vectors of rollouts at once: the rate limit is a chain along time of some 12 cycles a step, and four
/// chains side by side fill the units that one leaves idle.
template <std::uint32_t kVectors, bool kRateLimited, Curve kCurve>
void expand_group(const ExpandJob& job, std::uint32_t input, std::uint32_t lane) {
  const KnotGrid& grid = job.grid;
  const float* row = job.knots + input * grid.knots * job.stride + lane;
  float* out = job.controls + input * job.lanes + lane;
  const F step(job.rate_step[input]);
  F u[kVectors];
  Segment segment[kVectors];
  for (std::uint32_t v = 0; v < kVectors; ++v) u[v] = F(job.start[input]);
  for (std::uint32_t knot = 0; knot + 1 < grid.knots; ++knot) {
    for (std::uint32_t v = 0; v < kVectors; ++v) {
      const auto value = [&](std::uint32_t j) { return F::load(row + j * job.stride + v * kWidth); };
      const bool first = knot == 0, last = knot + 2 == grid.knots;
      if (kCurve == Curve::cubic)
        segment[v] = make_segment<kCurve>(first ? F(job.before[input]) : value(knot - 1), value(knot), value(knot + 1),
                                          value(last ? knot + 1 : knot + 2));
      else
        segment[v] = make_segment<kCurve>(F(0.0f), value(knot), value(knot + 1), F(0.0f));
    }
    for (std::uint32_t t = grid.first_step[knot]; t < grid.first_step[knot + 1]; ++t) {
      const F fraction(grid.fraction[t]);
      for (std::uint32_t v = 0; v < kVectors; ++v) {
        const F wish = at<kCurve>(segment[v], fraction);
        u[v] = kRateLimited ? min(max(wish, u[v] - step), u[v] + step) : wish;
        u[v].store(out + t * grid.inputs * job.lanes + v * kWidth);
      }
    }
  }
}

template <bool kRateLimited, Curve kCurve>
void expand_input(const ExpandJob& job, std::uint32_t input) {
  std::uint32_t lane = 0;
  for (; lane + 4 * kWidth <= job.lanes; lane += 4 * kWidth) expand_group<4, kRateLimited, kCurve>(job, input, lane);
  for (; lane < job.lanes; lane += kWidth) expand_group<1, kRateLimited, kCurve>(job, input, lane);
}

template <Curve kCurve>
void expand_inputs(const ExpandJob& job) {
  for (std::uint32_t input = 0; input < job.grid.inputs; ++input) {
    if (job.rate_step[input] >= 0.0f)
      expand_input<true, kCurve>(job, input);
    else
      expand_input<false, kCurve>(job, input);
  }
}

void expand_curves(const ExpandJob& job) {
  if (job.hold) return expand_inputs<Curve::stair>(job);
  if (job.before) return expand_inputs<Curve::cubic>(job);
  expand_inputs<Curve::line>(job);
}

/// Rates and cones along time, over controls that know neither. Cones tie inputs together, so that all inputs of a step
/// go by before the next one.
void keep_controls(const ExpandJob& job) {
  const std::uint32_t inputs = job.grid.inputs;
  float most[TILLER_MAX_INPUTS];
  for (std::uint32_t i = 0; i < inputs; ++i) most[i] = job.rate_step[i] >= 0.0f ? job.rate_step[i] : kInfinity;
  for (std::uint32_t lane = 0; lane < job.lanes; lane += kWidth) {
    F last[TILLER_MAX_INPUTS], u[TILLER_MAX_INPUTS];
    for (std::uint32_t i = 0; i < inputs; ++i) last[i] = F(job.start[i]);
    for (std::uint32_t t = 0; t < job.grid.horizon; ++t) {
      float* row = job.controls + t * inputs * job.lanes + lane;
      for (std::uint32_t i = 0; i < inputs; ++i)
        u[i] = min(max(F::load(row + i * job.lanes), last[i] - F(most[i])), last[i] + F(most[i]));
      keep_lanes(*job.cones, static_cast<int>(inputs), last, most, u);
      for (std::uint32_t i = 0; i < inputs; ++i) {
        u[i].store(row + i * job.lanes);
        last[i] = u[i];
      }
    }
  }
}

void expand(const ExpandJob& job) {
  if (!job.cones) return expand_curves(job);
  float free[TILLER_MAX_INPUTS];
  for (std::uint32_t i = 0; i < job.grid.inputs; ++i) free[i] = -1.0f;
  ExpandJob curves = job;
  curves.rate_step = free;
  expand_curves(curves);
  keep_controls(job);
}

// ---- risk ---------------------------------------------------------------------------------------

F finite_or_infinity(const F& x) { return select(abs(x) <= F(kLargest), x, F(kInfinity)); }

void mean_risk(const RiskJob& job) {
  const F scale(1.0f / static_cast<float>(job.particles));
  for (std::uint32_t lane = 0; lane < job.lanes; lane += kWidth) {
    F sum(0.0f);
    for (std::uint32_t m = 0; m < job.particles; ++m) sum += F::load(job.cost + m * job.lanes + lane);
    finite_or_infinity(sum * scale).store(job.risk + lane);
  }
}

/// CVaR of an empirical distribution with equal weights (Rockafellar and Uryasev, "Optimization of conditional
/// value-at-risk", 2000; the atom at the quantile counts by the fraction that is left, their 2002 paper, eq. 21).
/// The costliest n of M in each lane by insertion into a sorted list of vectors: n M min/max pairs, without a branch.
void tail_risk(const RiskJob& job) {
  constexpr std::uint32_t kMost = 64;
  const std::uint32_t whole = static_cast<std::uint32_t>(job.tail);
  const float part = job.tail - static_cast<float>(whole);
  const std::uint32_t kept = whole + (part > 0.0f ? 1u : 0u);
  const F scale(1.0f / job.tail);
  F top[kMost];  // descending
  for (std::uint32_t lane = 0; lane < job.lanes; lane += kWidth) {
    for (std::uint32_t i = 0; i < kept; ++i) top[i] = F(-kInfinity);
    for (std::uint32_t m = 0; m < job.particles; ++m) {
      F x = finite_or_infinity(F::load(job.cost + m * job.lanes + lane));
      for (std::uint32_t i = 0; i < kept; ++i) {
        const F larger = max(top[i], x);
        x = min(top[i], x);
        top[i] = larger;
      }
    }
    F sum(0.0f);
    for (std::uint32_t i = 0; i < whole; ++i) sum += top[i];
    if (part > 0.0f) sum = fma(top[whole], F(part), sum);
    finite_or_infinity(sum * scale).store(job.risk + lane);
  }
}

void weighted_mean_risk(const RiskJob& job) {
  for (std::uint32_t lane = 0; lane < job.lanes; lane += kWidth) {
    F sum(0.0f);
    for (std::uint32_t m = 0; m < job.particles; ++m)
      if (job.weight[m] > 0.0f) sum = fma(F(job.weight[m]), F::load(job.cost + m * job.lanes + lane), sum);
    finite_or_infinity(sum).store(job.risk + lane);
  }
}

void worst_risk(const RiskJob& job) {
  for (std::uint32_t lane = 0; lane < job.lanes; lane += kWidth) {
    F most(-kInfinity);
    for (std::uint32_t m = 0; m < job.particles; ++m)
      if (job.weight[m] > 0.0f) most = max(most, finite_or_infinity(F::load(job.cost + m * job.lanes + lane)));
    most.store(job.risk + lane);
  }
}

/// CVaR as the minimum over t of t + E max(0, cost - t) / share, which one of the costs attains (Rockafellar and
/// Uryasev 2000, theorem 1): M^2 multiplications a lane, and nothing to sort.
void weighted_tail_risk(const RiskJob& job) {
  const F scale(1.0f / job.share);
  for (std::uint32_t lane = 0; lane < job.lanes; lane += kWidth) {
    F least(kInfinity);
    for (std::uint32_t j = 0; j < job.particles; ++j) {
      if (!(job.weight[j] > 0.0f)) continue;
      const F t = finite_or_infinity(F::load(job.cost + j * job.lanes + lane));
      F beyond(0.0f);
      for (std::uint32_t m = 0; m < job.particles; ++m) {
        if (!(job.weight[m] > 0.0f)) continue;
        const F x = finite_or_infinity(F::load(job.cost + m * job.lanes + lane));
        beyond = fma(F(job.weight[m]), select(x > t, x - t, F(0.0f)), beyond);
      }
      least = min(least, fma(beyond, scale, t));
    }
    finite_or_infinity(least).store(job.risk + lane);
  }
}

void weighted_risk(const RiskJob& job) {
  if (job.share >= 1.0f)
    weighted_mean_risk(job);
  else if (job.share > 0.0f)
    weighted_tail_risk(job);
  else
    worst_risk(job);
}

void risk(const RiskJob& job) {
  if (job.weight) return weighted_risk(job);
  if (job.tail >= static_cast<float>(job.particles))
    mean_risk(job);
  else
    tail_risk(job);
}

// ---- reductions over rollouts -------------------------------------------------------------------

CostRange range(const float* cost, std::uint32_t n) {
  F low(kInfinity), high(-kInfinity), count(0.0f);
  for (std::uint32_t i = 0; i < n; i += kWidth) {
    const F x = F::load(cost + i);
    const auto finite = abs(x) <= F(kLargest);
    low = min(low, select(finite, x, F(kInfinity)));
    high = max(high, select(finite, x, F(-kInfinity)));
    count += select(finite, F(1.0f), F(0.0f));
  }
  CostRange r{kInfinity, -kInfinity, static_cast<std::uint32_t>(reduce_add(count))};
  float lows[kWidth], highs[kWidth];
  low.store(lows);
  high.store(highs);
  for (std::uint32_t i = 0; i < kWidth; ++i) {
    r.low = lows[i] < r.low ? lows[i] : r.low;
    r.high = highs[i] > r.high ? highs[i] : r.high;
  }
  return r;
}

WeightSums weigh(const float* cost, std::uint32_t n, float low, float inverse_lambda, float* weight) {
  constexpr float kNothing = -80.0f;  // e^-80 is 1e-35, still a normal number
  F sum(0.0f), squares(0.0f);
  for (std::uint32_t i = 0; i < n; i += kWidth) {
    const F exponent = (F(low) - F::load(cost + i)) * F(inverse_lambda);
    // max(NaN, x) is x: a cost of infinity ends in the same place as a large one
    const F w = select(exponent > F(kNothing), exp(max(exponent, F(kNothing))), F(0.0f));
    w.store(weight + i);
    sum += w;
    squares = fma(w, w, squares);
  }
  return {reduce_add(sum), reduce_add(squares)};
}

void moments(const float* x, std::uint32_t rows, std::uint32_t stride, std::uint32_t n, const float* weight,
             const float* centre, float* first, float* second) {
  for (std::uint32_t row = 0; row < rows; ++row) {
    const float* values = x + row * stride;
    const F c(centre[row]);
    F sum(0.0f), squares(0.0f);
    for (std::uint32_t i = 0; i < n; i += kWidth) {
      const F d = F::load(values + i) - c;
      const F wd = F::load(weight + i) * d;
      sum += wd;
      squares = fma(wd, d, squares);
    }
    first[row] = reduce_add(sum);
    if (second) second[row] = reduce_add(squares);
  }
}

}  // namespace

extern const LaneTable kPlannerLanes;
const LaneTable kPlannerLanes = {Isa::TILLER_COMPILE_ISA, sample, expand, risk, range, weigh, moments};

TILLER_ISA_NAMESPACE_END
