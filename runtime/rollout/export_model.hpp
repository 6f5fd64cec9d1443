#pragma once

// Makes a loadable model from a template, in one source compiled with -DTILLER_COMPILE_ISA=<name> and that
// instruction set's flags:
//
//     #include "my_model.hpp"
//     #include "rollout/export_model.hpp"
//     TILLER_EXPORT_MODEL(MyModel)     // or TILLER_EXPORT_MODEL_WITH_COST(MyModel, MyCost)
//
// The source then defines `extern "C" const tiller_model_t* tiller_model(void)`.
//
// With TILLER_KERNEL_PART=1 the source leaves out what differentiates, with =2 it is that alone: two objects that
// compile side by side and link to the same model.

#if defined(TILLER_COMPILE_ISA_avx512) && defined(__GNUC__) && !defined(__clang__) && !defined(__OPTIMIZE__)
#error \
    "GCC's AVX-512 does not compile without optimisation: add -O3 (-O1 at least), or take -DTILLER_COMPILE_ISA=avx2 \
-DTILLER_COMPILE_ISA_avx2=1 -mavx2 -mfma"
#else  // nothing of xsimd, whose errors would bury this one

#include "rollout/kernel.hpp"
#include "rollout/model_table.hpp"

#define TILLER_ISA_VALUE_2(name) ::tiller::Isa::name
#define TILLER_ISA_VALUE(name) TILLER_ISA_VALUE_2(name)

namespace tiller {

#ifdef TILLER_KERNEL_PART
// values of the effects that are called: both parts ask for them, the first has them
#if TILLER_KERNEL_PART == 2
extern
#endif
    template Pack<double>
    called_force(std::uint32_t kind, const JointStep<Pack<double>>& in, Pack<double>* state, const Pack<double>* p);
extern "C" {
void tiller_part_linearise(const tiller_model_t& model, const LineariseJob& job);
void tiller_part_path_linearise(const tiller_model_t& model, const PathJob& job);
void tiller_part_quadratise(const tiller_model_t& model, const QuadratiseJob& job);
void tiller_part_jacobian(const double* x, const double* u, const double* f, const tiller_body_t* body, const double* p,
                          double* a, double* b);
}
template <class ModelKernel>
struct ExportedDerivatives {
  static constexpr auto linearise = &tiller_part_linearise;
  static constexpr auto path_linearise = &tiller_part_path_linearise;
  static constexpr auto feedback = ModelKernel::kFeedback;  // has no dual numbers; so both parts take as long
  static constexpr auto quadratise = &tiller_part_quadratise;
  static constexpr auto jacobian = &tiller_part_jacobian;
};
#else
template <class ModelKernel>
using ExportedDerivatives = typename ModelKernel::Derivatives;
#endif

/// A loaded model's tables. Constants: they ask for no code before main and for none of the C++ library.
template <template <class> class Type, class ModelKernel, Isa isa>
struct ExportedModel {
  static constexpr ModelKernels make_kernels() {
    ModelKernels k{};
    k.table[static_cast<int>(isa)] = &kTable;
    return k;
  }
  static constexpr RolloutTable kTable = ModelKernel::template table<ExportedDerivatives<ModelKernel>>(isa);
  static constexpr ModelKernels kKernels = make_kernels();
  static constexpr tiller_model_t kModel =
      ModelTable<Type>::make(&kKernels, ExportedDerivatives<ModelKernel>::jacobian);
};

}  // namespace tiller

#if defined(TILLER_KERNEL_PART) && TILLER_KERNEL_PART == 2
#define TILLER_EXPORT_KERNEL(Type, ...)                                                                   \
  namespace tiller {                                                                                      \
  extern "C" {                                                                                            \
  void tiller_part_linearise(const tiller_model_t& m, const LineariseJob& job) {                          \
    __VA_ARGS__::Derivatives::linearise(m, job);                                                          \
  }                                                                                                       \
  void tiller_part_path_linearise(const tiller_model_t& m, const PathJob& job) {                          \
    __VA_ARGS__::Derivatives::path_linearise(m, job);                                                     \
  }                                                                                                       \
  void tiller_part_quadratise(const tiller_model_t& m, const QuadratiseJob& job) {                        \
    __VA_ARGS__::Derivatives::quadratise(m, job);                                                         \
  }                                                                                                       \
  void tiller_part_jacobian(const double* x, const double* u, const double* f, const tiller_body_t* body, \
                            const double* p, double* a, double* b) {                                      \
    __VA_ARGS__::Derivatives::jacobian(x, u, f, body, p, a, b);                                           \
  }                                                                                                       \
  }                                                                                                       \
  }
#else
#define TILLER_EXPORT_KERNEL(Type, ...)                                                               \
  extern "C" const tiller_model_t* tiller_model(void);                                                \
  extern "C" const tiller_model_t* tiller_model(void) {                                               \
    return &::tiller::ExportedModel<Type, __VA_ARGS__, TILLER_ISA_VALUE(TILLER_COMPILE_ISA)>::kModel; \
  }
#endif
#define TILLER_EXPORT_MODEL(Type) TILLER_EXPORT_KERNEL(Type, ::tiller::Kernel<Type>)
   /// With a cost of one's own, a template beside the model (docs/reference/costs.md).
#define TILLER_EXPORT_MODEL_WITH_COST(Type, Cost) TILLER_EXPORT_KERNEL(Type, ::tiller::Kernel<Type, Cost>)
#endif
