#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "tools/distill/lesson.hpp"
#include "tools/nets/mlp.hpp"
#include "tools/robot/network_file.hpp"

namespace tiller::tools::distill {

struct StudyOptions {
  std::uint32_t epochs = 60;    ///< passes over the examples
  std::uint32_t patience = 15;  ///< passes without a better held-out error after which it ends
  double rate = 2e-3;           ///< Adam's, falling to a twentieth along a cosine
  std::uint64_t seed = 1;
};

/// How well the examples are answered: root mean square of the error in shares of half the command's range, of answers
/// cut to the limits. One in ten episodes is held out; NaN: there were fewer.
struct StudyError {
  double trained = 0, held_out = 0;
  std::uint32_t epochs = 0;  ///< of the network that was kept
};
/// Of the held-out ones; "-": there were none.
std::string error_text(const StudyError& error);

/// A tanh perceptron that answers for the teacher.
class Pupil {
 public:
  /// hidden: widths of one or two layers, each 1..TILLER_MAX_NETWORK_WIDTH.
  Pupil(const RobotFile& robot, std::uint32_t reads, std::vector<int> hidden, std::uint64_t seed);

  /// Fits all of the examples from the present weights on, minibatches of 256 in Adam; every tenth episode is held out,
  /// and the weights of the least held-out error are kept. Loss: Huber's with a corner at a fifth of half the range, so
  /// that where the teacher goes either way the answer is one way, not the mean of both; beyond a limit that the
  /// teacher is at there is no error. O(epochs x samples x weights).
  StudyError study(const Examples& examples, const StudyOptions& options);

  /// As the runtime takes it: scales folded into the weights, the examples' ranges beside them.
  StoredPolicy stored() const;

 private:
  StudyError errors(const nets::Matrix& x, const nets::Matrix& y, const std::vector<Eigen::Index>& trained,
                    const std::vector<Eigen::Index>& held_out) const;

  StoredPolicy shape_;
  nets::Mlp mlp_;
  nets::Vector mean_, sd_;  // of the inputs, since the first study
  std::vector<float> low_, high_;
};

}  // namespace tiller::tools::distill
