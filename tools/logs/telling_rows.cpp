// The pieces of long logs that tell most: moments of a piece -> features -> a D-optimal choice -> the rows that stay.
#include "tools/logs/telling_rows.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <queue>

#include "tools/base/text.hpp"

namespace tiller::tools {
namespace {

constexpr double kPiece_s = 8.0;          // several windows of any method, and a run-in that wastes little of it
constexpr std::size_t kPieceSteps = 400;  // at least: the same for slow machines
constexpr std::size_t kFewestPieces = 8;  // of the budget: of fewer, half evenly spread would be no spread
constexpr double kLeast_s = 30.0;         // of the budget: a fast machine's steps are no reason for less
constexpr std::size_t kMoments = 32;      // of a piece
constexpr double kSeen = 4.0;             // root mean square second differences over their noise: motion, not noise
constexpr double kRidge = 1e-3;           // of the information that the whole budget would bring
constexpr double kTurn = 6.283185307179586;

struct Piece {
  std::size_t log = 0, first = 0, last = 0;  // rows
  bool kept = false;
  std::size_t rows() const { return last - first; }
};

struct Channel {
  const std::vector<double>* values;
  bool angle, input;
  double sd;       // of the sensor
  const Log* own;  // has stamps of the inputs' own; null: the rows'
};

std::vector<Channel> channels_of(const Log& log, const tiller_config_t& config) {
  std::vector<Channel> channels;
  for (std::uint32_t k = 0; k < config.measurement_count; ++k) {
    const auto state = static_cast<std::uint32_t>(config.measured_state[k]);
    channels.push_back(
        {&log.state[state], (config.model->angle_mask >> state & 1u) != 0, false, config.measurement_sd[k], nullptr});
  }
  for (std::uint32_t i = 0; i < config.model->input_count; ++i)
    channels.push_back({&log.input[i], false, true, 0, log.input_time_s.empty() ? nullptr : &log});
  return channels;
}

// Mean and spread of a channel over rows of one moment; an angle follows `before`, the moment before it.
struct Moment {
  double mean = NAN, spread = 0;
};

Moment moment_of(const Channel& channel, std::size_t first, std::size_t last, double before) {
  double sum = 0, squares = 0, n = 0, reference = before;
  if (channel.own) {  // what was in force at the first row, and what came until the last
    const std::vector<double>&rows = channel.own->time_s, &inputs = channel.own->input_time_s;
    const auto until = [&](double t) {
      return static_cast<std::size_t>(std::upper_bound(inputs.begin(), inputs.end(), t) - inputs.begin());
    };
    last = until(rows[std::min(last, rows.size()) - 1]);
    first = std::max<std::size_t>(until(rows[first]), 1) - 1;
  }
  for (std::size_t row = first; row < last && row < channel.values->size(); ++row) {
    double v = (*channel.values)[row];
    if (!std::isfinite(v)) continue;
    if (!std::isfinite(reference)) reference = v;
    if (channel.angle) v -= kTurn * std::round((v - reference) / kTurn);
    const double d = v - reference;
    sum += d, squares += d * d, n += 1;
  }
  if (n == 0) return {};
  return {reference + sum / n, std::sqrt(std::max(0.0, squares / n - sum * sum / (n * n)))};
}

std::size_t feature_count(const tiller_config_t& config) {
  return 7u * config.measurement_count + 3u * config.model->input_count;
}

double soft_sign(double v, double typical) { return typical > 0 ? v / (std::fabs(v) + 0.1 * typical) : 0; }

// Of three neighbouring moments, `dt` apart: what forces may depend on. Values that are not there are 0.
float* add_features(const Channel& channel, const Moment (&m)[3], double dt, float* out) {
  const auto put = [&out](double v) { *out++ = std::isfinite(v) ? static_cast<float>(v) : 0.0f; };
  const double v = (m[2].mean - m[0].mean) / (2 * dt);
  if (channel.input) {
    put(m[1].mean), put(m[2].mean - m[1].mean), put(m[1].spread);
    return out;
  }
  put(channel.angle ? std::sin(m[1].mean) : m[1].mean);
  put(channel.angle ? std::cos(m[1].mean) : 1.0);
  put(v), put(v * std::fabs(v)), put(v);  // the last becomes the sign, once the typical speed is known
  put((m[2].mean - 2 * m[1].mean + m[0].mean) / (dt * dt));
  put(m[1].spread);
  return out;
}

// The time between moments at which some sensor's second differences stand out of its noise; at most `longest_s`.
double moment_length(const std::vector<Log>& logs, const std::vector<double>& steps_s, const std::vector<Piece>& pieces,
                     const tiller_config_t& config, double longest_s) {
  const std::size_t stride = std::max<std::size_t>(1, pieces.size() / 100);
  double length = config.period_s;
  for (; 2 * length <= longest_s; length *= 2) {
    std::vector<double> squares(config.measurement_count), counts(config.measurement_count);
    double rows_each = 1;
    for (std::size_t p = 0; p < pieces.size(); p += stride) {
      const Log& log = logs[pieces[p].log];
      const auto rows = static_cast<std::size_t>(std::max(1.0, std::round(length / steps_s[pieces[p].log])));
      rows_each = static_cast<double>(rows);
      const std::vector<Channel> channels = channels_of(log, config);
      for (std::uint32_t k = 0; k < config.measurement_count; ++k) {
        double a = NAN, b = NAN;
        for (std::size_t row = pieces[p].first; row + rows <= pieces[p].last; row += rows) {
          const double c = moment_of(channels[k], row, row + rows, b).mean, d = c - 2 * b + a;
          if (std::isfinite(d)) squares[k] += d * d, counts[k] += 1;
          a = b, b = c;
        }
      }
    }
    for (std::uint32_t k = 0; k < config.measurement_count; ++k) {
      const double noise = config.measurement_sd[k] * std::sqrt(6.0 / rows_each);
      if (counts[k] > 0 && std::sqrt(squares[k] / counts[k]) > kSeen * noise) return length;
    }
  }
  return length;
}

std::vector<Piece> cut_pieces(const std::vector<Log>& logs, const std::vector<double>& steps_s, double piece_s) {
  std::vector<Piece> pieces;
  for (std::size_t l = 0; l < logs.size(); ++l) {
    for (const Segment& segment : split_at_gaps(logs[l])) {
      const std::size_t n = segment.last - segment.first;
      const auto count =
          static_cast<std::size_t>(std::max(1.0, std::round(static_cast<double>(n) * steps_s[l] / piece_s)));
      for (std::size_t i = 0; i < count; ++i)
        pieces.push_back({l, segment.first + n * i / count, segment.first + n * (i + 1) / count});
    }
  }
  return pieces;
}

using Features = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic>;  // (features x moments)

std::vector<Features> features_of(const std::vector<Log>& logs, const std::vector<double>& steps_s,
                                  const std::vector<Piece>& pieces, const tiller_config_t& config, double moment_s) {
  std::vector<Features> all;
  for (const Piece& piece : pieces) {
    const auto rows = static_cast<std::size_t>(std::max(1.0, std::round(moment_s / steps_s[piece.log])));
    const std::vector<Channel> channels = channels_of(logs[piece.log], config);
    const std::size_t count = piece.rows() / rows, used = std::min(kMoments, count > 2 ? count - 2 : 0);
    Features f = Features::Zero(static_cast<Eigen::Index>(feature_count(config)), static_cast<Eigen::Index>(used));
    for (std::size_t i = 0; i < used; ++i) {
      const std::size_t row = piece.first + (1 + i * (count - 2) / used) * rows;
      float* out = f.col(static_cast<Eigen::Index>(i)).data();
      for (const Channel& channel : channels) {
        Moment m[3];
        for (std::size_t j = 0; j < 3; ++j)
          m[j] = moment_of(channel, row + j * rows - rows, row + j * rows, j > 0 ? m[j - 1].mean : NAN);
        out = add_features(channel, m, static_cast<double>(rows) * steps_s[piece.log], out);
      }
    }
    all.push_back(std::move(f));
  }
  return all;
}

// Each feature over its root mean square; the speed's sign needs the speed's.
void normalise(std::vector<Features>& all, std::uint32_t sensors) {
  const auto scale_of = [&all](Eigen::Index row) {
    double squares = 0, n = 0;
    for (const Features& f : all)
      squares += static_cast<double>(f.row(row).squaredNorm()), n += static_cast<double>(f.cols());
    return n > 0 ? std::sqrt(squares / n) : 0;
  };
  for (std::uint32_t k = 0; k < sensors; ++k) {
    const Eigen::Index speed = 7 * k + 2, sign = 7 * k + 4;
    const double typical = scale_of(speed);
    for (Features& f : all)
      for (Eigen::Index c = 0; c < f.cols(); ++c)
        f(sign, c) = static_cast<float>(soft_sign(static_cast<double>(f(speed, c)), typical));
  }
  if (all.empty()) return;
  for (Eigen::Index row = 0; row < all[0].rows(); ++row) {
    const double scale = scale_of(row);
    for (Features& f : all)
      if (scale > 0) f.row(row) /= static_cast<float>(scale);
  }
}

// The information of the pieces that were chosen, and what one more would add to the logarithm of its determinant.
class Information {
 public:
  Information(Eigen::Index features, double moments)
      : sum_(Eigen::MatrixXf::Identity(features, features) * static_cast<float>(kRidge * moments)) {
    factor_.compute(sum_);
  }
  void add(const Features& f) {
    sum_ += f * f.transpose();
    factor_.compute(sum_);
  }
  double gain(const Features& f) const {
    const Eigen::MatrixXf y = factor_.matrixL().solve(f);
    Eigen::MatrixXf inner = Eigen::MatrixXf::Identity(f.cols(), f.cols()) + y.transpose() * y;
    const Eigen::LLT<Eigen::MatrixXf> root(inner);
    double sum = 0;
    for (Eigen::Index i = 0; i < inner.rows(); ++i) sum += 2 * std::log(static_cast<double>(root.matrixL()(i, i)));
    return sum;
  }

