#pragma once

#include <string>
#include <vector>

#include "tools/logs/identify_log.hpp"

namespace tiller::tools {

/// True if all rows of `part` stand one after the other in `whole`: the file given twice, or the copy of the last seconds
/// that an alarm leaves beside a log, which a shell's *.csv names too. Numbers are compared to the ten digits that such a
/// copy has. Rows that do not move are no proof: false.
bool is_part_of(const Log& part, const Log& whole);

/// Takes out the logs that are part of another one of the list, and returns a sentence for each: counted twice, they
/// would make intervals too narrow, and a copy among held-out data would flatter.
std::vector<std::string> drop_repeated(std::vector<Log>& logs);

/// A sentence for each log of `held_out` that is part of one to learn from, or the other way round.
std::vector<std::string> shared_logs(const std::vector<Log>& learnt, const std::vector<Log>& held_out);

}  // namespace tiller::tools
