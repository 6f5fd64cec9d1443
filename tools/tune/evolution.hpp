#pragma once

#include <cstdint>
#include <vector>

namespace tiller::tools::tune {

/// CMA-ES with the settings of Hansen, "The CMA evolution strategy: a tutorial" (arXiv:1604.00772, 2016): a Gaussian
/// over the unit cube, moved to the better half of each generation, its covariance learnt from the steps that paid and
/// its size from how straight they went. A draw outside the cube is drawn again, after 64 times put on its face.
/// A generation is a function of the seed and of the returns before it.
class Evolution {
 public:
  Evolution(std::vector<double> start, double sigma, std::uint64_t seed);

  std::size_t population() const { return population_; }
  /// (population x dimension) of the next generation.
  std::vector<double> ask() const;
  /// Returns of those, larger is better; -infinity ranks last.
  void tell(const std::vector<double>& points, const std::vector<double>& returns);

  const std::vector<double>& mean() const { return mean_; }
  double sigma() const { return sigma_; }

 private:
  void move(const std::vector<double>& step);
  void learn_covariance(const std::vector<double>& steps, bool stalled);

  std::size_t dimension_, population_;
  std::uint64_t seed_, generation_ = 0;
  std::vector<double> weight_;  // (population / 2) of the better ones, falling
  double mu_eff_, c_sigma_, d_sigma_, c_c_, c_1_, c_mu_, chi_;
  double sigma_;
  std::vector<double> mean_, path_sigma_, path_c_;
  std::vector<double> covariance_, root_, inverse_root_;  // (d x d)
};

}  // namespace tiller::tools::tune
