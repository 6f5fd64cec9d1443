#include "tools/simulator/simulator_pool.hpp"

#include <poll.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <deque>

#include "tools/simulator/line_process.hpp"

namespace tiller::tools {
namespace {

using Clock = std::chrono::steady_clock;

Clock::time_point after(double seconds) {
  return Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

constexpr std::size_t kLongestLine = std::size_t{256} << 20;  // bytes; a simulator that never ends its line
constexpr std::size_t kKeptErrors = 2000;                     // bytes of stderr

/// The last lines of stderr, for an error.
std::string last_words(const std::string& errors) {
  const std::string text = trimmed(errors);
  return text.empty() ? "" : "\n  its last words on stderr: " + text;
}

/// "friction = 0.3, mass_kg = 1".
std::string described(const SimulatorNames& names, const SimulationRequest& request) {
  Words all;
  for (std::size_t i = 0; i < request.parameters.size(); ++i)
    all.push_back((i < names.parameters.size() ? names.parameters[i] : "?") + " = " +
                  number_text(request.parameters[i]));
  return join(all);
}

}  // namespace

struct SimulatorPool::Worker {
  struct Asked {
    std::size_t index;
    std::uint64_t id;
  };
  LineProcess process;
  bool greeted = false;
  std::deque<Asked> asked;
  std::string out, in, errors;
  Clock::time_point due;
};

struct SimulatorPool::Batch {
  const std::vector<SimulationRequest>& requests;
  std::vector<SimulationAnswer>& answers;
  std::deque<std::size_t> waiting;
  std::size_t done = 0;
};

SimulatorPool::SimulatorPool(SimulatorSetup setup) : setup_(std::move(setup)) {
  for (unsigned i = 0; i < std::max(1u, setup_.processes); ++i) workers_.push_back(std::make_unique<Worker>());
}

SimulatorPool::~SimulatorPool() = default;

bool SimulatorPool::begin(Worker& worker, std::string& error) {
  worker.greeted = false;
  worker.in.clear();
  worker.errors.clear();
  worker.out = hello_line(setup_.names);
  worker.due = after(setup_.start_s);
  return worker.process.start(setup_.command, setup_.folder, error);
}

bool SimulatorPool::feed(Worker& worker, Batch& batch, std::string& error) {
  if (!worker.process.running()) {
    if (batch.waiting.empty()) return true;
    if (!begin(worker, error)) return false;
  }
  while (worker.greeted && worker.asked.size() < setup_.ahead && !batch.waiting.empty()) {
    if (worker.asked.empty()) worker.due = after(setup_.timeout_s);
    const std::size_t index = batch.waiting.front();
    batch.waiting.pop_front();
    worker.asked.push_back({index, next_id_});
    worker.out += request_line(next_id_++, batch.requests[index]);
  }
  if (worker.process.write(worker.out)) return true;
  return listen(worker, batch, error) &&
         (!worker.process.running() || lose(worker, batch, "reads no more requests", error));
}

bool SimulatorPool::take_line(Worker& worker, const std::string& line, Batch& batch, std::string& error) {
  std::string problem;
  bool good = false;
  if (!worker.greeted) {
    good = worker.greeted = check_hello(line, problem);
  } else if (worker.asked.empty()) {
    problem = "nothing was asked; answer each request once";
  } else {
    const Worker::Asked asked = worker.asked.front();
    good = read_answer(line, asked.id, batch.requests[asked.index], setup_.names.measurements.size(),
                       batch.answers[asked.index], problem);
    if (good) worker.asked.pop_front(), ++batch.done;
  }
  worker.due = after(setup_.timeout_s);
  if (!good) error = "the simulator's line " + shown_line(line) + ": " + problem + last_words(worker.errors);
  return good;
}

bool SimulatorPool::listen(Worker& worker, Batch& batch, std::string& error) {
  if (worker.process.errors() >= 0) worker.process.read_errors(worker.errors);
  if (worker.errors.size() > kKeptErrors) worker.errors.erase(0, worker.errors.size() - kKeptErrors);
  const bool open = worker.process.read_output(worker.in);
  std::size_t from = 0;
  for (std::size_t end = worker.in.find('\n'); end != std::string::npos; end = worker.in.find('\n', from)) {
    if (!take_line(worker, worker.in.substr(from, end - from), batch, error)) return false;
    from = end + 1;
  }
  worker.in.erase(0, from);
  if (worker.in.size() > kLongestLine) {
    error = "the simulator's line " + shown_line(worker.in) + ": does not end; end each answer by a newline, and flush";
    return false;
  }
  return open || lose(worker, batch, "", error);
}

/// The simulation that it was at has failed; those behind it wait for another process.
bool SimulatorPool::lose(Worker& worker, Batch& batch, const std::string& why, std::string& error) {
  if (worker.process.errors() >= 0) worker.process.read_errors(worker.errors);
  const std::string ending = worker.process.stop(), words = trimmed(worker.errors);
  const std::string what = "the simulator " + (why.empty() ? ending : why);
  if (!worker.greeted) {
    const bool late = !why.empty();
    error = what + " before it had greeted; " +
            (late ? "raise start_s, or flush the greeting" : "run its command by hand; it must greet, and stay") +
            last_words(words);
    return false;
  }
  worker.out.clear();
  std::string at = "between two requests";
  if (!worker.asked.empty()) {
    const std::size_t killer = worker.asked.front().index;
    batch.answers[killer] = {{}, what + (words.empty() ? "" : ": ") + words};
    ++batch.done;
    at = "at " + described(setup_.names, batch.requests[killer]);
    worker.asked.pop_front();
  }
  for (; !worker.asked.empty(); worker.asked.pop_back()) batch.waiting.push_front(worker.asked.back().index);
  if (restarts_++ < setup_.restarts) return true;
  error = format("after %u restarts ", setup_.restarts) + what + " again, this time " + at +
          "; let it answer {\"id\": ..., \"error\": ...} where it cannot simulate, raise timeout_s or restarts, or "
          "narrow the priors" +
          last_words(words);
  return false;
}

bool SimulatorPool::check_clock(Worker& worker, Batch& batch, std::string& error) {
  const bool waits = worker.process.running() && (!worker.greeted || !worker.asked.empty());
  if (!waits || Clock::now() < worker.due) return true;
  return lose(worker, batch, format("did not answer within %g s", worker.greeted ? setup_.timeout_s : setup_.start_s),
              error);
}

/// Until something can be read or written, or somebody is late.
int SimulatorPool::wait(double longest_s) {
  std::vector<pollfd> ends;
  auto due = after(longest_s);
  for (const auto& worker : workers_) {
    if (!worker->process.running()) continue;
    ends.push_back({worker->process.output(), POLLIN, 0});
    if (worker->process.errors() >= 0) ends.push_back({worker->process.errors(), POLLIN, 0});
    if (!worker->out.empty()) ends.push_back({worker->process.input(), POLLOUT, 0});
    if (!worker->greeted || !worker->asked.empty()) due = std::min(due, worker->due);
  }
  const double left_s = std::chrono::duration<double>(due - Clock::now()).count();
  return ::poll(ends.data(), ends.size(), static_cast<int>(std::ceil(std::max(0.0, 1000.0 * left_s))));
}

bool SimulatorPool::run(const std::vector<SimulationRequest>& requests, std::vector<SimulationAnswer>& answers,
                        std::string& error, const std::function<void(double)>& progress) {
  const NoBrokenPipes quiet;
  answers.assign(requests.size(), {});
  Batch batch{requests, answers, {}, 0};
  for (std::size_t i = 0; i < requests.size(); ++i) batch.waiting.push_back(i);
  while (batch.done < requests.size()) {
    for (const auto& worker : workers_)
      if (!feed(*worker, batch, error)) return false;
    wait(1.0);
    for (const auto& worker : workers_)
      if (worker->process.running() && (!listen(*worker, batch, error) || !check_clock(*worker, batch, error)))
        return false;
    if (progress) progress(static_cast<double>(batch.done) / static_cast<double>(requests.size()));
  }
  return true;
}

}  // namespace tiller::tools
