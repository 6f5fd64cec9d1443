#include "bench/planning/dual_models.hpp"

#include "rollout/kernel_table.hpp"

namespace tiller::bench {

const tiller_model_t& braking_car_model() { return KernelTable<BrakingCar>::kModel; }
const tiller_model_t& signed_balancer_model() { return KernelTable<SignedBalancer>::kModel; }
const tiller_model_t& sagging_arm_model() { return KernelTable<SaggingArm>::kModel; }
const tiller_model_t& weak_quadrotor_model() { return KernelTable<WeakQuadrotor>::kModel; }

}  // namespace tiller::bench