 private:
  Eigen::MatrixXf sum_;
  Eigen::LLT<Eigen::MatrixXf> factor_;
};

void keep_evenly(std::vector<Piece>& pieces, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) pieces[(2 * i + 1) * pieces.size() / (2 * count)].kept = true;
}

// A gain only shrinks while others are taken (the logarithm of a determinant is submodular), so an old one is a bound:
// of the queue only those are computed anew that stand first.
void keep_telling(std::vector<Piece>& pieces, const std::vector<Features>& features, std::size_t count) {
  Information information(features[0].rows(), static_cast<double>(2 * count * kMoments));
  for (std::size_t p = 0; p < pieces.size(); ++p)
    if (pieces[p].kept) information.add(features[p]);
  struct Bound {
    double gain;
    std::size_t piece, computed_at;
    bool operator<(const Bound& other) const { return gain != other.gain ? gain < other.gain : piece > other.piece; }
  };
  std::priority_queue<Bound> queue;
  for (std::size_t p = 0; p < pieces.size(); ++p)
    if (!pieces[p].kept) queue.push({INFINITY, p, count});
  for (std::size_t taken = 0; taken < count && !queue.empty();) {
    Bound best = queue.top();
    queue.pop();
    if (best.computed_at != taken) {
      queue.push({information.gain(features[best.piece]), best.piece, taken});
      continue;
    }
    pieces[best.piece].kept = true;
    information.add(features[best.piece]);
    ++taken;
  }
}

template <class T>
void keep_rows(const std::vector<Piece>& pieces, std::size_t log, std::vector<T>& values) {
  if (values.empty()) return;
  std::size_t to = 0;
  for (const Piece& piece : pieces)
    if (piece.log == log && piece.kept)
      for (std::size_t row = piece.first; row < piece.last; ++row) values[to++] = values[row];
  values.resize(to);
  values.shrink_to_fit();
}

void drop_the_rest(std::vector<Log>& logs, const std::vector<Piece>& pieces) {
  for (std::size_t l = 0; l < logs.size(); ++l) {
    Log& log = logs[l];
    keep_rows(pieces, l, log.line);
    keep_rows(pieces, l, log.time_s);
    for (auto* channels : {&log.state, &log.sensor})
      for (auto& channel : *channels) keep_rows(pieces, l, channel);
    for (auto& channel : log.input)
      if (log.input_time_s.empty()) keep_rows(pieces, l, channel);
  }
  logs.erase(std::remove_if(logs.begin(), logs.end(), [](const Log& log) { return log.rows() == 0; }), logs.end());
}

double seconds_of(const std::vector<Log>& logs) {
  double sum = 0;
  for (const Log& log : logs)
    for (const Segment& segment : split_at_gaps(log)) sum += log.time_s[segment.last - 1] - log.time_s[segment.first];
  return sum;
}

}  // namespace

