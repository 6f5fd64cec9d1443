// Compiled for one instruction set: a model of thirty-two states, and beside it the same equations as a table in C.

#include "large_models.hpp"

#include "mass_chain.hpp"
#include "rollout/kernel_table.hpp"

namespace tiller::test {
namespace {

constexpr tiller_model_t kInC = ModelTable<MassChain>::make(nullptr);

}  // namespace

const tiller_model_t* large_model() { return &KernelTable<MassChain>::kModel; }
const tiller_model_t* large_model_in_c() { return &kInC; }

}  // namespace tiller::test
