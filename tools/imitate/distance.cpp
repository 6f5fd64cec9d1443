#include "tools/imitate/distance.hpp"

#include <cmath>

namespace tiller::tools::imitate {

Vector spread_of(const Scene& scene, const std::vector<Demonstration>& all) {
  Vector squares = Vector::Zero(scene.nx());
  double count = 0;
  for (const Demonstration& d : all)
    for (Eigen::Index k = 0; k < d.motion.state.cols(); ++k, ++count)
      squares += scene.difference(d.motion.state.col(k), all[0].motion.state.col(0)).cwiseAbs2();
  return (squares / std::max(1.0, count)).cwiseSqrt();
}

double distance(const Scene& scene, const Motion& a, const Motion& b, const Vector& spread) {
  double sum = 0, count = 0;
  for (Eigen::Index k = 0; k < a.state.cols(); ++k) {
    const Vector d = scene.difference(a.state.col(k), b.state.col(k));
    for (Eigen::Index i = 0; i < d.size(); ++i)
      if (spread(i) > 0) sum += std::pow(d(i) / spread(i), 2), ++count;
  }
  return count > 0 ? std::sqrt(sum / count) : 0;
}

}  // namespace tiller::tools::imitate
