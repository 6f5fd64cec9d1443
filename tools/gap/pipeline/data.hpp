#pragma once

#include <string>
#include <vector>

#include "tools/gap/result/result.hpp"
#include "tools/logs/identify_data.hpp"

namespace tiller::tools::gap {

/// Reads logs of any known format (log_formats.hpp), checks what can be checked row by row, and makes grids of the
/// robot's period. What is wrong goes to result.reasons as "file:line: column: what; how to mend", what is odd to
/// result.notes. False if anything is wrong. `hash` (nullable) becomes that of the files' bytes, in order. Of logs
/// longer than `most_steps` (0: no bound) the pieces that tell most are kept, or, `evenly`, some of the whole
/// (telling_rows.hpp); a note says so.
bool load_logs(const RobotFile& robot, const std::vector<std::string>& paths, std::size_t most_steps, bool evenly,
               std::vector<Log>& logs, std::vector<Grid>& grids, std::string* hash, Result& result);

/// Rows that no experiment makes: a stretch lost, a channel that lies at one value for long and gets there at speed.
/// Errors are appended to `reasons`.
void check_rows(const Log& log, const LogMap& map, const tiller_config_t& config, std::vector<std::string>& reasons);

/// "fnv1a-<16 hex digits>" of the files' bytes, one after the other; tells changes apart, not forgeries.
std::string hash_of_files(const std::vector<std::string>& paths);

}  // namespace tiller::tools::gap
