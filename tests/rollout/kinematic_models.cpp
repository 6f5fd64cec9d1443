// Compiled for one instruction set: models that leave out what they do not have.

#include "kinematic_models.hpp"

#include "rollout/kernel.hpp"
#include "rollout/model_table.hpp"
#include "unicycle.hpp"

template <class S>
struct KnownIntegrator {
  static constexpr const char* name = "known_integrator";
  TILLER_FIELDS(State, S, position_m, velocity_m_s);
  TILLER_FIELDS(Input, S, acceleration_m_s2);
  static State dynamics(const State& x, const Input& u, const tiller::Body<S>&) {
    return {x.velocity_m_s, u.acceleration_m_s2};
  }
};

namespace tiller::test {
namespace {

template <template <class> class Type>
struct Table {
  static constexpr ModelKernels make() {
    ModelKernels k{};
    k.table[static_cast<int>(Isa::TILLER_COMPILE_ISA)] = &kTable;
    return k;
  }
  static constexpr RolloutTable kTable = Kernel<Type>::table(Isa::TILLER_COMPILE_ISA);
  static constexpr ModelKernels kKernels = make();
  static constexpr tiller_model_t kModel = ModelTable<Type>::make(&kKernels);
};

}  // namespace

const tiller_model_t* unicycle() { return &Table<Unicycle>::kModel; }
const tiller_model_t* known_integrator() { return &Table<KnownIntegrator>::kModel; }

}  // namespace tiller::test