std::string UsedRows::text() const {
  if (everything()) return "";
  return format("%.0f s of %.0f s are used: %zu pieces of about %.3g s, %s; --most-steps 0 takes all", used_s, all_s,
                pieces, piece_s,
                evenly ? "evenly over the logs" : "half of them evenly over the logs, half chosen for what they tell");
}

UsedRows keep_telling_rows(std::vector<Log>& logs, const tiller_config_t& config, std::size_t most_steps, bool evenly) {
  UsedRows used;
  if (logs.empty()) return used;
  used.all_s = used.used_s = seconds_of(logs);
  std::vector<double> steps_s;
  for (const Log& log : logs) steps_s.push_back(median_step_s(log));
  // a log that is coarser than the period keeps its own steps
  const double step_s = std::max(config.period_s, *std::max_element(steps_s.begin(), steps_s.end()));
  const double budget_s = std::max(kLeast_s, static_cast<double>(most_steps) * step_s);
  if (most_steps == 0 || used.all_s <= budget_s) return used;
  const double piece_s = std::min(std::max(kPiece_s, static_cast<double>(kPieceSteps) * step_s),
                                  budget_s / static_cast<double>(kFewestPieces));
  std::vector<Piece> pieces = cut_pieces(logs, steps_s, piece_s);
  const auto count = std::min(pieces.size(), static_cast<std::size_t>(budget_s / piece_s));
  const std::size_t spread = evenly ? count : count / 2;
  keep_evenly(pieces, spread);
  if (spread < count) {
    const double moment_s = moment_length(logs, steps_s, pieces, config, piece_s / 8);
    std::vector<Features> features = features_of(logs, steps_s, pieces, config, moment_s);
    normalise(features, config.measurement_count);
    keep_telling(pieces, features, count - spread);
  }
  used.pieces = count;
  used.evenly = evenly;
  used.piece_s = piece_s;
  drop_the_rest(logs, pieces);
  used.used_s = seconds_of(logs);
  return used;
}

}  // namespace tiller::tools
