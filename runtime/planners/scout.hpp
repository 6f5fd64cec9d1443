#pragma once

#include "planners/ilqr.hpp"
#include "planners/sampler.hpp"

namespace tiller {

/// A second plan beside that of `hybrid`, which begins far from it, from one of the widest samples, or from the plan
/// under a cost of its own, and is refined over several plans before anybody compares the two: a sample in a better
/// valley costs more than the floor of a worse one.
/// It is for the belief's first hypothesis alone, which keeps it cheap; whoever takes it weighs it on all of them.
struct Scout {
  Ilqr* gradient = nullptr;     // of one scenario
  float* hypothesis = nullptr;  // (np + nx + ns)
  double* knots = nullptr;      // (inputs * knots) of the sample
  double* inputs = nullptr;     // (N x nu)
  float* sequence = nullptr;    // (N x nu)
  std::uint32_t plans = 0;      // since it began; 0: the next plan begins another
  std::uint64_t begun = 0;
  std::uint32_t tilted = 0;  // plans until its cost is the plan's again; 0: it is
  bool motion = false;       // the path of the last plan is one
};

void lay_out_scout(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                   Scout& s);
void reset_scout(Scout& s);

/// Takes the request with its first hypothesis alone; the path is that of the plan before. False without a belief.
bool meet_request(Scout& s, const PathPlan& present, const PlanRequest& request);
/// From a motion on, with the configured shooting.
void set_out(Scout& s);
/// Up to `iterations` of the gradient; the number completed. Where s.motion says that the path has become a motion, its
/// cost on the first hypothesis is s.gradient->cost, and its inputs are those of the path.
std::uint32_t refine(Scout& s, const Deadline& deadline, std::uint32_t iterations);

/// A plan of the scout of `hybrid`, after the sampler's iteration and the plan around `present`: as `refine`.
std::uint32_t search_on(Scout& s, const Sampler& sampler, const PathPlan& present, const PlanRequest& request,
                        std::uint32_t iterations);

}  // namespace tiller
