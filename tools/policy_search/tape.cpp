#include "tools/policy_search/tape.hpp"

namespace tiller::tools::policy {

void Tape::sweep(const Var& result) {
  adjoint_.assign(nodes_.size(), 0.0);
  if (result.id < 0) return;
  adjoint_[static_cast<std::size_t>(result.id)] = 1.0;
  auto waiting = deferred_.rbegin();
  for (std::size_t i = nodes_.size(); i-- > 0;) {
    for (; waiting != deferred_.rend() && waiting->first == static_cast<int>(i); ++waiting) waiting->second();
    const Node& n = nodes_[i];
    const double d = adjoint_[i];
    if (d == 0.0) continue;
    if (n.a >= 0) adjoint_[static_cast<std::size_t>(n.a)] += d * n.by_a;
    if (n.b >= 0) adjoint_[static_cast<std::size_t>(n.b)] += d * n.by_b;
  }
}

}  // namespace tiller::tools::policy
