#include "tools/tune/trial_log.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <sstream>

#include "tools/base/output_file.hpp"

namespace tiller::tools::tune {
namespace {

std::string header(const std::string& settings, const std::vector<SearchKey>& keys, std::size_t seeds) {
  std::string text = "# " + settings + "\ntrial";
  for (const SearchKey& key : keys) text += "," + key.path;
  text += ",mean_return,sd_return,safe_episodes";
  for (std::size_t s = 0; s < seeds; ++s) text += ",return_" + std::to_string(s + 1);
  return text + ",refused\n";
}

std::string row(const Trial& trial, std::size_t number, std::size_t seeds) {
  std::string text = std::to_string(number);
  for (const std::string& value : trial.values) text += "," + value;
  const bool ran = trial.refused.empty();
  text +=
      ran ? "," + number_text(trial.mean()) + "," + number_text(trial.sd()) + "," + std::to_string(trial.safe) : ",,,";
  for (std::size_t s = 0; s < seeds; ++s) text += ran ? "," + number_text(trial.scores[s]) : ",";
  std::string why = trial.refused;
  for (char& c : why)
    if (c == ',' || c == '\n') c = ';';
  return text + "," + why + "\n";
}

bool read_row(const std::string& line, std::size_t number, std::size_t keys, std::size_t seeds, Trial& trial) {
  const Words cells = csv_cells(line);
  if (cells.size() != keys + seeds + 5 || cells[0] != std::to_string(number)) return false;
  trial = {};
  trial.values.assign(cells.begin() + 1, cells.begin() + 1 + static_cast<std::ptrdiff_t>(keys));
  trial.refused = cells.back();
  if (!trial.refused.empty()) return true;
  trial.safe = std::atoi(cells[keys + 3].c_str());
  for (std::size_t s = 0; s < seeds; ++s) {
    char* end = nullptr;
    trial.scores.push_back(std::strtod(cells[keys + 4 + s].c_str(), &end));
    if (end == cells[keys + 4 + s].c_str() || *end != '\0') return false;
  }
  return true;
}

}  // namespace

double Trial::mean() const {
  if (scores.empty()) return -std::numeric_limits<double>::infinity();
  double sum = 0;
  for (const double s : scores) sum += s;
  return sum / static_cast<double>(scores.size());
}

double Trial::sd() const {
  if (scores.size() < 2 || !std::isfinite(mean())) return 0;
  double square = 0;
  for (const double s : scores) square += (s - mean()) * (s - mean());
  return std::sqrt(square / static_cast<double>(scores.size() - 1));
}

TrialLog::~TrialLog() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

bool TrialLog::create(const std::string& path, const std::string& settings, const std::vector<SearchKey>& keys,
                      std::size_t seeds, std::string& error) {
  path_ = path;
  seeds_ = seeds;
  make_folders_for(path);
  descriptor_ = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (descriptor_ >= 0) return append(header(settings, keys, seeds), error);
  error = errno == EEXIST ? path + ": is there already; go on with --resume, or name another file with --log"
                          : path + ": cannot be made: " + std::strerror(errno) + "; name another file with --log";
  return false;
}

bool TrialLog::resume(const std::string& path, const std::string& settings, const std::vector<SearchKey>& keys,
                      std::size_t seeds, std::string& error) {
  std::error_code code;
  if (!std::filesystem::exists(path, code)) return create(path, settings, keys, seeds, error);
  path_ = path;
  seeds_ = seeds;
  if (!std::filesystem::is_regular_file(path, code)) {
    error = path + ": is no file that can be gone on with; name another with --log";
    return false;
  }
  std::ifstream file(path, std::ios::binary);
  std::stringstream stream;
  stream << file.rdbuf();
  const std::string text = stream.str(), head = header(settings, keys, seeds);
  descriptor_ = ::open(path.c_str(), O_WRONLY | O_CLOEXEC);
  if (!file || descriptor_ < 0) {
    error = path + ": cannot be opened: " + std::strerror(errno) + "; name another file with --log";
    return false;
  }
  if (text.compare(0, head.size(), head) != 0) {
    error = path + ": was made with other settings or another robot file (its first line tells which: " +
            text.substr(0, text.find('\n')) + "); repeat them, or name another file with --log";
    return false;
  }
  bytes_ = head.size();
  Trial trial;
  for (std::size_t end; (end = text.find('\n', bytes_)) != std::string::npos; bytes_ = end + 1) {
    if (!read_row(text.substr(bytes_, end - bytes_), trials_.size() + 1, keys.size(), seeds, trial)) {
      error = path + ": trial " + std::to_string(trials_.size() + 1) +
              " cannot be read; cut the file off before it, and --resume goes on from there";
      return false;
    }
    trials_.push_back(trial);
  }
  if (::ftruncate(descriptor_, static_cast<off_t>(bytes_)) == 0 && ::lseek(descriptor_, 0, SEEK_END) >= 0) return true;
  error = path + ": cannot be written: " + std::strerror(errno) + "; name another file with --log";
  return false;
}

bool TrialLog::add(const Trial& trial, std::string& error) {
  if (!append(row(trial, trials_.size() + 1, seeds_), error)) return false;
  trials_.push_back(trial);
  return true;
}

// A row is whole or not there: what a full disk took in part is taken back.
bool TrialLog::append(const std::string& text, std::string& error) {
  std::size_t done = 0;
  while (done < text.size()) {
    const ssize_t n = ::write(descriptor_, text.data() + done, text.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) break;
    done += static_cast<std::size_t>(n);
  }
  if (done == text.size() && (::fsync(descriptor_) == 0 || errno == EINVAL)) {
    bytes_ += text.size();
    return true;
  }
  error = path_ + ": cannot be written: " + std::strerror(errno) +
          "; free space, or copy the file to another disk and name it with --log; --resume then goes on after trial " +
          std::to_string(trials_.size());
  if (::ftruncate(descriptor_, static_cast<off_t>(bytes_)) == 0) (void)::lseek(descriptor_, 0, SEEK_END);
  return false;
}

}  // namespace tiller::tools::tune
