#include "bench/posterior/accuracy_export.hpp"

#include <algorithm>
#include <filesystem>
#include <memory>

namespace tiller::bench {
namespace {

constexpr std::uint32_t kKernelParticles = 1024;

struct Close {
  void operator()(std::FILE* f) const { std::fclose(f); }
};
using File = std::unique_ptr<std::FILE, Close>;

File create(const std::string& path) {
  File file(std::fopen(path.c_str(), "w"));
  if (!file) std::fprintf(stderr, "cannot write '%s'\n", path.c_str());
  return file;
}

bool write_episode(const std::string& path, const AccuracyTask& task, const Episode& e) {
  const File file = create(path);
  if (!file) return false;
  const tiller_model_t& model = *task.config.model;
  for (std::uint32_t r = 0; r < e.nx; ++r) std::fprintf(file.get(), "%s%s", r ? "," : "", model.state_names[r]);
  for (std::uint32_t i = 0; i < e.nu; ++i) std::fprintf(file.get(), ",%s", model.input_names[i]);
  for (std::uint32_t k = 0; k <= e.ticks; ++k) {
    std::fputc('\n', file.get());
    for (std::uint32_t r = 0; r < e.nx; ++r) std::fprintf(file.get(), "%s%.17g", r ? "," : "", e.state[k * e.nx + r]);
    for (std::uint32_t i = 0; i < e.nu; ++i)
      if (k < e.ticks)
        std::fprintf(file.get(), ",%.17g", e.input[k * e.nu + i]);
      else
        std::fputc(',', file.get());
  }
  std::fputc('\n', file.get());
  return true;
}

void write_line(std::FILE* index, const std::string& name, const AccuracyTask& task, double sigma, std::uint64_t seed,
                const Episode& e) {
  const ExactLikelihood likelihood(task, e);
  const ExactPosterior exact = exact_posterior(likelihood, kKernelParticles, seed);
  const auto list = [&](int n, const auto& print) {
    std::fputc(',', index);
    for (int i = 0; i < n; ++i) {
      if (i > 0) std::fputc(' ', index);
      print(i);
    }
  };
  const int d = likelihood.dimensions();
  const Eigen::VectorXd truth = likelihood.truth();
  std::fprintf(index, "%s,%s,%g,%llu", name.c_str(), task.name.c_str(), sigma, static_cast<unsigned long long>(seed));
  list(d,
       [&](int j) { std::fputs(task.config.model->param_names[task.inferred[static_cast<std::size_t>(j)]], index); });
  list(d, [&](int j) { std::fprintf(index, "%.17g", likelihood.prior(j).low); });
  list(d, [&](int j) { std::fprintf(index, "%.17g", likelihood.prior(j).high); });
  list(d, [&](int j) { std::fprintf(index, "%.17g", truth[j]); });
  list(d, [&](int j) { std::fprintf(index, "%.12g", exact.mean[j]); });
  list(d * d, [&](int j) { std::fprintf(index, "%.12g", exact.covariance(j / d, j % d)); });
  std::fprintf(index, ",%.6f,%.2g\n", exact.log_density, exact.error);
}

}  // namespace

bool export_episodes(const Bench& bench) {
  std::error_code failed;
  std::filesystem::create_directories(bench.export_folder, failed);
  const File index = create(bench.export_folder + "/episodes.csv");
  if (!index) return false;
  std::fputs("file,task,sigma,seed,parameters,low,high,truth,mean,covariance,exact_log_density,error\n", index.get());
  for (const int unknowns : {2, 4})
    for (const AccuracyTask& task : bench.tasks(unknowns))
      for (const double sigma : kSigmas) {
        if (bench.sigma > 0.0 && sigma != bench.sigma) continue;
        for (int i = 0; i < bench.runs; ++i) {
          const std::uint64_t seed = bench.first_seed + static_cast<std::uint64_t>(i);
          const Episode e = make_episode(task, sigma, kEpisodeTicks, seed);
          char tail[48];
          std::snprintf(tail, sizeof tail, "_%g_%llu.csv", sigma, static_cast<unsigned long long>(seed));
          std::string name = task.name + tail;
          std::replace(name.begin(), name.end(), ' ', '_');
          if (!write_episode(bench.export_folder + "/" + name, task, e)) return false;
          write_line(index.get(), name, task, sigma, seed, e);
        }
      }
  return true;
}

}  // namespace tiller::bench
