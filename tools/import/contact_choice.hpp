#pragma once

#include <string>
#include <vector>

#include "tools/import/mechanism.hpp"

namespace tiller::tools {

/// Finds the shapes that `words` name ("foot:plane", "pad:box") and puts their pairs into the mechanism: a sphere, a
/// capsule's ends or a box's corners against a plane, a box's face or a sphere. False with what is wrong in `errors`.
bool choose_contacts(const Description& robot, const std::vector<std::string>& words, Mechanism& mechanism,
                     std::vector<std::string>& errors);

/// Integrator steps that a period takes for the contacts' sake: none is longer than 1 / rate of the fastest contact,
/// half of what keeps the midpoint rule stable. 0: more than a robot file may have.
unsigned contact_substeps(const Mechanism& mechanism, double period_s);

}  // namespace tiller::tools
