#pragma once

// How a control period goes: the parts that its substeps are cut into and what effects make of their lengths. All of it
// follows from parameters and the period's length, so that a rollout works it out once and not in every step.

#include <cstdint>
#include <type_traits>
#include <utility>

#include "rollout/effect_calls.hpp"
#include "rollout/rollout.hpp"
#include "tiller/model.hpp"

namespace tiller {

/// The type of a number without its derivatives: lengths of steps have none.
template <class S, class = void>
struct ValueOf {
  using type = S;
  static const S& of(const S& x) { return x; }
};
template <class S>
struct ValueOf<S, std::void_t<decltype(S::directions)>> {
  using type = decltype(S::v);
  static const type& of(const S& x) { return x.v; }
};

/// A step's length and the parts of it that integrators use.
template <class S>
struct Length {
  typename ValueOf<S>::type h, half, sixth;
};

/// The type of a comparison.
template <class S>
using MaskOf = decltype(std::declval<S>() > std::declval<S>());

/// What a part keeps for a lag: nothing where lags are called instead of inlined, as derivatives have them. Shares with
/// derivatives in many directions would take 200 kB of an arm's stack, and nobody would read them.
struct NothingKept {};
template <class S>
using LagKept =
    std::conditional_t<InlinedEffect<ActuatorLag<S>, S>::value, typename ActuatorLag<S>::Shares, NothingKept>;

/// A part of a substep, up to where the first of a lane's inputs takes its newer command; a whole substep where nothing
/// is delayed.
template <class Model, class S>
struct Part {
  Length<S> step;
  MaskOf<S> older[Model::kMostInputs];            // the input's older command acts
  MaskOf<S> stands;                               // lanes whose part is empty stand still in it
  LagKept<S> lag[most_lags(Model::kMostInputs)];  // by the lag's place among the lags
};

/// Of one register of trajectories.
template <class Model, class S>
struct RegisterPlan {
  static constexpr int kKept = 2;  // more substeps than these are planned again each time
  static constexpr int kMostParts = Model::kMostInputs + 1;

  typename InputDelay<typename ValueOf<S>::type>::Reach delay[Model::kMostInputs];
  Part<Model, S> parts[kKept * kMostParts];  // of the substeps kept, one after the other
  int part_count[kKept];                     // those behind are empty in all lanes
};

/// A part of the registers that go through a period together. kSets is 1 where they share parameters.
template <class Model, class S, int kSets = 1>
struct PartOfAll {
  const RegisterPlan<Model, S>* registers;
  int at;
  const Part<Model, S>& operator[](int r) const { return registers[kSets == 1 ? 0 : r].parts[at]; }
};

/// Of kCount registers.
template <class Model, class S, int kCount, int kSets>
struct PeriodPlan {
  Body<S> body[kSets];   // with what the body effects make of it
  bool turning = false;  // some input is delayed; else every substep is parts[0]
  RegisterPlan<Model, S> registers[kSets];
};

}  // namespace tiller
