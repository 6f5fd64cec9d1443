#pragma once

#include <memory>

#include "tools/policy_search/normal_steps.hpp"
#include "tools/policy_search/policy.hpp"

namespace tiller::tools::policy {

/// A policy with parameters to search: its outputs at a normal input before they are squashed, on a tape.
class Trainable {
 public:
  virtual ~Trainable() = default;
  /// Number of parameters.
  virtual Eigen::Index count() const = 0;
  /// Takes the parameters into use.
  virtual void set(const Vector& parameters) = 0;
  /// Begins a tape: what is taped below belongs to it.
  virtual void begin(Tape& tape) = 0;
  virtual VarMoments apply(Tape& tape, const VarNormal& features) = 0;
  /// Derivatives with respect to the parameters after the tape's sweep.
  virtual Vector gradient(const Tape& tape) const = 0;
  /// Puts what was set into a policy's arrays.
  virtual void write(Policy& policy) const = 0;
};

/// v = weight f + bias. Parameters: weight by column, then bias.
std::unique_ptr<Trainable> make_linear(int features, int commands);

/// A network of Gaussian bumps that passes near targets t at points x: beta = (K + 0.01^2 I)^-1 t (Deisenroth and
/// Rasmussen 2011, section 3.2). Targets are searched rather than weights: a target moves the output near its point
/// alone, a weight everywhere, and the search is far better conditioned. All commands share points and lengths, as the
/// runtime's networks have them. Parameters: x by column, log lengths (features), targets (n x commands) by column.
std::unique_ptr<Trainable> make_rbf(int features, int commands, int bumps);

/// Where a search begins. Linear: weights of a tenth of `deviation`. Bumps: points from a normal distribution (mean and
/// covariance, features), lengths `length` (features), targets of `deviation`.
Vector first_parameters(const Trainable& trainable, const Vector& mean, const Matrix& covariance, const Vector& length,
                        double deviation, std::uint64_t seed);

}  // namespace tiller::tools::policy
