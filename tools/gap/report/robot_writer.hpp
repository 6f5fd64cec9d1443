#pragma once

#include <cmath>
#include <string>

#include "tools/gap/result/result.hpp"

namespace tiller::tools::gap {

/// A fitted number as a robot file takes it: what is rounding, below TILLER_SMALLEST_PARAMETER, is 0.
inline double as_written(double value) { return std::fabs(value) < TILLER_SMALLEST_PARAMETER ? 0.0 : value; }

/// The text of a robot file with what was found: the old text with its comments, in which the priors of the parameters
/// that were fitted are replaced in their places, and the effects of `found` appended as [[effects]]. Each becomes a
/// normal prior around the estimate, cut at the old bounds (an effect's: at what physics allows): twice the fit's
/// standard deviation wide, 2 % of the value at least, so that the online posterior goes on estimating. `data_hash`
/// goes into a comment. Where an engine of the posterior does not take the effects, [posterior] kind becomes "filter".
/// The text is read back as a robot file before it is given out. False with sentences in `error`.
bool write_robot(const RobotFile& robot, const std::string& old_text, const Explanation& found,
                 const std::string& data_hash, std::string& text, std::string& error);

/// The text of a robot file of folder `from` for one in `to`: the files that it names relative to its folder (a model's
/// source, a reference), where they are there, are named from the other.
std::string with_paths_from(const std::string& text, const std::string& from, const std::string& to);

}  // namespace tiller::tools::gap
