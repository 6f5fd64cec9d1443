// Compiled once per instruction set: the cart-pole with a cost template beside it, the same formula as the C functions
// of cost_cases.hpp.

#define TILLER_EFFECTS_ARE_SHARED
#include "models/cart_pole.hpp"
#include "rollout/kernel.hpp"

TILLER_ISA_NAMESPACE_BEGIN

template <class S>
struct TestCost {
  static S stage(const typename CartPole<S>::State& x, const typename CartPole<S>::Input& u,
                 const typename CartPole<S>::Params& p, const S& time_s) {
    return cos(x.position_m) * 1.3 + x.angle_rad * x.angle_rad * u.force_N +
           p.cart_mass_kg * time_s * x.position_m * 0.1;
  }
  static S terminal(const typename CartPole<S>::State& x, const typename CartPole<S>::Params& p, const S& time_s) {
    return sin(x.position_m) * p.cart_mass_kg * 1.3 + time_s * x.angle_rad;
  }
};

const RolloutTable& own_cost_table();
const RolloutTable& own_cost_table() {
  static const RolloutTable table = Kernel<CartPole, TestCost>::table(Isa::TILLER_COMPILE_ISA);
  return table;
}

TILLER_ISA_NAMESPACE_END
