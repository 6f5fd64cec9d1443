#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "posterior/filter_lanes.hpp"
#include "posterior/prior.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// N weighted particles over the parameters: what every engine keeps, whatever else its particles carry. Rows of N.
struct Cloud {
  const tiller_config_t* config = nullptr;
  const FilterTable* lanes = nullptr;
  std::uint32_t n = 0, np = 0;
  std::uint32_t d = 0;                             // coordinates: inferred parameters, then the engine's own
  std::uint32_t named = 0;                         // inferred parameters
  std::uint32_t inferred[TILLER_MAX_PARAMS] = {};  // (named) their rows
  PriorDistribution prior;

  double* params = nullptr;      // (np x N)
  double* coordinate = nullptr;  // (d x N) in the prior's coordinates
  double* log_weight = nullptr;  // (N)
  double* weight = nullptr;      // (N) sums to one
  double effective_samples = 0.0;

  // scratch
  double* spare = nullptr;         // (N)
  std::uint32_t* index = nullptr;  // (N)
  std::uint32_t* order = nullptr;  // (N) for quantiles and selections
  std::uint32_t moved = 0;         // by the last resample_in_place(): order[k] took over from index[k]

  /// Takes N particles' room. What it returns is empty while the arena measures.
  static Cloud lay_out(Arena& arena, const tiller_config_t& config, const ExtraCoordinates& extra = {});

  /// Particles of equal weight from the prior (stream kRngPrior of the seed).
  void draw_prior();
  void set_coordinate(std::uint32_t particle, const double* coordinate);  // (d)
  void level_weights();                                                   // all equal

  // ---- weights ----
  /// weight ~ exp(base + exponent * gain); both (N), gain finite, base may be -infinity. At least one is finite.
  void set_weights(const double* base, const double* gain, double exponent);
  /// The largest exponent up to `high` at which `floor` effective samples are left. Their number is not monotone in the
  /// exponent (far below `present` the old data are unlearnt), so the search goes down from it in steps and bisects the
  /// first that is low enough; if none is, the best of them.
  /// Stops once the number lies within the share `slack` above the floor.
  double largest_exponent(const double* base, const double* gain, double present, double high, double floor,
                          double slack = 0.0) const;
  /// Systematic resampling, one uniform number of stream `tick`: the particles' rows are permuted and the weights
  /// levelled; `index` tells whom each particle descends from, for permute() of what an engine keeps beside them.
  void resample(std::uint64_t tick);
  void permute(double* row) const;
  /// The same selection, but whoever is drawn stays where it is and its copies take the places of those that are not:
  /// only these rows' elements move, so that permute_in_place() is several times as fast as permute().
  void resample_in_place(std::uint64_t tick);
  template <class T>
  void permute_in_place(T* row) const {
    for (std::uint32_t k = 0; k < moved; ++k) row[order[k]] = row[index[k]];
  }

  // ---- what it tells ----
  /// (np) each, nullable
  void moments(double* mean, double* sd) const { moments(params, mean, sd); }
  void covariance(double* covariance) const { this->covariance(params, covariance); }  // (np x np)
  /// Of `rows` (np x N) in the place of the cloud's.
  void moments(const double* rows, double* mean, double* sd) const;
  void covariance(const double* rows, double* covariance) const;
  double quantile(std::uint32_t param, double share) const;  // NaN for one that does not exist
  void fit_law(NormalLaw& law) const;                        // the normal law of the coordinates

  /// Rows of N to copy from, rows of `count` to copy to (null: none).
  struct Drawn {
    const double* from;
    std::uint32_t rows;
    float* to;
    const double* origin = nullptr;  // (rows) subtracted first; null: nothing
  };
  /// Stratified selection of `count` particles (selection.cpp); copies their columns of each of the `pieces`.
  void draw(std::uint32_t count, std::uint64_t tick, const Drawn* what, std::uint32_t pieces) const;

 private:
  void order_by_principal_direction() const;
};

}  // namespace tiller
