#include "function_lanes.hpp"

#include "function.hpp"  // as imported
#include "scalar/pack.hpp"

TILLER_ISA_NAMESPACE_BEGIN

namespace {

template <class T>
Rows in_lanes(const Rows& points) {
  using P = Pack<T>;
  using Model = ::Function<P>;
  constexpr std::size_t kStates = 5, kInputs = 2, kForces = 2, kParams = 5;
  static_assert(sizeof(typename Model::Params) == kParams * sizeof(P), "without the parameter that changes nothing");
  Rows out;
  for (std::size_t first = 0; first < points.size(); first += P::width) {
    P all[kStates + kInputs + kForces + kParams];
    for (std::size_t k = 0; k < kStates + kInputs + kForces + kParams; ++k) {
      T lanes[P::width];
      for (int i = 0; i < P::width; ++i)
        lanes[i] = static_cast<T>(points[(first + static_cast<std::size_t>(i)) % points.size()][k]);
      all[k] = P::load(lanes);
    }
    const P *x = all, *u = x + kStates, *f = u + kInputs, *p = f + kForces;
    const typename Model::State dx =
        Model::dynamics({x[0], x[1], x[2], x[3], x[4]}, {u[0], u[1]}, {f[0], f[1]}, {}, {p[0], p[1], p[2], p[3], p[4]});
    const P rates[kStates] = {dx.a_rad, dx.b_m, dx.a_rad_s, dx.b_m_s, dx.c};
    for (int i = 0; i < P::width && out.size() < points.size(); ++i) {
      out.emplace_back();
      for (const P& rate : rates) out.back().push_back(static_cast<double>(rate.lane(i)));
    }
  }
  return out;
}

}  // namespace

Rows derivatives_f32(const Rows& points) { return in_lanes<float>(points); }
Rows derivatives_f64(const Rows& points) { return in_lanes<double>(points); }

TILLER_ISA_NAMESPACE_END
