#include "tools/view/viewer.hpp"

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>

namespace tiller::tools {
namespace {

using Clock = std::chrono::steady_clock;
using Json = nlohmann::ordered_json;

constexpr std::size_t kPiece = 32768;  // bytes of a packet of the greeting
constexpr int kPatience_ms = 3000;     // of a viewer that says nothing of its progress at the end

Json names_of_codes(std::uint32_t codes, const char* (*name)(std::uint32_t)) {
  Json names = Json::object();
  for (std::uint32_t code = 0; code < codes; ++code)
    if (const std::string text = name(code); text != "unknown") names[std::to_string(code)] = text;
  return names;
}

const char* state_name(std::uint32_t code) { return tiller_state_name(static_cast<tiller_state_t>(code)); }
const char* status_name(std::uint32_t code) { return tiller_status_name(static_cast<tiller_status_t>(code)); }

}  // namespace

Words viewer_kinds() { return {"rerun", "foxglove"}; }

std::string Viewer::hello(const RobotFile& robot, const std::string& facts) const {
  Json json = {{"title", robot.name},
               {"period_s", robot.config.period_s},
               {"stride", row_.stride()},
               {"fields", Json::array()},
               {"states", names_of_codes(tiller_state_safe + 1, state_name)},
               {"statuses", names_of_codes(300, status_name)},
               {"facts", Json::parse(facts)}};
  for (const ViewField& field : row_.fields())
    json["fields"].push_back({{"name", field.name}, {"rows", field.rows}, {"columns", field.columns}});
  return json.dump();
}

std::unique_ptr<Viewer> Viewer::open(const ViewerOptions& options, const RobotFile& robot, const std::string& facts,
                                     std::string& error) {
  std::vector<std::string> arguments = {options.kind};
  if (!options.file.empty()) arguments.insert(arguments.end(), {"--file", options.file});
  if (!options.layout.empty()) arguments.insert(arguments.end(), {"--layout", options.layout});
  auto worker = PythonWorker::start("view", arguments, error, PythonWorker::Socket::packets);
  if (!worker) return nullptr;
  std::unique_ptr<Viewer> viewer(new Viewer(robot, std::move(worker)));
  const std::string text = viewer->hello(robot, facts);
  PythonWorker& to = *viewer->worker_;
  const std::uint64_t size = text.size();
  bool good = to.send(&size, sizeof size);
  for (std::size_t at = 0; good && at < text.size(); at += kPiece)
    good = to.send(text.data() + at, std::min(kPiece, text.size() - at));
  std::string answer;
  if (good && to.hear(-1, 16, answer) == PythonWorker::Heard::something && answer == "ready") return viewer;
  error = "the viewer " + options.kind + " did not start; what is above says why. The run works without --view";
  return nullptr;
}

void Viewer::show(const tiller_t* controller, const LoggedTick& tick) {
  if (worker_->is_gone()) {
    ++dropped_;
    return;
  }
  const auto begin = Clock::now();
  row_.fill(controller, tick, values_.data());
  worker_->offer(values_.data(), values_.size() * sizeof(double)) ? ++shown_ : ++dropped_;
  took_.add(std::chrono::nanoseconds(Clock::now() - begin).count());
}

void Viewer::show_all(const tiller_t* controller, const LoggedTick& tick) {
  row_.fill(controller, tick, values_.data());
  worker_->send(values_.data(), values_.size() * sizeof(double)) ? ++shown_ : ++dropped_;
}

std::string Viewer::close() {
  worker_->end_input();
  std::string ignored;
  PythonWorker::Heard heard = PythonWorker::Heard::something;
  while (heard == PythonWorker::Heard::something) heard = worker_->hear(kPatience_ms, 4096, ignored);
  const bool stuck = heard == PythonWorker::Heard::nothing;
  if (stuck) worker_->kill();
  std::string text = format("view: %llu ticks shown, %llu dropped", static_cast<unsigned long long>(shown_),
                            static_cast<unsigned long long>(dropped_));
  if (took_.count() > 0)
    text += format("; %.0f us a tick in the median, %.0f us 99 %%", took_.quantile_us(0.5), took_.quantile_us(0.99));
  if (worker_->is_gone()) text += "; the viewer ended before the run";
  if (stuck) text += "; the viewer did not answer at the end and was ended";
  worker_.reset();
  return text;
}

}  // namespace tiller::tools
