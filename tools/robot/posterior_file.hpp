#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "tools/robot/joint_prior.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// A posterior between two runs: a mixture over the inferred parameters' coordinates, and where it comes from.
struct StoredPosterior {
  std::string model;
  Words params;                    ///< (d) as the robot file calls them, in the mixture's order
  std::vector<bool> is_logarithm;  ///< (d) the coordinate is the parameter's logarithm
  GaussianMixture mixture;
  std::string robot, created_by;  ///< name of the robot, "tiller 0.1"
  std::uint64_t episodes = 0;     ///< that it has gone through, one after the other
  std::uint64_t transitions = 0;  ///< measured ones that it has seen in all of them
  std::uint32_t particles = 0;    ///< of the cloud that it was fitted to
  double effective_samples = 0;
  double noise_scale = 1;  ///< estimated over configured noise
  double exponent = 1;     ///< on the likelihood; below one: the cloud had not converged and is too wide
};

/// Particles as they come from a controller or a fit.
struct Particles {
  std::vector<double> params;  ///< (n x np)
  std::vector<double> weight;  ///< (n) empty: all equal
};

/// Fits the mixture to the particles of a configuration whose parameters are called `params` (np); fills model, names,
/// coordinates, mixture, particles and version. Some parameter has a prior.
StoredPosterior store_posterior(const tiller_config_t& config, const Words& params, const Particles& particles);

/// The file's text: JSON, format version 1, with a checksum. docs/guide/episodes.md shows one.
std::string posterior_text(const StoredPosterior& posterior);
/// Crash-safe (replace_file). False with a sentence in `error`.
bool save_posterior(const std::string& path, const StoredPosterior& posterior, std::string& error);

/// Reads with suspicion: everything that is not as posterior_text() writes it is an error, "file: key = value: problem;
/// remedy". A file without "checksum" (written by hand) is taken. False with every error.
bool parse_posterior(const std::string& text, const std::string& path, StoredPosterior& out, Words& errors);
bool read_posterior(const std::string& path, StoredPosterior& out, Words& errors);

/// Makes it the robot's prior: its parameters, in any order, must be those that have a prior in the robot file, in the
/// same coordinates and within the bounds. False with every error.
bool take_prior(const StoredPosterior& posterior, const std::string& path, RobotFile& robot, Words& errors);

}  // namespace tiller::tools
