#pragma once

// Makes a loadable model from a template, in one source compiled with -DTILLER_COMPILE_ISA=<name> and that
// instruction set's flags:
//
//     #include "my_model.hpp"
//     #include "rollout/export_model.hpp"
//     TILLER_EXPORT_MODEL(MyModel)     // or TILLER_EXPORT_MODEL_WITH_COST(MyModel, MyCost)
//
// The source then defines `extern "C" const tiller_model_t* tiller_model(void)`.

#include "rollout/kernel.hpp"
#include "rollout/model_table.hpp"

#define TILLER_ISA_VALUE_2(name) ::tiller::Isa::name
#define TILLER_ISA_VALUE(name) TILLER_ISA_VALUE_2(name)

#define TILLER_EXPORT_KERNEL(Type, ...)                                                                   \
  extern "C" const tiller_model_t* tiller_model(void);                                                    \
  extern "C" const tiller_model_t* tiller_model(void) {                                                   \
    static const ::tiller::RolloutTable table = __VA_ARGS__::table(TILLER_ISA_VALUE(TILLER_COMPILE_ISA)); \
    static const ::tiller::ModelKernels kernels = [] {                                                    \
      ::tiller::ModelKernels k{};                                                                         \
      k.table[static_cast<int>(TILLER_ISA_VALUE(TILLER_COMPILE_ISA))] = &table;                           \
      return k;                                                                                           \
    }();                                                                                                  \
    static const tiller_model_t model = ::tiller::ModelTable<Type>::make(&kernels);                       \
    return &model;                                                                                        \
  }
#define TILLER_EXPORT_MODEL(Type) TILLER_EXPORT_KERNEL(Type, ::tiller::Kernel<Type>)
/// With a cost of one's own, a template beside the model (docs/costs.md).
#define TILLER_EXPORT_MODEL_WITH_COST(Type, Cost) TILLER_EXPORT_KERNEL(Type, ::tiller::Kernel<Type, Cost>)
