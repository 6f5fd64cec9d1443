#pragma once

#include <functional>
#include <vector>

#include "tools/import/contact_rows.hpp"
#include "tools/import/expression.hpp"

namespace tiller::tools {

/// Contact in closed form, as the built-in hopper has it (runtime/models/hopper.hpp) with MuJoCo's constants: a force
/// for each place such that the places' accelerations become
///
///   -rate v - stiffness gap,   rate = 2 / (impedance settle), stiffness = 1 / (impedance settle^2 damping_ratio^2),
///
/// but for the share 1 - impedance, never a pull, and across within the cone of friction. All places are solved
/// together as if they stuck, then each in turn a fixed number of times, which lets them slip and part. Within the last
/// millimetre before a touch the impedance rises from none, so that the force has a slope everywhere.

/// Of a pair, by numbers or by parameters of the model.
struct ContactTerms {
  Expression friction, settle_s, damping_ratio;
};

struct ContactAnswer {
  std::vector<Expression> acceleration;  ///< (joints) with the contacts' share
  std::vector<Expression> force;         ///< (places x 3) along normal and tangents
  std::vector<Expression> gap;           ///< (places)
};

/// `inverse`: (joints x joints) accelerations for unit forces, `free`: accelerations without contacts; `rows` of all
/// pairs' places in their order, with `reach` over the joints.
ContactAnswer answer_contacts(const std::vector<ContactPair>& pairs, const std::vector<ContactTerms>& terms,
                              const std::vector<ContactRows<Expression>>& rows,
                              const std::vector<std::vector<Expression>>& inverse, const std::vector<Expression>& free);

}  // namespace tiller::tools
