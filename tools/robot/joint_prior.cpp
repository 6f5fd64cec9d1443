#include "tools/robot/joint_prior.hpp"

namespace tiller::tools {

JointPrior::JointPrior(std::uint32_t dimension, std::vector<double> w, std::vector<double> m, std::vector<double> r)
    : weight(std::move(w)), mean(std::move(m)), root(std::move(r)) {
  mixture = {sizeof mixture, TILLER_CONFIG_VERSION, static_cast<std::uint32_t>(weight.size()),
             dimension,      weight.data(),         mean.data(),
             root.data()};
}

}  // namespace tiller::tools
